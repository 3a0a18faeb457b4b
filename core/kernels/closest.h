/* The closest triangle of a point. For the library's own files only. */
#ifndef DERMIS_CLOSEST_H
#define DERMIS_CLOSEST_H

#include "kernels.h"

typedef struct {
    double weights[3];      /* barycentric weights of the closest point in the triangle */
    double point[3];        /* the closest point [m] */
    int64_t slot;           /* slot of the triangle in the tree */
    int feature;            /* 0 within the face, 1 + k on edge k (corner k to k + 1), 4 + k on corner k */
    double row[DERMIS_ROW]; /* data of the triangle, see triangle.h */
} dermis_closest_point;

/* Find the closest triangle of a point x [m]; return 1, or 0 if none is within the limit [m].

   If `packed` of the tree is null, all triangles are examined. hint: slot of a triangle that is likely near, or -1; it
   affects only the run time. */
int dermis_find_closest(const dermis_tree *tree, const double *x, double limit, int64_t hint, dermis_closest_point *out);

/* Return how far a triangle rises above the plane of another one that is near it, at most [m]; infinite for a body that is
   not convex.

   facing: out, see `dermis_convex`; not complete if the result is infinite. */
double dermis_bulge(const dermis_tree *tree, double *facing);

/* Find the closest triangle of a point on a convex body, as `dermis_find_closest` does; return -1 if it is not decided.

   slot: in, where the walk begins, or -1; out, where it ended, or -1. */
int dermis_walk_to_closest(const dermis_tree *tree, const dermis_convex *convex, const double *x, double limit, int64_t *slot, dermis_closest_point *out);

/* Function that is called with the row of a triangle, see triangle.h. It returns the squared radius of the rest of
   the search [m^2], which may only fall, or a negative number to end it. */
typedef double dermis_visitor(void *state, const double *row);

/* Call a function for all triangles within a radius [m] of a point x [m] that rise above a plane, and some that are
   farther.

   plane: unit normal, and coordinate of the plane along it [m] (4); null: for all triangles. */
void dermis_visit(const dermis_tree *tree, const double *x, double radius, const double *plane, dermis_visitor *visitor, void *state);

/* Whether all triangles within a radius [m] of a point x [m] lie in a given plane and face along its normal.

   It is also 0 if this cannot be determined: without a tree, or if the point is too far away.
   plane: unit normal, and coordinate of the plane along it [m] (4). */
int dermis_only_plane(const dermis_tree *tree, const double *x, double radius, const double *plane);

#endif
