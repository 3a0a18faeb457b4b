/* Winding numbers of points, counted along a ray.

   Each triangle that the ray leaves by its front counts 1, and each that it enters by its front counts -1. If a ray
   passes so close to an edge that rounding, or a gap between merged corners, could change the count, another ray is
   taken. */
#include "rays.h"

#include "boxes.h"

/* Largest number of rays that are tried. */
#define RAYS 16
/* Upper bounds of lengths are enlarged by this share for rounding. */
#define SLACK 1e-9

/* Add the count of one triangle along a ray to `winding`; return 0 if the count is not certain.

   apart: possible error of the corners [m]. without: see `dermis_winding`. */
static inline int counted(const double *row, const double *x, const double *way, double apart, int64_t without, int64_t *winding) {
    double along, depth;
    if (row[NUMBER] == (double)without) {
        double normal[3];
        dermis_cross(row + AB, row + AC, normal);
        *winding += dermis_dot(way, normal) > 0.0;
        return 1;
    }
    int met = dermis_meets(row, x, way, apart, &along, &depth);
    if (met == DERMIS_MET) *winding += along > 0.0 ? 1 : -1;
    return met != DERMIS_UNSURE;
}

/* Return whether a line through x along `way` misses the bounding ball of a triangle. */
static inline int passed(const dermis_tree *tree, int64_t triangle, const double *x, const double *way, double apart) {
    double d[3], turned[3], reach = tree->bounds[6 * tree->total + triangle] * (1.0 + SLACK) + apart;
    for (int k = 0; k < 3; k++) d[k] = tree->bounds[k * tree->total + triangle] - x[k];
    dermis_cross(d, way, turned);
    return dermis_dot(turned, turned) > reach * reach * dermis_dot(way, way) * (1.0 + SLACK);
}

/* Count all triangles along one ray; return 0 if the count is not certain.

   place: the point in the tree's units; null: there is no tree, and every triangle is examined. */
static int count(const dermis_body *body, const double *x, const dermis_place *place, const double *way, int64_t without, int64_t *winding) {
    const dermis_tree *tree = body->all;
    double apart = body->weld + DERMIS_ROUNDING * (tree->largest + dermis_size(x)), row[DERMIS_ROW];
    *winding = 0;
    if (place == NULL) {
        for (int64_t j = 0; j < tree->count; j++) {
            if (passed(tree, tree->order[j], x, way, apart)) continue;
            dermis_gather(tree, tree->order[j], row);
            if (!counted(row, x, way, apart, without, winding)) return 0;
        }
        return 1;
    }
    int64_t inner = (((int64_t)1 << 2 * tree->depth) - 1) / 3, blocks = (tree->count + DERMIS_LANES - 1) / DERMIS_LANES;
    int64_t nodes[64];
    dermis_lanes none = {0.0f, 0.0f, 0.0f, 0.0f}, ways[3] = {none + (float)way[0], none + (float)way[1], none + (float)way[2]};
    int open = 1;
    nodes[0] = 0;
    while (open) {
        int64_t node = nodes[--open];
        if (node < inner) {
            dermis_bits met = dermis_pierced(tree->boxes + node * DERMIS_BOXES, place, ways);
            for (int k = 0; k < DERMIS_LANES; k++)
                if (met[k]) nodes[open++] = 4 * node + 1 + k;
            continue;
        }
        int64_t j = node - inner, low = j * blocks >> 2 * tree->depth, high = (j + 1) * blocks >> 2 * tree->depth;
        for (int64_t b = low; b < high; b++) {
            dermis_bits met = dermis_pierced(tree->boxes + (inner + b) * DERMIS_BOXES, place, ways);
            for (int k = 0; k < DERMIS_LANES; k++) {
                int64_t slot = b * DERMIS_LANES + k;
                if (!met[k] || slot >= tree->count) continue;
                if (!counted(tree->packed + slot * DERMIS_ROW, x, way, apart, without, winding)) return 0;
            }
        }
    }
    return 1;
}

int dermis_winding(const dermis_body *body, const double *x, int64_t without, int64_t *winding) {
    /* The components of the rays' directions are evenly distributed: step k is t^-(k + 1) with t^4 = t + 1 (Roberts
       2018). */
    static const double step[3] = {0.8191725133961645, 0.6710436067037893, 0.5497004779019703};
    const dermis_tree *tree = body->all;
    dermis_place place;
    int near = tree->packed != NULL && dermis_placed(tree, x, &place);
    if (tree->packed != NULL && !near) { /* too far away for bounds: the triangles do not surround the point */
        *winding = 0;
        return 1;
    }
    for (int ray = 1; ray <= RAYS; ray++) {
        double way[3];
        for (int k = 0; k < 3; k++) way[k] = ray * step[k] - (double)(int64_t)(ray * step[k]) - 0.5;
        if (count(body, x, near ? &place : NULL, way, without, winding)) return 1;
    }
    return 0;
}
