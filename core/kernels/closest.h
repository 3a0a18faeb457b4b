/* The closest triangle of a point: for the library's own files. */
#ifndef DERMIS_CLOSEST_H
#define DERMIS_CLOSEST_H

#include "kernels.h"

typedef struct {
    double weights[3];      /* of the triangle's corners at the closest point */
    double point[3];        /* the closest point [m] */
    int64_t slot;           /* of the triangle in the tree */
    int feature;            /* 0 within the face, 1 + k on edge k (k to k + 1), 4 + k on corner k */
    double row[DERMIS_ROW]; /* the triangle; see triangle.h */
} dermis_closest_point;

/* Find the closest triangle of a point [m] that is no farther than a limit [m]; return 0 where there is none.

   A tree without `packed` is searched by looking at every triangle. The hint is a slot whose triangle is likely near, or -1;
   it changes the time alone. */
int dermis_find_closest(const dermis_tree *tree, const double *x, double limit, int64_t hint, dermis_closest_point *out);

/* Whether all triangles that are no farther from a point than a radius [m] lie in a plane and face along its unit normal.

   plane: the normal, and how far the plane is along that [m]. */
int dermis_only_plane(const dermis_tree *tree, const double *x, double radius, const double *plane);

#endif
