/* The closest triangle of each point: an exact search without any state.

   A triangle is left out only where a lower bound of its distance exceeds an upper bound of the closest one, so the
   answer is the same as trying all of them. The hint and the tree only choose where the search begins. */
#include "closest.h"

#include "boxes.h"
#include "triangle.h"

/* Triangles within this relative squared distance of the best are equally close; the lowest number wins. */
#define TIE 1e-12
/* Lengths that bound others give way by this share for rounding. */
#define SLACK 1e-9
/* A triangle lies in a plane whose corners are no farther from it than this [m]. */
#define IN_PLANE 1e-9
/* So many equally close triangles are remembered; where there are more, they are looked for a second time. */
#define TIES 32
/* Weights below this count as on an edge or a corner. */
#define ON_FEATURE 1e-9

typedef struct {
    double square, u, w;
    const double *row;
} hit;

typedef struct {
    double bound; /* squared: nothing farther is closest, be it for the closest so far, a hint or the limit [m^2] */
    double least; /* squared distance of the closest so far [m^2] */
    int count;    /* of ties; more than TIES where some were not remembered */
    hit ties[TIES];
} search;

static inline void consider(search *found, const double *row, const double *x) {
    hit own = {0.0, 0.0, 0.0, row};
    own.square = dermis_on_triangle(row, x, &own.u, &own.w);
    if (!(own.square <= found->bound * (1.0 + TIE))) return;
    if (own.square < found->least) {
        if (own.square * (1.0 + TIE) < found->least) found->count = 0; /* all others were farther */
        found->least = own.square;
        found->bound = dermis_least(found->bound, own.square);
    }
    if (found->count < TIES)
        found->ties[found->count++] = own;
    else
        found->count = TIES + 1;
}

/* Keep the lowest number of the triangles that are as close as the closest one. */
static inline void consider_number(const search *found, const double *row, const double *x, hit *lowest) {
    hit own = {0.0, 0.0, 0.0, row};
    own.square = dermis_on_triangle(row, x, &own.u, &own.w);
    if (own.square <= found->least * (1.0 + TIE) && (lowest->row == NULL || row[NUMBER] < lowest->row[NUMBER])) *lowest = own;
}

/* Look at all triangles that may be closest; `lowest` is null in the first search.

   place: of the point, in the tree's units; see `dermis_placed`. */
static void descend(const dermis_tree *tree, const double *x, const dermis_place *place, search *found, hit *lowest) {
    int64_t inner = (((int64_t)1 << 2 * tree->depth) - 1) / 3, blocks = (tree->count + DERMIS_LANES - 1) / DERMIS_LANES;
    int64_t nodes[64];
    float squares[64], limit = dermis_limit(tree, found->bound);
    int open = 1;
    nodes[0] = 0, squares[0] = 0.0f;
    while (open) {
        int64_t node = nodes[--open];
        float least[DERMIS_LANES];
        if (squares[open] > limit) continue;
        if (node < inner) {
            int from = open;
            dermis_away(tree->boxes + node * DERMIS_BOXES, place, least);
            for (int k = 0; k < DERMIS_LANES; k++) {
                if (!(least[k] <= limit)) continue;
                int at = open++;
                for (; at > from && squares[at - 1] < least[k]; at--) nodes[at] = nodes[at - 1], squares[at] = squares[at - 1];
                nodes[at] = 4 * node + 1 + k, squares[at] = least[k]; /* the nearest last, which is looked at first */
            }
            continue;
        }
        int64_t j = node - inner, low = j * blocks >> 2 * tree->depth, high = (j + 1) * blocks >> 2 * tree->depth;
        for (int64_t b = low; b < high; b++) {
            dermis_away(tree->boxes + (inner + b) * DERMIS_BOXES, place, least);
            for (int k = 0; k < DERMIS_LANES; k++) {
                int64_t slot = b * DERMIS_LANES + k;
                if (!(least[k] <= limit) || slot >= tree->count) continue;
                const double *row = tree->packed + slot * DERMIS_ROW;
                if (lowest == NULL) {
                    consider(found, row, x);
                    limit = dermis_limit(tree, found->bound);
                } else {
                    consider_number(found, row, x, lowest);
                }
            }
        }
    }
}

/* Return the lowest number of the triangles that are as close as the closest one, null without any. */
static const hit *chosen(const search *found) {
    const hit *best = NULL;
    for (int i = 0; i < found->count; i++)
        if (found->ties[i].square <= found->least * (1.0 + TIE))
            if (best == NULL || found->ties[i].row[NUMBER] < best->row[NUMBER]) best = &found->ties[i];
    return best;
}

/* Read the feature off the weights: 0 within the face, 1 + k on edge k, 4 + k on corner k. */
static int feature_of(const double *weights) {
    int zero = (weights[0] <= ON_FEATURE) + (weights[1] <= ON_FEATURE) + (weights[2] <= ON_FEATURE), k = 0;
    if (zero == 2) { /* the corner of the largest weight */
        for (int j = 1; j < 3; j++)
            if (weights[j] > weights[k]) k = j;
        return 4 + k;
    }
    if (!zero) return 0;
    while (weights[k] > ON_FEATURE) k++; /* the edge opposite the corner without weight */
    return 1 + (k + 1) % 3;
}

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

/* Find the closest triangle of a point by looking at every one. */
static int look_at_all(const dermis_tree *tree, const double *x, double limit, dermis_closest_point *out) {
    const double *bounds = tree->bounds;
    int64_t total = tree->total;
    double reach = limit, rows[2][DERMIS_ROW], least = __builtin_inf();
    for (int64_t j = 0; j < tree->count; j++) { /* a ball about each: where the closest ends at the latest */
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
            hit own = {0.0, 0.0, 0.0, row};
            dermis_gather(tree, triangle, row);
            own.square = dermis_on_triangle(row, x, &own.u, &own.w);
            if (pass == 0)
                least = dermis_least(least, own.square);
            else if (own.square <= least * (1.0 + TIE) && (lowest.row == NULL || row[NUMBER] < lowest.row[NUMBER]))
                lowest = own, slot = j;
        }
    return least <= limit * limit && lowest.row != NULL && answer(&lowest, slot, out);
}

int dermis_find_closest(const dermis_tree *tree, const double *x, double limit, int64_t hint, dermis_closest_point *out) {
    double square = limit * limit, u, w;
    dermis_place place;
    if (tree->packed == NULL || !dermis_placed(tree, x, &place)) return look_at_all(tree, x, limit, out);
    search found;
    found.bound = square, found.least = __builtin_inf(), found.count = 0;
    if (hint >= 0 && hint < tree->count)
        found.bound = dermis_least(found.bound, dermis_on_triangle(tree->packed + hint * DERMIS_ROW, x, &u, &w));
    descend(tree, x, &place, &found, NULL);
    if (!(found.least <= square)) return 0;
    hit lowest = {0.0, 0.0, 0.0, NULL};
    const hit *best = &lowest;
    if (found.count > TIES)
        descend(tree, x, &place, &found, &lowest);
    else
        best = chosen(&found);
    return best != NULL && best->row != NULL && answer(best, (best->row - tree->packed) / DERMIS_ROW, out);
}

/* Whether a triangle lies in a plane and faces as it does. */
static int in_plane(const double *row, const double *plane) {
    double facing[3], at = dermis_dot(row, plane) - plane[3], b = at + dermis_dot(row + AB, plane), c = at + dermis_dot(row + AC, plane);
    dermis_cross(row + AB, row + AC, facing);
    return dermis_most(dermis_most(dermis_abs(at), dermis_abs(b)), dermis_abs(c)) <= IN_PLANE && dermis_dot(facing, plane) > 0.0;
}

int dermis_only_plane(const dermis_tree *tree, const double *x, double radius, const double *plane) {
    int64_t inner = (((int64_t)1 << 2 * tree->depth) - 1) / 3, blocks = (tree->count + DERMIS_LANES - 1) / DERMIS_LANES;
    int64_t nodes[64];
    int open = 1;
    dermis_place place;
    if (tree->packed == NULL || !dermis_placed(tree, x, &place)) return 0;
    float limit = dermis_limit(tree, radius * radius);
    nodes[0] = 0;
    while (open) {
        int64_t node = nodes[--open];
        float least[DERMIS_LANES];
        if (node < inner) {
            dermis_away(tree->boxes + node * DERMIS_BOXES, &place, least);
            for (int k = 0; k < DERMIS_LANES; k++)
                if (least[k] <= limit) nodes[open++] = 4 * node + 1 + k;
            continue;
        }
        int64_t j = node - inner, low = j * blocks >> 2 * tree->depth, high = (j + 1) * blocks >> 2 * tree->depth;
        for (int64_t b = low; b < high; b++) {
            dermis_away(tree->boxes + (inner + b) * DERMIS_BOXES, &place, least);
            for (int k = 0; k < DERMIS_LANES; k++) {
                int64_t slot = b * DERMIS_LANES + k;
                double u, w;
                if (!(least[k] <= limit) || slot >= tree->count) continue;
                const double *row = tree->packed + slot * DERMIS_ROW;
                if (!in_plane(row, plane) && dermis_on_triangle(row, x, &u, &w) <= radius * radius) return 0;
            }
        }
    }
    return 1;
}
