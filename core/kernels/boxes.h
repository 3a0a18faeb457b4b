/* Lower bounds of the distances from a point to four boxes at once, in single precision.

   A group of four boxes has 16 quantities of four floats: the centre (0 to 2), the axes (3 to 11), half the size along
   each axis (12 to 14), and one that is not used. Lengths are divided by the tree's scale, and the tree's middle is the
   origin. Rounding can make a computed distance too small, but never too large. */
#ifndef DERMIS_BOXES_H
#define DERMIS_BOXES_H

#include "kernels.h"
#include "numbers.h"

typedef float dermis_lanes __attribute__((vector_size(4 * DERMIS_LANES), aligned(4), may_alias));
typedef int32_t dermis_bits __attribute__((vector_size(4 * DERMIS_LANES), aligned(4), may_alias));

enum { AXES = 3, HALF = 12 };

/* Bound of the rounding error of a distance, as a share of the distances of the point and of the box to the tree's
   middle, of the box's size, and of the tree's scale: positions, axes and ten operations in single precision have
   relative errors of up to 2^-24 each. */
#define ROUNDED 2e-6f
/* FARTHEST: largest coordinate in the tree's units for which bounds are computed; single precision does not tell boxes
   apart farther away. NOWHERE: a length above all others in the tree's units. An empty box has its negative as half
   size. */
#define FARTHEST 1e15
#define NOWHERE 1e18f
/* A ray counts as parallel to the faces across an axis of a box if the component of its direction along the axis is
   smaller than this. */
#define LEVEL 1e-19f

/* A point in the tree's units; each number is in all lanes. */
typedef struct {
    dermis_lanes x[3]; /* coordinates */
    dermis_lanes give; /* bound of the rounding error of its distances */
} dermis_place;

/* Convert a point to the tree's units; return 0 if it is too far away for bounds in single precision. */
static inline int dermis_placed(const dermis_tree *tree, const double *x, dermis_place *place) {
    double farthest = 0.0;
    for (int k = 0; k < 3; k++) {
        double along = (x[k] - tree->middle[k]) / tree->scale;
        farthest = dermis_most(farthest, dermis_abs(along));
        if (!(farthest < FARTHEST)) return 0;
        for (int i = 0; i < DERMIS_LANES; i++) place->x[k][i] = (float)along;
    }
    for (int i = 0; i < DERMIS_LANES; i++) place->give[i] = 2.0f * ROUNDED * (float)farthest;
    return 1;
}

/* Convert a squared distance [m^2] to a limit for squared bounds in the tree's units.

   It is a little larger, so that triangles which are equally close up to rounding are within it. */
static inline float dermis_limit(const dermis_tree *tree, double square) {
    double limit = square / (tree->scale * tree->scale) * (1.0 + 1e-5);
    return limit < FARTHEST * FARTHEST ? (float)limit : __builtin_inff();
}

/* Compute lower bounds of the squared distances from a point to four boxes, in the tree's units (4). */
static inline void dermis_away(const float *boxes, const dermis_place *place, float *squares) {
    const dermis_lanes *of = (const dermis_lanes *)boxes;
    dermis_lanes d[3], square = {0.0f, 0.0f, 0.0f, 0.0f}, none = square;
    const dermis_bits magnitude = {INT32_MAX, INT32_MAX, INT32_MAX, INT32_MAX};
    for (int k = 0; k < 3; k++) d[k] = place->x[k] - of[k];
    for (int i = 0; i < 3; i++) {
        dermis_lanes along = of[AXES + 3 * i] * d[0] + of[AXES + 3 * i + 1] * d[1] + of[AXES + 3 * i + 2] * d[2];
        dermis_lanes over = (dermis_lanes)((dermis_bits)along & magnitude) - of[HALF + i] - place->give;
        over = (dermis_lanes)((dermis_bits)over & (over > none));
        square += over * over;
    }
    *(dermis_lanes *)squares = square;
}

/* A plane in the tree's units; each number is in all lanes. */
typedef struct {
    dermis_lanes normal[3]; /* unit vector */
    dermis_lanes level;     /* coordinate of the plane along it, less the bound of the rounding error */
} dermis_level;

/* Convert a plane to the tree's units: unit normal, and coordinate along it [m] (4). */
static inline void dermis_leveled(const dermis_tree *tree, const double *plane, const dermis_place *place, dermis_level *out) {
    double level = (plane[3] - dermis_dot(plane, tree->middle)) / tree->scale;
    for (int i = 0; i < DERMIS_LANES; i++) {
        for (int k = 0; k < 3; k++) out->normal[k][i] = (float)plane[k];
        out->level[i] = (float)level - 2.0f * place->give[i] - 2.0f * ROUNDED;
    }
}

/* Return for each of four boxes whether it may rise above a plane: all bits of its lane are then set. */
static inline dermis_bits dermis_above(const float *boxes, const dermis_level *plane) {
    const dermis_lanes *of = (const dermis_lanes *)boxes;
    const dermis_bits magnitude = {INT32_MAX, INT32_MAX, INT32_MAX, INT32_MAX};
    dermis_lanes top = plane->normal[0] * of[0] + plane->normal[1] * of[1] + plane->normal[2] * of[2];
    for (int i = 0; i < 3; i++) {
        dermis_lanes along = of[AXES + 3 * i] * plane->normal[0] + of[AXES + 3 * i + 1] * plane->normal[1] + of[AXES + 3 * i + 2] * plane->normal[2];
        top += (dermis_lanes)((dermis_bits)along & magnitude) * of[HALF + i];
    }
    return top > plane->level;
}

/* Return the smaller, or the larger, of two numbers in each lane. */
static inline dermis_lanes dermis_lower(dermis_lanes a, dermis_lanes b, int larger) {
    dermis_bits first = larger ? a > b : a < b;
    return (dermis_lanes)(((dermis_bits)a & first) | ((dermis_bits)b & ~first));
}

/* Return for each of four boxes whether a ray from a point may meet it: all bits of its lane are then set.

   way: direction of the ray, each component in all lanes. */
static inline dermis_bits dermis_pierced(const float *boxes, const dermis_place *place, const dermis_lanes *way) {
    const dermis_lanes *of = (const dermis_lanes *)boxes;
    dermis_lanes from = {0.0f, 0.0f, 0.0f, 0.0f}, to = from + NOWHERE, least = from + LEVEL;
    dermis_bits filled = of[HALF] >= from; /* an empty box is never met */
    for (int i = 0; i < 3; i++) {
        dermis_lanes off = from - from, along = off;
        for (int k = 0; k < 3; k++) {
            off += of[AXES + 3 * i + k] * (place->x[k] - of[k]);
            along += of[AXES + 3 * i + k] * way[k];
        }
        dermis_bits level = along * along < least * least; /* the ray is parallel to the faces across this axis */
        along = (dermis_lanes)(((dermis_bits)along & ~level) | ((dermis_bits)least & level));
        dermis_lanes half = of[HALF + i] + place->give, in = (-half - off) / along, out = (half - off) / along;
        from = dermis_lower(from, dermis_lower(in, out, 0), 1);
        to = dermis_lower(to, dermis_lower(in, out, 1), 0);
    }
    return filled & (from <= to);
}

#endif
