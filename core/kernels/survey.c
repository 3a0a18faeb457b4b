/* The search for cells of a pad that may touch: an adaptive quadtree, divided where the normals of bodies turn.

   For each cell, the gap and normal of the closest body are found at its centre and at four test points near its
   corners. core/contact/solver/point_tree.py explains the rule for division and its constants. A direction of division
   is a number of two bits: bit 0 halves the first side (along the finger), bit 1 the second (around it). */
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
   line meets; infinite if no body is within `limit` of the point [m]. */
static dermis_sight descend(const dermis_survey *s, double *x, const double *inward, double up, double limit, dermis_sight hint, double *height) {
    double from[3] = {x[0], x[1], x[2]};
    dermis_sight sight = hint;
    for (int tries = 0; tries < 10; tries++) {
        for (int k = 0; k < 3; k++) x[k] = from[k] + up * inward[k];
        dermis_look(s->posed, s->bodies, up + limit, s->limit, x, inward, &sight);
        if (sight.body < 0) {
            *height = __builtin_inf();
            return sight;
        }
        if (up <= 0.0 || dermis_abs(sight.gap) <= s->deep) break;
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

/* Look down at four test points, given relative to the cell's centre (4, 3) [m].

   middle: what is closest to the centre. hints: what was closest to the test points of the cell before (4). */
static void look_about(const dermis_survey *s, int64_t cell, const double *corners, dermis_sight middle, dermis_sight *hints, footprint *out) {
    double inward[3];
    for (int k = 0; k < 3; k++) inward[k] = -s->normals[3 * cell + k];
    double steep = dermis_most(dermis_dot(inward, middle.normal), s->steep);
    for (int corner = 0; corner < 4; corner++) {
        double x[3];
        for (int k = 0; k < 3; k++) x[k] = s->positions[3 * cell + k] + corners[3 * corner + k];
        /* the face below the centre is met here, unless it turns */
        double up = dermis_most((-out->middle - dermis_dot(corners + 3 * corner, middle.normal)) / steep, 0.0);
        dermis_sight *sight = hints + corner;
        if (sight->body < 0) *sight = middle;
        *sight = descend(s, x, inward, dermis_least(up, s->above), s->limit, *sight, &out->gap[corner]);
        for (int k = 0; k < 3; k++) out->normal[1 + corner][k] = sight->normal[k];
    }
}

/* Whether the flat face that is closest to the centre is also closest to all `count` test points: nothing else is
   near. */
static int flat(const dermis_survey *s, int64_t cell, const double *at, const double *corners, int count, const dermis_sight *sight) {
    double radius = 0.0, steep = dermis_most(-dermis_dot(s->normals + 3 * cell, sight->normal), s->steep);
    for (int corner = 0; corner < count; corner++) {
        const double *way = corners + 3 * corner;
        double above = sight->gap + dermis_dot(way, sight->normal);
        radius = dermis_most(radius, dermis_root(dermis_dot(way, way)) + dermis_abs(above) / steep);
    }
    return dermis_sees_plane(s->posed, s->bodies, at, radius, sight);
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

/* Return the sides of a cell that may be halved once more, and of these the ones along which the normals lean. */
static int64_t leaning_of(const dermis_survey *s, int64_t cell, const footprint *of, const double *corners) {
    const int64_t *halved = s->halved + 2 * cell;
    double leaning[2];
    int64_t way = 0;
    lean(s, cell, of, corners, leaning);
    for (int axis = 0; axis < 2; axis++)
        if (halved[axis] < s->finest && leaning[axis] > s->odd * leaning[1 - axis]) way |= 1 << axis;
    return way;
}

/* Whether a body with edges is closest to the centre, or within the farthest of the `count` test points of it. */
static int edges_near(const dermis_survey *s, const double *at, const double *inward, const double *corners, int count, const dermis_sight *middle) {
    double radius = 0.0;
    if (middle->body < 0 || s->posed[middle->body].sharpness > s->round) return 1;
    for (int corner = 0; corner < count; corner++) radius = dermis_most(radius, dermis_dot(corners + 3 * corner, corners + 3 * corner));
    radius = dermis_root(radius);
    for (int64_t b = 0; b < s->bodies; b++) {
        dermis_sight sight = {0.0, {0.0, 0.0, 0.0}, -1, -1, -1};
        if (s->posed[b].sharpness <= s->round) continue;
        dermis_look(s->posed + b, 1, radius, s->limit, at, inward, &sight);
        if (sight.body >= 0 && sight.gap < radius) return 1;
    }
    return 0;
}

/* Return the direction in which a cell is divided for a body that is below it, or up to `beyond` beside it; 0 for none.

   The first four test points show whether the body is curved at the cell itself. The second four are farther out: they
   show edges beside the cell. */
static int64_t way_below(const dermis_survey *s, int64_t cell, const double *at, const double *inward, const dermis_sight *middle, dermis_sight *hints, double height) {
    footprint of = {.middle = height, .steps = s->posed[middle->body].body != NULL};
    double nearest = height, corners[24];
    corners_of(s, cell, s->corners, 0.0, corners);
    corners_of(s, cell, 0.5, s->beyond, corners + 12);
    if (!s->thorough && flat(s, cell, at, corners, 8, middle)) return 0;
    for (int k = 0; k < 3; k++) of.normal[0][k] = middle->normal[k];
    look_about(s, cell, corners, *middle, hints, &of);
    for (int corner = 0; corner < 4; corner++) nearest = dermis_least(nearest, of.gap[corner]);
    if (nearest >= s->limits[cell]) return 0;
    int64_t way = apart(&of) > s->turned || bent(s, &of, corners) > s->bent ? leaning_of(s, cell, &of, corners) : 0;
    if (!edges_near(s, at, inward, corners, 8, middle)) return way;
    look_about(s, cell, corners + 12, *middle, hints + 4, &of);
    if (apart(&of) > s->edge) way |= leaning_of(s, cell, &of, corners + 12);
    return way;
}

/* Return the direction in which a cell is divided for an edge up to `beyond` beside the place to which it was dragged. */
static int64_t way_dragged(const dermis_survey *s, int64_t cell, const double *at, const double *inward, const dermis_sight *middle, dermis_sight *hints, double height) {
    footprint of = {.middle = height, .steps = s->posed[middle->body].body != NULL};
    double corners[12], there[3], shift[3], along = dermis_dot(s->drag, inward);
    dermis_sight sight = *middle;
    corners_of(s, cell, 0.5, s->beyond, corners);
    for (int k = 0; k < 3; k++) shift[k] = s->drag[k] - along * inward[k], there[k] = at[k] + shift[k], of.normal[0][k] = middle->normal[k];
    sight.gap += dermis_dot(shift, sight.normal);
    if (!s->thorough && flat(s, cell, there, corners, 4, &sight)) return 0;
    if (!edges_near(s, there, inward, corners, 4, &sight)) return 0;
    for (int corner = 0; corner < 4; corner++)
        for (int k = 0; k < 3; k++) corners[3 * corner + k] += shift[k];
    look_about(s, cell, corners, *middle, hints, &of);
    return apart(&of) > s->edge ? leaning_of(s, cell, &of, corners) : 0;
}

/* Return the direction in which a cell is divided, 0 for none. hints: what was closest to test points before (12). */
static int64_t way_of(const dermis_survey *s, int64_t cell, const double *at, const dermis_sight *middle, dermis_sight *hints, double height) {
    const int64_t *halved = s->halved + 2 * cell, *some = s->ways + (halved[0] * s->levels + halved[1]) * 4;
    double inward[3];
    if (halved[0] >= s->finest && halved[1] >= s->finest) return 0;
    for (int k = 0; k < 3; k++) inward[k] = -s->normals[3 * cell + k];
    int64_t way = way_below(s, cell, at, inward, middle, hints, height);
    if (!way && dermis_dot(s->drag, s->drag) > 0.0) way = way_dragged(s, cell, at, inward, middle, hints + 8, height);
    return some[way];
}

/* Return the point at the centre of a cell in undeformed skin, and the direction into the finger there. */
static void centre_of(const dermis_survey *s, int64_t cell, double *x, double *inward) {
    for (int k = 0; k < 3; k++) x[k] = s->positions[3 * cell + k], inward[k] = -s->normals[3 * cell + k];
}

/* Return the largest gap of interest at the centre of a cell [m]. */
static double near_of(const dermis_survey *s, int64_t cell) {
    return dermis_least(s->limit, s->limits[cell] + s->beside * s->longs[cell]);
}

/* Walk the tree level by level; return 0 if more than `many` cells may touch. */
static int walk(dermis_survey *s, int64_t many) {
    int64_t *cells = s->room, *next = cells + s->most, count = s->roots;
    s->found = 0;
    for (int64_t i = 0; i < count; i++) cells[i] = i;
    while (count) {
        int64_t after = 0;
        dermis_sight sight = {0.0, {0.0, 0.0, 0.0}, -1, -1, -1}, hints[12];
        for (int i = 0; i < 12; i++) hints[i] = sight;
        for (int64_t i = 0; i < count; i++) {
            int64_t cell = cells[i], way = 0;
            double x[3], inward[3], height;
            centre_of(s, cell, x, inward);
            sight = descend(s, x, inward, s->above, near_of(s, cell), sight, &height);
            if (sight.body < 0) continue;
            const int64_t *halved = s->halved + 2 * cell, *some = s->ways + (halved[0] * s->levels + halved[1]) * 4;
            if ((some[1] || some[2] || some[3]) && height < s->limits[cell] + s->beside * s->longs[cell])
                way = way_of(s, cell, x, &sight, hints, height);
            if (!way) {
                if (height >= s->limits[cell]) continue;
                if (s->found >= many) return 0;
                s->clearance[s->found] = height, s->leaves[s->found++] = cell;
                continue;
            }
            if (after + 4 > s->most) return 0;
            int64_t step[2] = {way & 1, way >> 1}, finer[2] = {halved[0] + step[0], halved[1] + step[1]};
            for (int64_t a = 0; a <= step[0]; a++)
                for (int64_t b = 0; b <= step[1]; b++) {
                    int64_t place[2] = {(s->place[2 * cell] << step[0]) + a, (s->place[2 * cell + 1] << step[1]) + b};
                    next[after++] = find(s, s->root[cell], finer, place);
                }
        }
        int64_t *other = cells;
        cells = next, next = other, count = after;
    }
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
