/* The closest triangle of a point: an exact search without state.

   A triangle is left out only if a lower bound of its distance exceeds an upper bound of the distance of the closest
   one. So the result is the same as if all triangles were measured. The hint and the tree affect only the run time.

   On a convex body a triangle is the closest one if it is closer than its neighbours. The search then walks from
   triangle to triangle, downhill from the hint, and needs no tree. Where it cannot exclude that another triangle is
   equally close, the tree decides, as it does where there is no hint or the closest triangle is far from it. */
#include "closest.h"

#include "boxes.h"
#include "triangle.h"

/* Triangles are equally close if their squared distances differ by at most this share. The one with the lowest number
   is then taken. */
#define TIE 1e-12
/* Upper bounds of lengths are enlarged by this share for rounding. */
#define SLACK 1e-9
/* A triangle lies in a plane if its corners are no farther than this from the plane [m]. */
#define IN_PLANE 1e-9
/* Number of equally close triangles that are stored. If there are more, a second search finds the lowest number. */
#define TIES 32
/* A weight up to this counts as zero: the closest point is then on an edge or a corner. */
#define ON_FEATURE 1e-9
/* Largest numbers of steps of a walk: CROSSED triangles that only a point's projection leaves, enough from one side of a
   rounded edge to the other, then STEPS that measure the distance. As many take nearly as long as the tree. FARTHEST_WALK:
   largest distance of a point for which a walk decides [m]. ON_PLANE: depth of a point below a plane, by rounding, at which it
   counts as on it [m]. MARGIN: the walk decides for such a point only this far from the triangle's edges [m]: faces meet at
   more than 1e-5 rad, so others are farther. */
#define CROSSED 64
#define STEPS 8
#define ON_PLANE 1e-12
#define MARGIN 1e-6
#define FARTHEST_WALK 10e-3
/* A body with triangles that rise above the plane of another one by more than this share of its size is not convex.
   Boxes of triangles in the plane do not rise so far, with all rounding errors of single precision. */
#define CONVEX (16.0 * ROUNDED)
/* A triangle has no accurate plane if twice its area is below this share of its longest squared edge. */
#define NO_PLANE 1e-7

/* The closest point of one triangle: squared distance [m^2], weights u of corner b and w of corner c, the triangle's
   row. */
typedef struct {
    double square, u, w;
    const double *row;
} hit;

typedef struct {
    const double *x; /* the point [m] */
    double bound; /* upper bound of the closest triangle's squared distance, from the limit, the hint and `least`
                     [m^2] */
    double least; /* squared distance of the closest triangle so far [m^2] */
    int count;    /* number of ties; TIES + 1 if not all of them are stored */
    hit ties[TIES]; /* triangles that may be equally close */
    hit lowest;     /* out of a second search: of the triangles as close as `least`, the one with the lowest number */
} search;

/* Whether a triangle rises above a plane. */
static int rises(const double *row, const double *plane) {
    double at = dermis_dot(row, plane) - plane[3];
    return dermis_most(at, dermis_most(at + dermis_dot(row + AB, plane), at + dermis_dot(row + AC, plane))) > 0.0;
}

/* Call a function for triangles whose boxes are within a distance of a point x [m], the nearest boxes first; return 0
   without a tree, or if the point is too far away for it.

   square: the squared distance [m^2]. plane: if not null, the function is called only for triangles that rise above it.
   Inlined into each caller, with its function. */
static inline __attribute__((always_inline)) int walk(const dermis_tree *tree, const double *x, double square, const double *plane, dermis_visitor *visitor, void *state) {
    int64_t inner = (((int64_t)1 << 2 * tree->depth) - 1) / 3, blocks = (tree->count + DERMIS_LANES - 1) / DERMIS_LANES;
    int64_t nodes[64];
    float squares[64], limit = dermis_limit(tree, square);
    dermis_place place;
    dermis_level level;
    dermis_bits above = {-1, -1, -1, -1};
    int open = 1;
    if (tree->packed == NULL || !dermis_placed(tree, x, &place)) return 0;
    if (plane != NULL) dermis_leveled(tree, plane, &place, &level);
    nodes[0] = 0, squares[0] = 0.0f;
    while (open) {
        int64_t node = nodes[--open];
        float least[DERMIS_LANES];
        if (squares[open] > limit) continue;
        if (node < inner) {
            int from = open;
            dermis_away(tree->boxes + node * DERMIS_BOXES, &place, least);
            if (plane != NULL) above = dermis_above(tree->boxes + node * DERMIS_BOXES, &level);
            for (int k = 0; k < DERMIS_LANES; k++) {
                if (!(least[k] <= limit) || !above[k]) continue;
                int at = open++;
                for (; at > from && squares[at - 1] < least[k]; at--) nodes[at] = nodes[at - 1], squares[at] = squares[at - 1];
                nodes[at] = 4 * node + 1 + k, squares[at] = least[k]; /* sorted: the nearest box is last, and taken
                                                                         first */
            }
            continue;
        }
        int64_t j = node - inner, low = j * blocks >> 2 * tree->depth, high = (j + 1) * blocks >> 2 * tree->depth;
        for (int64_t b = low; b < high; b++) {
            dermis_away(tree->boxes + (inner + b) * DERMIS_BOXES, &place, least);
            if (plane != NULL) above = dermis_above(tree->boxes + (inner + b) * DERMIS_BOXES, &level);
            for (int k = 0; k < DERMIS_LANES; k++) {
                int64_t slot = b * DERMIS_LANES + k;
                const double *row = tree->packed + slot * DERMIS_ROW;
                if (!(least[k] <= limit) || !above[k] || slot >= tree->count || (plane != NULL && !rises(row, plane))) continue;
                square = visitor(state, row);
                if (square < 0.0) return 1;
                limit = dermis_limit(tree, square);
            }
        }
    }
    return 1;
}

/* Measure a triangle. */
static hit measured(const double *row, const double *x) {
    hit own = {.row = row};
    own.square = dermis_on_triangle(row, x, &own.u, &own.w);
    return own;
}

/* Measure a triangle, and store it if it may be the closest one. */
static double consider(void *state, const double *row) {
    search *found = state;
    hit own = measured(row, found->x);
    if (!(own.square <= found->bound * (1.0 + TIE))) return found->bound;
    if (own.square < found->least) {
        if (own.square * (1.0 + TIE) < found->least) found->count = 0; /* the stored triangles are all farther */
        found->least = own.square;
        found->bound = dermis_least(found->bound, own.square);
    }
    if (found->count < TIES)
        found->ties[found->count++] = own;
    else
        found->count = TIES + 1;
    return found->bound;
}

/* Replace `lowest` by a triangle if this is as close as the closest one and has a lower number. */
static double consider_number(void *state, const double *row) {
    search *found = state;
    hit own = measured(row, found->x);
    if (own.square <= found->least * (1.0 + TIE) && (found->lowest.row == NULL || row[NUMBER] < found->lowest.row[NUMBER])) found->lowest = own;
    return found->bound;
}

/* Return the stored triangle with the lowest number among those as close as the closest one; null if there is none. */
static const hit *chosen(const search *found) {
    const hit *best = NULL;
    for (int i = 0; i < found->count; i++)
        if (found->ties[i].square <= found->least * (1.0 + TIE))
            if (best == NULL || found->ties[i].row[NUMBER] < best->row[NUMBER]) best = &found->ties[i];
    return best;
}

/* Return the feature for barycentric weights (3): 0 within the face, 1 + k on edge k, 4 + k on corner k. */
static int feature_of(const double *weights) {
    int zero = (weights[0] <= ON_FEATURE) + (weights[1] <= ON_FEATURE) + (weights[2] <= ON_FEATURE), k = 0;
    if (zero == 2) { /* the corner with the largest weight */
        for (int j = 1; j < 3; j++)
            if (weights[j] > weights[k]) k = j;
        return 4 + k;
    }
    if (!zero) return 0;
    while (weights[k] > ON_FEATURE) k++; /* corner k has no weight: the edge opposite to it */
    return 1 + (k + 1) % 3;
}

/* Fill in the result for the closest triangle; return 1. */
static int answer(const hit *found, int64_t slot, dermis_closest_point *out) {
    const double *row = found->row;
    double *weights = out->weights;
    weights[0] = dermis_most(1.0 - found->u - found->w, 0.0), weights[1] = found->u, weights[2] = found->w;
    for (int k = 0; k < 3; k++) {
        out->point[k] = row[k] + found->u * row[AB + k];
        out->point[k] += found->w * row[AC + k];
    }
    out->feature = feature_of(weights);
    out->slot = slot;
    for (int k = 0; k < DERMIS_ROW; k++) out->row[k] = row[k];
    return 1;
}

/* Find the closest triangle of a point without a tree; see `dermis_find_closest`.

   Two passes measure the triangles whose bounding ball is near enough: the first finds the least distance, the second
   the lowest number. */
static int look_at_all(const dermis_tree *tree, const double *x, double limit, dermis_closest_point *out) {
    const double *bounds = tree->bounds;
    int64_t total = tree->total;
    double reach = limit, rows[2][DERMIS_ROW], least = __builtin_inf();
    for (int64_t j = 0; j < tree->count; j++) { /* no triangle is farther than the far side of its bounding ball */
        int64_t triangle = tree->order[j];
        double d[3];
        for (int k = 0; k < 3; k++) d[k] = bounds[k * total + triangle] - x[k];
        reach = dermis_least(reach, dermis_root(dermis_dot(d, d)) + bounds[6 * total + triangle]);
    }
    reach *= 1.0 + SLACK;
    reach += SLACK * dermis_most(dermis_most(dermis_abs(x[0]), dermis_abs(x[1])), dermis_abs(x[2]));
    hit lowest = {0.0, 0.0, 0.0, NULL};
    int64_t slot = -1;
    for (int pass = 0; pass < 2; pass++)
        for (int64_t j = 0; j < tree->count; j++) {
            int64_t triangle = tree->order[j];
            double d[3];
            for (int k = 0; k < 3; k++) d[k] = bounds[k * total + triangle] - x[k];
            if (dermis_root(dermis_dot(d, d)) - bounds[6 * total + triangle] > reach) continue;
            double *row = rows[lowest.row == rows[0]];
            dermis_gather(tree, triangle, row);
            hit own = measured(row, x);
            if (pass == 0)
                least = dermis_least(least, own.square);
            else if (own.square <= least * (1.0 + TIE) && (lowest.row == NULL || row[NUMBER] < lowest.row[NUMBER]))
                lowest = own, slot = j;
        }
    return least <= limit * limit && lowest.row != NULL && answer(&lowest, slot, out);
}

int dermis_find_closest(const dermis_tree *tree, const double *x, double limit, int64_t hint, dermis_closest_point *out) {
    double square = limit * limit, u, w;
    search found;
    found.x = x, found.bound = square, found.least = __builtin_inf(), found.count = 0, found.lowest.row = NULL;
    if (tree->packed != NULL && hint >= 0 && hint < tree->count)
        found.bound = dermis_least(found.bound, dermis_on_triangle(tree->packed + hint * DERMIS_ROW, x, &u, &w));
    if (!walk(tree, x, found.bound, NULL, consider, &found)) return look_at_all(tree, x, limit, out);
    if (!(found.least <= square)) return 0;
    const hit *best = &found.lowest;
    if (found.count > TIES)
        walk(tree, x, found.bound, NULL, consider_number, &found);
    else
        best = chosen(&found);
    return best != NULL && best->row != NULL && answer(best, (best->row - tree->packed) / DERMIS_ROW, out);
}

/* Whether a triangle lies in a plane and its normal is on the same side as the plane's. */
static int in_plane(const double *row, const double *plane) {
    double facing[3], at = dermis_dot(row, plane) - plane[3], b = at + dermis_dot(row + AB, plane), c = at + dermis_dot(row + AC, plane);
    dermis_cross(row + AB, row + AC, facing);
    return dermis_most(dermis_most(dermis_abs(at), dermis_abs(b)), dermis_abs(c)) <= IN_PLANE && dermis_dot(facing, plane) > 0.0;
}

void dermis_visit(const dermis_tree *tree, const double *x, double radius, const double *plane, dermis_visitor *visitor, void *state) {
    double square = radius * radius;
    if (walk(tree, x, square, plane, visitor, state)) return;
    for (int64_t j = 0; j < tree->count && square >= 0.0; j++) {
        double row[DERMIS_ROW];
        dermis_gather(tree, tree->order[j], row);
        if (plane == NULL || rises(row, plane)) square = visitor(state, row);
    }
}

/* A ball, and the plane in which all triangles within it should lie. */
typedef struct {
    const double *x, *plane;
    double square; /* of the radius [m^2] */
    int leaves; /* out: 1 if a triangle does not */
} flat_ball;

static double leaves_plane(void *state, const double *row) {
    flat_ball *ball = state;
    double u, w;
    ball->leaves = !in_plane(row, ball->plane) && dermis_on_triangle(row, ball->x, &u, &w) <= ball->square;
    return ball->leaves ? -1.0 : ball->square;
}

int dermis_only_plane(const dermis_tree *tree, const double *x, double radius, const double *plane) {
    flat_ball ball = {x, plane, radius * radius, 0};
    return walk(tree, x, ball.square, NULL, leaves_plane, &ball) && !ball.leaves;
}

/* A triangle's plane, and the height above it of the highest triangle near it [m]. */
typedef struct {
    double plane[4], square, height;
} skyline;

static double rise_of(void *state, const double *row) {
    skyline *of = state;
    double at = dermis_dot(row, of->plane) - of->plane[3];
    of->height = dermis_most(of->height, dermis_most(at, dermis_most(at + dermis_dot(row + AB, of->plane), at + dermis_dot(row + AC, of->plane))));
    return of->square;
}

static double stop(void *state, const double *row) {
    (void)row;
    *(int *)state = 1;
    return -1.0;
}

double dermis_bulge(const dermis_tree *tree, double *facing) {
    const double *bounds = tree->bounds;
    double most = 0.0, high = CONVEX * (tree->scale + tree->largest), near = 2.0 * dermis_root(FARTHEST_WALK * high);
    if (tree->packed == NULL) return __builtin_inf();
    for (int64_t i = 0; i < tree->count; i++, facing += 4) {
        const double *row = tree->packed + i * DERMIS_ROW;
        int64_t j = (int64_t)row[NUMBER];
        double centre[3], radius = bounds[6 * tree->total + j] + near;
        skyline of = {.square = radius * radius, .height = 0.0};
        int rises_far = 0;
        for (int k = 0; k < 3; k++) centre[k] = bounds[k * tree->total + j];
        facing[3] = dermis_facing(row, facing);
        if (!(facing[3] > NO_PLANE * dermis_most(row[AB_AB], dermis_most(row[AC_AC], row[BC_BC])))) return __builtin_inf();
        for (int k = 0; k < 3; k++) of.plane[k] = facing[k];
        of.plane[3] = dermis_dot(row, facing) + high;
        dermis_visit(tree, centre, __builtin_inf(), of.plane, stop, &rises_far);
        if (rises_far) return __builtin_inf();
        of.plane[3] -= high;
        dermis_visit(tree, centre, radius, of.plane, rise_of, &of);
        most = dermis_most(most, of.height);
    }
    return most + 64.0 * DBL_EPSILON * tree->largest;
}

/* Measure the triangle in a slot. */
static hit measured_in(const dermis_tree *tree, const double *x, int64_t slot) { return measured(tree->packed + slot * DERMIS_ROW, x); }

/* Whether the closest point of a triangle is farther than a margin from its edges, except edge `but` (-1: none).

   area: twice that of the triangle [m^2]. square: of the margin [m^2]. */
static int clear(const hit *of, double area, int but, double square) {
    const double *row = of->row;
    double weights[3] = {1.0 - of->u - of->w, of->u, of->w}; /* of the corners opposite to edges 1, 2 and 0 */
    double lengths[3] = {row[BC_BC], row[AC_AC], row[AB_AB]};
    for (int i = 0; i < 3; i++)
        if ((i + 1) % 3 != but && !(weights[i] > 0.0 && weights[i] * weights[i] * area * area > square * lengths[i])) return 0;
    return 1;
}

/* Whether no triangle is as close as the one that a walk has found, and for an edge its neighbour; see `dermis_bulge`.

   A point of another triangle at a distance s from the closest point is above its plane by at most the bulge b. Its
   squared distance is therefore at least d^2 + s^2 - 2 b d. Beside an edge, b is multiplied by a + c, where the direction
   to x is a times the one normal plus c times the other. If x is on the plane, or at most ON_PLANE below it, other triangles
   are farther if s is at least MARGIN. edge: of `found` on which the closest point lies, -1 for none.
   facing, facing_of_next: rows of `dermis_convex` for both triangles (4). */
static int only(const hit *found, const double *facing, const hit *next, const double *facing_of_next, int edge, int edge_of_next, double bulge, const double *x) {
    double distance = dermis_root(found->square), times = 1.0, v[3];
    for (int k = 0; k < 3; k++) v[k] = x[k] - found->row[k];
    double height = dermis_dot(v, facing);
    if (edge >= 0) {
        times = 2.0 / dermis_most(1.0 + dermis_dot(facing, facing_of_next), 1e-6);
        for (int k = 0; k < 3; k++) v[k] = x[k] - next->row[k];
        height = dermis_least(height, dermis_dot(v, facing_of_next));
    }
    if (!(height > -ON_PLANE)) return 0;
    double square = 4.0 * (times * bulge * distance + TIE * found->square);
    if (height < ON_PLANE) square = dermis_most(square, MARGIN * MARGIN);
    return times * distance <= FARTHEST_WALK && clear(found, facing[3], edge, square) && (edge < 0 || clear(next, facing_of_next[3], edge_of_next, square));
}

/* Walk from a slot to a triangle near a point: cross the edge whose opposite corner has the least weight in the point's
   projection on the plane. */
static int64_t crossed(const dermis_tree *tree, const int64_t *beside, const double *x, int64_t slot) {
    int64_t before = -1;
    for (int step = 0; step < CROSSED; step++) {
        const double *row = tree->packed + slot * DERMIS_ROW;
        double v[3] = {x[0] - row[0], x[1] - row[1], x[2] - row[2]}, u, w;
        dermis_solved(row, dermis_dot(v, row + AB), dermis_dot(v, row + AC), &u, &w);
        double a = 1.0 - u - w, least = u <= w ? u : w;
        int edge = u <= w ? 2 : 0;
        edge = a <= least ? 1 : edge, least = a <= least ? a : least;
        if (!(least < 0.0)) return slot;
        int64_t next = beside[3 * slot + edge];
        if (next < 0 || next == before) return slot;
        before = slot, slot = next;
    }
    return slot;
}

int dermis_walk_to_closest(const dermis_tree *tree, const dermis_convex *convex, const double *x, double limit, int64_t *slot, dermis_closest_point *out) {
    const int64_t *beside = convex->beside;
    if (*slot < 0) return -1;
    *slot = crossed(tree, beside, x, *slot);
    hit found = measured_in(tree, x, *slot);
    for (int step = 0; step < STEPS; step++) {
        double weights[3] = {dermis_most(1.0 - found.u - found.w, 0.0), found.u, found.w};
        int feature = feature_of(weights), first = feature < 4 ? feature - 1 : feature - 4, other = feature < 4 ? first : (first + 2) % 3;
        if (feature == 0) {
            if (!only(&found, convex->facing + 4 * *slot, NULL, NULL, -1, -1, convex->bulge, x)) return -1;
            return found.square <= limit * limit ? answer(&found, *slot, out) : 0;
        }
        int64_t next = beside[3 * *slot + first], beyond = beside[3 * *slot + other];
        if (next < 0 || beyond < 0) return -1;
        hit over = measured_in(tree, x, next);
        if (other != first) {
            hit second = measured_in(tree, x, beyond);
            if (second.square < over.square) over = second, next = beyond;
        }
        if (over.square * (1.0 + TIE) < found.square) {
            found = over, *slot = next;
            continue;
        }
        if (feature >= 4 || over.square > found.square * (1.0 + TIE)) return -1;
        int back = 0;
        while (back < 3 && beside[3 * next + back] != *slot) back++;
        if (back == 3 || !only(&found, convex->facing + 4 * *slot, &over, convex->facing + 4 * next, first, back, convex->bulge, x)) return -1;
        if (dermis_least(found.square, over.square) > limit * limit) return 0;
        if (over.row[NUMBER] < found.row[NUMBER]) found = over, *slot = next;
        return answer(&found, *slot, out);
    }
    return -1;
}
