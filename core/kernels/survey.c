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

/* Compute the displacement of the skin at a cell [m].

   It is the mean over the points that cover the centres of the cell's quarters. Without such points, it is that of the
   last point in the root; without points in the root, it is that of `move_afar`. */
static void shift_of(const dermis_survey *s, int64_t cell, double *shift) {
    int64_t root = s->root[cell], under = 0;
    int afar = s->in_root[root] < 0;
    for (int k = 0; k < 3; k++) shift[k] = afar ? s->afar[3 * root + k] : 0.0;
    if (afar) return;
    for (int q = 0; q < 4; q++) {
        int64_t point = s->owner[root * s->squares + s->quarters[4 * cell + q]];
        if (point < 0 || point >= s->points) continue;
        under++;
        for (int k = 0; k < 3; k++) shift[k] += s->raised[3 * point + k];
    }
    for (int k = 0; k < 3; k++) shift[k] = under ? shift[k] / (double)under : s->raised[3 * s->in_root[root] + k];
}

/* Gaps and normals of the closest body at a cell's centre and at four test points.

   If the centre is deep in a body, the centre and the test points are first moved out of it. */
typedef struct {
    double own;             /* gap at the centre, not moved [m] */
    double middle, gap[4];  /* gap at the centre and at the test points, moved out [m] */
    double normal[5][3];    /* normals at the centre and at the test points, 0 if no body is near */
} footprint;

/* Return the closest body at a cell's centre, which is first moved out of the body if it is deep in it.

   Deep in a body, the normals below any edge jump as if the edge were sharp. centre: closest body at the centre itself.
   at: out, the centre, moved if deep [m]. */
static dermis_sight look_down(const dermis_survey *s, int64_t cell, const double *shift, const dermis_sight *centre, footprint *out, double *at) {
    double inward[3];
    dermis_sight sight = *centre;
    for (int k = 0; k < 3; k++) inward[k] = -s->normals[3 * cell + k], at[k] = s->positions[3 * cell + k] + shift[k];
    out->own = out->middle = centre->gap;
    if (centre->gap < -s->deep) {
        double steep = dermis_most(dermis_dot(inward, centre->normal), s->steep);
        for (int k = 0; k < 3; k++) at[k] -= centre->gap / steep * inward[k];
        dermis_look(s->posed, s->bodies, s->limit, s->limit, at, inward, &sight);
        out->middle = sight.gap;
    }
    for (int k = 0; k < 3; k++) out->normal[0][k] = sight.normal[k];
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

/* Find the closest body at four test points, given relative to `at` (4, 3) [m]. */
static void look_about(const dermis_survey *s, int64_t cell, const double *at, const double *corners, dermis_sight sight, footprint *out) {
    double inward[3];
    for (int k = 0; k < 3; k++) inward[k] = -s->normals[3 * cell + k];
    for (int corner = 0; corner < 4; corner++) {
        double x[3];
        for (int k = 0; k < 3; k++) x[k] = at[k] + corners[3 * corner + k];
        dermis_look(s->posed, s->bodies, s->limit, s->limit, x, inward, &sight);
        out->gap[corner] = sight.gap;
        for (int k = 0; k < 3; k++) out->normal[1 + corner][k] = sight.normal[k];
    }
}

/* Whether the flat face that is closest to the centre is also closest to all `count` test points: nothing else is
   near. */
static int flat(const dermis_survey *s, const double *at, const double *corners, int count, const dermis_sight *sight) {
    double radius = 0.0;
    for (int corner = 0; corner < count; corner++) {
        const double *way = corners + 3 * corner;
        double above = sight->gap + dermis_dot(way, sight->normal);
        radius = dermis_most(radius, dermis_root(dermis_dot(way, way)) + dermis_abs(above));
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

/* Return the largest deviation of the gap from a linear function over the test points [m]. */
static double bent(const footprint *of) {
    const double *gap = of->gap;
    double off = dermis_abs(0.25 * (gap[0] + gap[1] + gap[2] + gap[3]) - of->middle);
    return dermis_most(off, 0.25 * dermis_abs(gap[0] - gap[1] - gap[2] + gap[3]));
}

/* Compute the lean along each side of a cell: the range of the normals' components along the side, leaning (2).

   The side with the larger lean crosses the edges of the body. */
static void lean(const dermis_survey *s, int64_t cell, const footprint *of, double *leaning) {
    for (int axis = 0; axis < 2; axis++) {
        const double *side = s->sides + 6 * cell + 3 * axis;
        double low = dermis_dot(of->normal[0], side), high = low;
        for (int i = 1; i < 5; i++) {
            double one = dermis_dot(of->normal[i], side);
            low = dermis_least(low, one), high = dermis_most(high, one);
        }
        leaning[axis] = (high - low) / dermis_root(dermis_dot(side, side));
    }
}

/* Return the directions in which a cell is to be divided because its normals differ.

   A side is halved if the normals differ by more than `limit`, or by more than `sharp` once it is halved `often` times.
   If the last survey halved it, `merge` times this limit is enough. The lean along the side must also be large enough,
   see ODD and LEVEL. */
static int64_t turned(const dermis_survey *s, int64_t cell, const footprint *of, double limit, double sharp) {
    const int64_t *halved = s->halved + 2 * cell;
    double most = apart(of), leaning[2];
    int64_t way = 0;
    lean(s, cell, of, leaning);
    for (int axis = 0; axis < 2; axis++) {
        double share = s->ways_before[cell] & (1 << axis) ? s->merge : 1.0;
        if (halved[axis] >= s->finest || most <= share * (halved[axis] < s->often ? limit : sharp)) continue;
        if (leaning[axis] + s->level > s->odd * share * leaning[1 - axis]) way |= 1 << axis;
    }
    return way;
}

/* Return the directions in which a cell is to be divided because its gap is not linear. */
static int64_t curved(const dermis_survey *s, int64_t cell, const footprint *of) {
    const int64_t *halved = s->halved + 2 * cell;
    double leaning[2];
    int64_t way = 0;
    if (halved[0] >= s->often || halved[1] >= s->often || apart(of) >= s->turned) return 0;
    if (bent(of) <= s->bent * (s->ways_before[cell] ? s->merge : 1.0)) return 0;
    lean(s, cell, of, leaning);
    for (int axis = 0; axis < 2; axis++)
        if (halved[axis] < s->finest && leaning[axis] + s->level > s->odd * leaning[1 - axis]) way |= 1 << axis;
    return way;
}

/* Return the direction in which a cell is divided, 0 for none.

   The first four test points show whether the body is curved at the cell itself. The second four are farther out: they
   show edges beside the cell. */
static int64_t way_of(dermis_survey *s, int64_t cell, const double *shift, const dermis_sight *centre) {
    const int64_t *halved = s->halved + 2 * cell, *some = s->ways + (halved[0] * s->levels + halved[1]) * 4;
    int64_t all = (halved[0] < s->finest) | (halved[1] < s->finest) << 1;
    footprint of;
    double at[3], nearest, corners[24];
    if (!all && s->edges) return 0;
    dermis_sight middle = look_down(s, cell, shift, centre, &of, at);
    corners_of(s, cell, s->corners, 0.0, corners);
    corners_of(s, cell, 0.5, s->beyond, corners + 12);
    if (!s->thorough && flat(s, at, corners, 8, &middle)) return 0;
    look_about(s, cell, at, corners, *centre, &of);
    nearest = of.own;
    for (int corner = 0; corner < 4; corner++) nearest = dermis_least(nearest, of.gap[corner]);
    if (nearest >= s->limits[cell]) return 0;
    int64_t way = turned(s, cell, &of, s->turned, s->sharp) | curved(s, cell, &of);
    if (way == all && s->edges) return some[way];
    look_about(s, cell, at, corners + 12, *centre, &of);
    if (apart(&of) > s->merge * s->edge) s->edges = 1;
    return some[way | turned(s, cell, &of, s->edge, s->sharp)];
}

/* Return the point at the centre of a cell in undeformed skin, and the direction into the finger there. */
static void centre_of(const dermis_survey *s, int64_t cell, double *x, double *inward) {
    for (int k = 0; k < 3; k++) x[k] = s->positions[3 * cell + k], inward[k] = -s->normals[3 * cell + k];
}

/* Return the largest gap of interest at the centre of a cell [m]. */
static double near_of(const dermis_survey *s, int64_t cell) {
    return dermis_least(s->limit, s->limits[cell] + s->beside * s->longs[cell]);
}

/* Compute the displacement of the roots without points that a body may touch [m]: with the bone, and by the forces on
   other roots. A quick test finds them, because skin without points moves less than points do; the others get NaN. The
   rows of the table are read as they lie in memory. farthest: as for `walk`. */
static void move_afar(const dermis_survey *s, double farthest) {
    int64_t *near = s->room, count = 0;
    dermis_sight sight = {0.0, {0.0, 0.0, 0.0}, -1, -1, -1};
    for (int64_t root = 0; root < s->roots; root++) {
        double x[3], inward[3], *shift = s->afar + 3 * root;
        if (s->in_root[root] >= 0) continue;
        centre_of(s, root, x, inward);
        dermis_look(s->posed, s->bodies, near_of(s, root) + farthest, s->limit, x, inward, &sight);
        for (int k = 0; k < 3; k++) shift[k] = sight.body < 0 ? __builtin_nan("") : s->common[k];
        if (sight.body >= 0) near[count++] = root;
    }
    for (int64_t j = 0; j < 3 * s->loaded; j++) {
        const float *row = s->table + (3 * s->rows[j / 3] + j % 3) * s->roots * 3;
        double load = s->load[j];
        for (int64_t i = 0; i < count; i++)
            for (int k = 0; k < 3; k++) s->afar[3 * near[i] + k] += load * (double)row[3 * near[i] + k];
    }
}

/* Walk the tree level by level; return 0 if more cells than `many` may touch, or if the arrays are too small.

   farthest: no point of the skin has moved farther than this [m]. */
static int walk(dermis_survey *s, double many, double farthest) {
    int64_t *cells = s->room, *next = cells + s->most, count = s->roots;
    s->found = s->cut = s->edges = 0;
    for (int64_t i = 0; i < count; i++) cells[i] = i;
    while (count) {
        int64_t after = 0;
        dermis_sight sight = {0.0, {0.0, 0.0, 0.0}, -1, -1, -1};
        for (int64_t i = 0; i < count; i++) {
            int64_t cell = cells[i], way = 0;
            double shift[3], x[3], inward[3], near = near_of(s, cell);
            shift_of(s, cell, shift);
            if (shift[0] != shift[0]) continue;
            centre_of(s, cell, x, inward);
            if (cell >= s->roots && s->in_root[s->root[cell]] < 0) { /* the quick test of `move_afar` */
                dermis_look(s->posed, s->bodies, near + farthest, s->limit, x, inward, &sight);
                if (sight.body < 0) continue;
            }
            for (int k = 0; k < 3; k++) x[k] += shift[k];
            dermis_look(s->posed, s->bodies, near, s->limit, x, inward, &sight);
            if (sight.body < 0) continue;
            const int64_t *halved = s->halved + 2 * cell, *some = s->ways + (halved[0] * s->levels + halved[1]) * 4;
            if ((some[1] || some[2] || some[3]) && sight.gap < s->limits[cell] + s->beside * s->longs[cell])
                way = way_of(s, cell, shift, &sight);
            if (!way) {
                if (sight.gap >= s->limits[cell]) continue;
                if (s->found >= s->most || (double)s->found >= many) return 0;
                s->clearance[s->found] = sight.gap, s->leaves[s->found++] = cell;
                continue;
            }
            if (s->cut >= s->most || after + 4 > s->most) return 0;
            s->cut_ways[s->cut] = way, s->cuts[s->cut++] = cell;
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

/* Find the cells that may touch, with a tree whose finest level is adapted to their number.

   The first tree is as fine as that of the last survey. While more cells than `many` may touch, the finest level is
   lowered. Otherwise it is raised while a finer tree has at most `merge` times `many` cells. */
DERMIS_NOINLINE static int32_t survey(dermis_survey *s) {
    if (!dermis_known_posed(s->posed, s->bodies)) return DERMIS_NOT_FINITE;
    for (int64_t k = 0; k < 3 * s->points; k++)
        if (!dermis_finite(s->raised[k])) return DERMIS_NOT_FINITE;
    for (int64_t k = 0; k < 3 * s->loaded; k++)
        if (!dermis_finite(s->load[k])) return DERMIS_NOT_FINITE;
    double many = (double)s->many, farthest = 0.0;
    for (int64_t k = 0; k < s->points; k++) farthest = dermis_most(farthest, dermis_dot(s->raised + 3 * k, s->raised + 3 * k));
    farthest = dermis_root(farthest) + dermis_root(dermis_dot(s->common, s->common));
    move_afar(s, farthest);
    while (!walk(s, s->finest > s->coarsest ? many : (double)s->most, farthest)) {
        if (s->finest <= s->coarsest) return DERMIS_BAD_RECORD;
        s->finest--;
    }
    while (s->finest < s->levels - 1 && (double)s->found <= s->merge * many) {
        s->finest++;
        if (walk(s, s->merge * many, farthest)) continue;
        s->finest--;
        return walk(s, (double)s->most, farthest) ? DERMIS_DONE : DERMIS_BAD_RECORD;
    }
    return DERMIS_DONE;
}

static int sound(const dermis_survey *s) {
    if (!dermis_sound_posed(s->posed, s->bodies) || s->levels < 1 || s->levels > 8 || s->roots < 0 || s->points < 0) return 0;
    if (s->loaded < 0 || s->most < s->roots || s->coarsest < 0 || s->finest < s->coarsest || s->finest >= s->levels) return 0;
    for (int64_t j = 0; j < s->loaded; j++)
        if (s->rows[j] < 0 || s->rows[j] >= s->filled) return 0;
    for (int64_t r = 0; r < s->roots; r++)
        if (s->in_root[r] >= s->points) return 0;
    return 1;
}

DERMIS_FUNCTION(dermis_find_cells, dermis_survey, sound, survey)
