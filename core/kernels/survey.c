/* The search for cells of a pad that may touch: an adaptive quadtree, divided where the normals of bodies turn.

   For each cell, the gap and normal of the closest body are found at its centre and at four test points near its
   corners. Its parts are visited before the next cell of its size. core/contact/solver/point_tree.py explains the rule
   for division and its constants. A direction of division is a number of two bits: bit 0 halves the first side (along
   the finger), bit 1 the second (around it). */
#include "float_environment.h"
#include "kernels.h"
#include "numbers.h"
#include "posed.h"

/* Return the index of a cell by its root, numbers of halvings and position, like `Tiles.find` in core/skin/tiles.py. */
static int64_t find(const dermis_survey *s, int64_t root, const int64_t *halved, const int64_t *place) {
    int64_t a = halved[0], b = halved[1], first = s->first[a * s->levels + b];
    if (a != b) return first + (root << (a + b)) + (place[0] << b) + place[1];
    int64_t code = root << (2 * a);
    for (int64_t k = 0; k < s->levels - 1; k++) code += (((place[0] >> k) & 1) << (2 * k + 1)) + (((place[1] >> k) & 1) << (2 * k));
    return first + code;
}

/* The centre of a cell, and the body below it. */
typedef struct {
    double x[3], inward[3]; /* of undeformed skin [m]; direction into the finger */
    double top, room;       /* height at which the search for the body began, and the gap there: no body is nearer [m] */
    double at[3];           /* where the line from inside the finger meets the body [m] */
    double height, nearest; /* gap at the centre; the same, or less if the line passed a body on the way [m] */
    dermis_sight sight;     /* the body at `at` */
    int passed, within;     /* 1: the line passed such a body within the range of interest; 1: the place nearest to the line is in
                               the cell */
} centre;

/* The place at which a line that goes down passes nearest to a body, before it ends. */
typedef struct {
    double room, gap, at[3]; /* gap where the line begins, least gap before its end, and where that is [m] */
    dermis_sight sight;      /* the body there */
} passage;

/* Heights over the bodies and their normals below a cell's centre and four test points, see `descend`. */
typedef struct {
    double middle, gap[4];  /* heights at the centre and at the test points [m] */
    double normal[5][3];    /* normals at the centre and at the test points, 0 if no body is near */
    int steps;              /* 1: the gap may have steps; 0: the body is a plane, and its gap is along one normal, also at
                               the rim of a disc */
} footprint;

/* Go from a height `up` above a point of undeformed skin [m] down to the first body, or to the point; return what is closest there.

   Deformed skin meets the faces that it meets from above. Faces below, such as the far side of a card or a wall inside
   a body, are not seen. x: in, the point; out, where the line ends [m]. height: out, gap of the point from the face that the
   line meets; infinite if no body is within `limit` of the point [m]. by: out; its gaps are infinite where no body is near. */
static dermis_sight descend(const dermis_survey *s, double *x, const double *inward, double up, double limit, dermis_sight hint, double *height, passage *by) {
    double from[3] = {x[0], x[1], x[2]};
    dermis_sight sight = hint;
    by->room = by->gap = __builtin_inf();
    for (int tries = 0; tries < 10; tries++) {
        for (int k = 0; k < 3; k++) x[k] = from[k] + up * inward[k];
        dermis_look(s->posed, s->bodies, up + limit, s->limit, x, inward, &sight);
        if (sight.body < 0) {
            *height = __builtin_inf();
            return sight;
        }
        if (tries == 0) by->room = sight.gap;
        if (up <= 0.0 || dermis_abs(sight.gap) <= s->deep) break;
        if (sight.gap > 0.0 && sight.gap < by->gap) {
            by->gap = sight.gap, by->sight = sight;
            for (int k = 0; k < 3; k++) by->at[k] = x[k];
        }
        up = dermis_most(up - sight.gap / dermis_most(dermis_dot(inward, sight.normal), s->steep), 0.0);
    }
    *height = sight.gap - up * dermis_most(dermis_dot(inward, sight.normal), s->steep);
    return sight;
}

/* Compute the test points of a cell, relative to its centre, out (4, 3) [m].

   Along each side, a test point is at `share` times the side plus `beyond` [m] from the centre. */
static void corners_of(const dermis_survey *s, int64_t cell, double share, double beyond, double *out) {
    const double *sides = s->sides + 6 * cell;
    double reach[2];
    for (int axis = 0; axis < 2; axis++) reach[axis] = share + beyond / dermis_root(dermis_dot(sides + 3 * axis, sides + 3 * axis));
    for (int corner = 0; corner < 4; corner++) {
        double a = corner & 2 ? reach[0] : -reach[0], b = corner & 1 ? reach[1] : -reach[1];
        for (int k = 0; k < 3; k++) out[3 * corner + k] = a * sides[k] + b * sides[3 + k];
    }
}

/* Return the height above a point of undeformed skin x [m] from which its body is looked for, after that of a cell's centre.

   inward: direction into the finger at x (3). The ball around the place where the search at the centre began, which reaches to
   the nearest body, contains nothing. */
static double start_in(const centre *of, const double *x, const double *inward) {
    double off[3];
    for (int k = 0; k < 3; k++) off[k] = x[k] - of->x[k] + of->top * (inward[k] - of->inward[k]);
    return dermis_most(of->top - dermis_most(of->room - dermis_root(dermis_dot(off, off)), 0.0), 0.0);
}

/* The same for a test point, at `way` from the centre: the face below the centre is met here, unless it turns, or the line
   to it passed another body. */
static double start_at(const dermis_survey *s, const centre *of, const double *x, const double *way) {
    double steep = dermis_most(dermis_dot(of->inward, of->sight.normal), s->steep);
    if (of->passed) return start_in(of, x, of->inward);
    return dermis_least(dermis_most((-of->height - dermis_dot(way, of->sight.normal)) / steep, 0.0), s->above);
}

/* Whether the flat face below a place is also closest to all `count` test points around it (count, 3): nothing else is
   near. */
static int flat(const dermis_survey *s, const centre *of, const double *at, const double *corners, int count, const dermis_sight *sight) {
    double radius = 0.0, steep = dermis_most(dermis_dot(of->inward, sight->normal), s->steep);
    if (s->thorough || of->passed) return 0;
    for (int corner = 0; corner < count; corner++) {
        const double *way = corners + 3 * corner;
        double above = sight->gap + dermis_dot(way, sight->normal);
        radius = dermis_most(radius, dermis_root(dermis_dot(way, way)) + dermis_abs(above) / steep);
    }
    return dermis_sees_plane(s->posed, s->bodies, at, radius, sight);
}

/* Look down at four test points, given relative to the cell's centre (4, 3) [m]. */
static void look_about(const dermis_survey *s, const centre *of, const double *corners, footprint *out) {
    for (int corner = 0; corner < 4; corner++) {
        double x[3], up;
        passage by;
        for (int k = 0; k < 3; k++) x[k] = of->x[k] + corners[3 * corner + k];
        up = start_at(s, of, x, corners + 3 * corner);
        dermis_sight sight = descend(s, x, of->inward, up, s->limit, of->sight, &out->gap[corner], &by);
        for (int k = 0; k < 3; k++) out->normal[1 + corner][k] = sight.normal[k];
    }
}

/* Return the largest difference between normals at two test points. */
static double apart(const footprint *of) {
    double most = 0.0;
    for (int i = 1; i < 5; i++)
        for (int j = 1; j < i; j++) {
            double way[3];
            for (int k = 0; k < 3; k++) way[k] = of->normal[i][k] - of->normal[j][k];
            most = dermis_most(most, dermis_dot(way, way));
        }
    return dermis_root(most);
}

/* Return the largest deviation of the gap from a linear function over the test points (4, 3) [m].

   Between two points, the slope of a gap without steps is between those of the normals there. `deep` / `steep` is the
   error of a height that was found beside an edge. */
static double bent(const dermis_survey *s, const footprint *of, const double *corners) {
    const double *gap = of->gap;
    double off = dermis_abs(0.25 * (gap[0] + gap[1] + gap[2] + gap[3]) - of->middle);
    off = dermis_most(off, 0.25 * dermis_abs(gap[0] - gap[1] - gap[2] + gap[3]));
    for (int i = 0; i < 4 && of->steps; i++) {
        int from = i < 2 ? i : 2 * (i - 2), to = i < 2 ? i + 2 : from + 1;
        double change = gap[to] - gap[from], way[3];
        for (int k = 0; k < 3; k++) way[k] = corners[3 * to + k] - corners[3 * from + k];
        double a = dermis_dot(of->normal[1 + to], way), b = dermis_dot(of->normal[1 + from], way);
        off = dermis_most(off, 0.5 * (dermis_most(change - dermis_most(a, b), dermis_least(a, b) - change) - s->deep / s->steep));
    }
    return off;
}

/* Compute the lean along each side of a cell: the range of the normals' components along the side, leaning (2).

   The side with the larger lean crosses the edges of the body. Where all normals are the same, as on both faces of a low
   step, the slopes of the gap between the test points (4, 3) take their place. */
static void lean(const dermis_survey *s, int64_t cell, const footprint *of, const double *corners, double *leaning) {
    int alike = of->steps && !(apart(of) > s->turned);
    for (int axis = 0; axis < 2; axis++) {
        const double *side = s->sides + 6 * cell + 3 * axis;
        double length = dermis_root(dermis_dot(side, side)), low = dermis_dot(of->normal[0], side), high = low;
        for (int i = 1; i < 5; i++) {
            double one = dermis_dot(of->normal[i], side);
            low = dermis_least(low, one), high = dermis_most(high, one);
        }
        for (int i = 0; i < 2 && alike; i++) {
            int from = axis == 0 ? i : 2 * i, to = axis == 0 ? i + 2 : from + 1;
            double way[3];
            for (int k = 0; k < 3; k++) way[k] = corners[3 * to + k] - corners[3 * from + k];
            double one = (of->gap[to] - of->gap[from]) / dermis_root(dermis_dot(way, way)) * length;
            if (dermis_finite(one)) low = dermis_least(low, one), high = dermis_most(high, one);
        }
        leaning[axis] = (high - low) / length;
    }
}

/* Return the sides of a cell that may be halved once more. */
static int64_t sides_of(const dermis_survey *s, int64_t cell) {
    const int64_t *halved = s->halved + 2 * cell;
    return (halved[0] < s->finest) | (halved[1] < s->finest) << 1;
}

/* Return those of these sides along which the normals lean. */
static int64_t leaning_of(const dermis_survey *s, int64_t cell, const footprint *of, const double *corners) {
    double leaning[2];
    lean(s, cell, of, corners, leaning);
    return sides_of(s, cell) & ((leaning[0] > s->odd * leaning[1]) | (leaning[1] > s->odd * leaning[0]) << 1);
}

/* Whether a part with edges is closest to a place, or within the farthest of the `count` test points of it. */
static int edges_near(const dermis_survey *s, const double *at, const double *corners, int count, const dermis_sight *middle) {
    double radius = 0.0;
    if (middle->body < 0 || dermis_share_of(s->posed + middle->body, middle->triangle) > s->round) return 1;
    for (int corner = 0; corner < count; corner++) radius = dermis_most(radius, dermis_dot(corners + 3 * corner, corners + 3 * corner));
    radius = dermis_root(radius);
    for (int64_t b = 0; b < s->bodies; b++)
        if (dermis_sharp_near(s->posed + b, s->round, at, radius)) return 1;
    return 0;
}

/* Return the sides of a cell that an edge beside it may halve once more.

   A side that was halved less often than the other one is left out: where an edge crosses it, a larger cell that contains
   this one was near that edge as well. */
static int64_t sides_beside(const dermis_survey *s, int64_t cell) {
    const int64_t *halved = s->halved + 2 * cell;
    return sides_of(s, cell) & ((halved[0] >= halved[1]) | (halved[1] >= halved[0]) << 1);
}

/* Return the direction in which a cell is divided for a body that is below it, or up to `beyond` beside it; 0 for none.

   The first four test points show whether the body is curved at the cell itself. The second four are farther out: they
   show edges beside the cell. */
static int64_t way_below(const dermis_survey *s, int64_t cell, const centre *of) {
    footprint print = {.middle = of->height, .steps = s->posed[of->sight.body].body != NULL};
    int64_t beside = sides_beside(s, cell), way = 0;
    double nearest = of->nearest, corners[24];
    corners_of(s, cell, s->corners, 0.0, corners);
    corners_of(s, cell, 0.5, s->beyond, corners + 12);
    if (flat(s, of, of->at, corners, beside ? 8 : 4, &of->sight)) return 0;
    for (int k = 0; k < 3; k++) print.normal[0][k] = of->sight.normal[k];
    if (beside && flat(s, of, of->at, corners, 4, &of->sight)) {
        for (int corner = 0; corner < 4; corner++) nearest = dermis_least(nearest, of->height + dermis_dot(corners + 3 * corner, of->sight.normal));
        if (nearest >= s->limits[cell]) return 0;
    } else {
        look_about(s, of, corners, &print);
        for (int corner = 0; corner < 4; corner++) nearest = dermis_least(nearest, print.gap[corner]);
        if (nearest >= s->limits[cell]) return 0;
        if (apart(&print) > s->turned || bent(s, &print, corners) > s->bent)
            way = leaning_of(s, cell, &print, corners);
        else if (of->within) /* it lies between the test points */
            way = sides_of(s, cell);
    }
    if (!(beside & ~way) || !edges_near(s, of->at, corners, 8, &of->sight)) return way;
    look_about(s, of, corners + 12, &print);
    if (apart(&print) > s->edge) way |= beside & leaning_of(s, cell, &print, corners + 12);
    return way;
}

/* Return the direction in which a cell is divided for an edge up to `beyond` beside the place to which it was dragged. */
static int64_t way_dragged(const dermis_survey *s, int64_t cell, const centre *of) {
    footprint print = {.middle = of->height, .steps = s->posed[of->sight.body].body != NULL};
    int64_t beside = sides_beside(s, cell);
    double corners[12], there[3], shift[3], along = dermis_dot(s->drag, of->inward);
    dermis_sight sight = of->sight;
    if (!beside || !(dermis_dot(s->drag, s->drag) > 0.0)) return 0;
    corners_of(s, cell, 0.5, s->beyond, corners);
    for (int k = 0; k < 3; k++) shift[k] = s->drag[k] - along * of->inward[k], there[k] = of->at[k] + shift[k], print.normal[0][k] = sight.normal[k];
    sight.gap += dermis_dot(shift, sight.normal);
    if (flat(s, of, there, corners, 4, &sight) || !edges_near(s, there, corners, 4, &sight)) return 0;
    for (int corner = 0; corner < 4; corner++)
        for (int k = 0; k < 3; k++) corners[3 * corner + k] += shift[k];
    look_about(s, of, corners, &print);
    return apart(&print) > s->edge ? beside & leaning_of(s, cell, &print, corners) : 0;
}

/* Return the largest gap of interest at the centre of a cell [m]. */
static double near_of(const dermis_survey *s, int64_t cell) {
    return dermis_least(s->limit, s->limits[cell] + s->beside * s->longs[cell]);
}

/* Return the direction in which a cell is divided, 0 for none. */
static int64_t way_of(const dermis_survey *s, int64_t cell, const centre *of) {
    const int64_t *halved = s->halved + 2 * cell, *some = s->ways + (halved[0] * s->levels + halved[1]) * 4;
    if (!(some[1] || some[2] || some[3]) || !sides_of(s, cell) || of->nearest >= near_of(s, cell)) return 0;
    int64_t way = way_below(s, cell, of);
    return some[way ? way : way_dragged(s, cell, of)];
}

/* Whether the place of a body that is nearest to a line which passed it lies in the cell. */
static int within(const dermis_survey *s, int64_t cell, const centre *of, const passage *by) {
    for (int axis = 0; axis < 2; axis++) {
        const double *side = s->sides + 6 * cell + 3 * axis;
        double way[3];
        for (int k = 0; k < 3; k++) way[k] = by->at[k] - by->gap * by->sight.normal[k] - of->x[k];
        if (dermis_abs(dermis_dot(way, side)) > 0.5 * dermis_dot(side, side)) return 0;
    }
    return 1;
}

/* Whether a line that came near a body went on below it.

   It did not if it ended on the plane there within one step, or if the body's face looks up from one step farther down. */
static int passes(const dermis_survey *s, const centre *of, const passage *by) {
    double fall[3], x[3], step = by->gap / s->steep + s->deep;
    for (int k = 0; k < 3; k++) fall[k] = of->at[k] - by->at[k];
    double above = by->gap + dermis_dot(fall, by->sight.normal), down = dermis_least(-dermis_dot(fall, of->inward), step);
    if (of->sight.body >= 0 && dermis_abs(above) <= s->bent && down < step) return 0;
    dermis_sight sight = {0.0, {0.0, 0.0, 0.0}, -1, -1, -1};
    for (int k = 0; k < 3; k++) x[k] = by->at[k] - down * of->inward[k];
    dermis_look(s->posed + by->sight.body, 1, by->gap + down, s->limit, x, of->inward, &sight);
    return sight.body < 0 || dermis_dot(of->inward, sight.normal) < s->steep;
}

/* Find the body below the centre of a cell.

   Where there is none, or it is too far, the body takes its place that the line passed on the way there. whole: the divided
   cell, null for a root. hint: a body near the cell. */
static void look_below(const dermis_survey *s, int64_t cell, const centre *whole, dermis_sight hint, centre *out) {
    double near = near_of(s, cell);
    passage by;
    for (int k = 0; k < 3; k++) out->at[k] = out->x[k] = s->positions[3 * cell + k], out->inward[k] = -s->normals[3 * cell + k];
    out->top = whole == NULL ? s->above : start_in(whole, out->x, out->inward);
    out->sight = descend(s, out->at, out->inward, out->top, near, hint, &out->height, &by);
    out->room = by.room, out->passed = by.gap < near && passes(s, out, &by), out->within = out->passed && within(s, cell, out, &by);
    out->nearest = out->passed ? dermis_least(by.gap, out->height) : out->height;
    if (!out->passed || (out->sight.body >= 0 && out->height < near)) return;
    out->sight = by.sight, out->height = by.gap;
    for (int k = 0; k < 3; k++) out->at[k] = by.at[k];
}

/* Add a cell or its parts to the leaves; return 0 if these become more than `many`.

   whole: the cell that was divided, null for a root. hint: a body near the cell; out: the one below its centre, if there is one. */
static int visit(dermis_survey *s, int64_t many, int64_t cell, const centre *whole, dermis_sight *hint) {
    centre own;
    look_below(s, cell, whole, *hint, &own);
    if (own.sight.body < 0) return 1;
    *hint = own.sight;
    int64_t way = way_of(s, cell, &own);
    if (!way) {
        if (own.nearest >= s->limits[cell]) return 1;
        if (s->found >= many) return 0;
        s->clearance[s->found] = own.nearest, s->leaves[s->found++] = cell;
        return 1;
    }
    const int64_t *halved = s->halved + 2 * cell, step[2] = {way & 1, way >> 1}, finer[2] = {halved[0] + step[0], halved[1] + step[1]};
    for (int64_t a = 0; a <= step[0]; a++)
        for (int64_t b = 0; b <= step[1]; b++) {
            int64_t place[2] = {(s->place[2 * cell] << step[0]) + a, (s->place[2 * cell + 1] << step[1]) + b};
            if (!visit(s, many, find(s, s->root[cell], finer, place), &own, hint)) return 0;
        }
    return 1;
}

/* Visit all roots; return 0 if more than `many` cells may touch. */
static int walk(dermis_survey *s, int64_t many) {
    dermis_sight hint = {0.0, {0.0, 0.0, 0.0}, -1, -1, -1};
    s->found = 0;
    for (int64_t root = 0; root < s->roots; root++)
        if (!visit(s, many, root, NULL, &hint)) return 0;
    return 1;
}

/* Find the cells that may touch. While there are more than `many`, the finest level is lowered. */
DERMIS_NOINLINE static int32_t survey(dermis_survey *s) {
    if (!dermis_known_posed(s->posed, s->bodies)) return DERMIS_NOT_FINITE;
    while (!walk(s, s->finest > s->coarsest ? s->many : s->most)) {
        if (s->finest <= s->coarsest) return DERMIS_BAD_RECORD;
        s->finest--;
    }
    return DERMIS_DONE;
}

static int sound(const dermis_survey *s) {
    return dermis_sound_posed(s->posed, s->bodies) && s->levels >= 1 && s->levels <= 8 && s->roots >= 0 && s->most >= s->roots && s->coarsest >= 0 &&
           s->finest >= s->coarsest && s->finest < s->levels;
}

DERMIS_FUNCTION(dermis_find_cells, dermis_survey, sound, survey)
