/* Boxes in single precision, four at once: how far a point is from each of them at least.

   Of four boxes there are, four numbers each: the middle (0 to 2), the axes (3 to 11), and half the size along them (12 to 14),
   in units of the tree's scale about its middle. They are bounds: rounding makes them too small, never too large. */
#ifndef DERMIS_BOXES_H
#define DERMIS_BOXES_H

#include "kernels.h"
#include "numbers.h"

typedef float dermis_lanes __attribute__((vector_size(4 * DERMIS_LANES), aligned(4), may_alias));
typedef int32_t dermis_bits __attribute__((vector_size(4 * DERMIS_LANES), aligned(4), may_alias));

enum { AXES = 3, HALF = 12 };

/* Rounding of a distance in the tree's units, as a share of the way to the middle and of the tree's size: places, axes and
   ten operations in single precision round by 2^-24 of it each. */
#define ROUNDED 2e-6f
/* Farther than this in the tree's units single precision tells nothing; so far away is the box of nothing. */
#define FARTHEST 1e15
#define NOWHERE 1e18f
/* A ray that moves by less than this along an axis, over its length, is parallel to the box there. */
#define LEVEL 1e-19f

typedef struct {
    dermis_lanes x[3]; /* of the point */
    dermis_lanes give; /* rounding of its distances */
} dermis_place;

/* Put a point into the tree's units; return 0 where it is too far away for bounds. */
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

/* Return the squared limit of bounds for a squared distance [m^2]: triangles equally close but for rounding are within. */
static inline float dermis_limit(const dermis_tree *tree, double square) {
    double limit = square / (tree->scale * tree->scale) * (1.0 + 1e-5);
    return limit < FARTHEST * FARTHEST ? (float)limit : __builtin_inff();
}

/* Return lower bounds of the squared distances to four boxes. */
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

/* Return the smaller, or the larger, of two numbers in each lane. */
static inline dermis_lanes dermis_lower(dermis_lanes a, dermis_lanes b, int larger) {
    dermis_bits first = larger ? a > b : a < b;
    return (dermis_lanes)(((dermis_bits)a & first) | ((dermis_bits)b & ~first));
}

/* Tell which of four boxes a ray from a place may meet: bits that are set, lane by lane.

   way: the ray's direction, each number in all lanes. */
static inline dermis_bits dermis_pierced(const float *boxes, const dermis_place *place, const dermis_lanes *way) {
    const dermis_lanes *of = (const dermis_lanes *)boxes;
    dermis_lanes from = {0.0f, 0.0f, 0.0f, 0.0f}, to = from + NOWHERE, least = from + LEVEL;
    dermis_bits filled = of[HALF] >= from; /* not those of nothing */
    for (int i = 0; i < 3; i++) {
        dermis_lanes off = from - from, along = off;
        for (int k = 0; k < 3; k++) {
            off += of[AXES + 3 * i + k] * (place->x[k] - of[k]);
            along += of[AXES + 3 * i + k] * way[k];
        }
        dermis_bits level = along * along < least * least; /* the box is as good as parallel there */
        along = (dermis_lanes)(((dermis_bits)along & ~level) | ((dermis_bits)least & level));
        dermis_lanes half = of[HALF + i] + place->give, in = (-half - off) / along, out = (half - off) / along;
        from = dermis_lower(from, dermis_lower(in, out, 0), 1);
        to = dermis_lower(to, dermis_lower(in, out, 1), 0);
    }
    return filled & (from <= to);
}

#endif
