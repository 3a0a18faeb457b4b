/* The signed distance to a body and its unit gradient. For the library's own files only.

   Call the functions between `dermis_enter` and `dermis_leave`: they need rounding to nearest, and denormal numbers. */
#ifndef DERMIS_DISTANCE_H
#define DERMIS_DISTANCE_H

#include "kernels.h"

typedef struct {
    double gap;        /* signed distance, negative inside; infinite beyond the limit [m] */
    double normal[3];  /* unit gradient of the gap; on the surface, normal of the face, edge or corner; 0 beyond the
                          limit */
    double point[3];   /* closest point of the body [m]; not set beyond the limit */
    double weights[3]; /* barycentric weights of the closest point in its triangle; not set beyond the limit */
    int64_t triangle;  /* index of the closest triangle, -1 beyond the limit */
    int64_t slot;      /* its slot, where the slots of the solids are numbered one solid after the other; -1 beyond the
                          limit; a hint for a point nearby */
    int feature;       /* 0 within the face, 1 + k on edge k (corner k to k + 1), 4 + k on corner k; not set beyond the
                          limit */
    int beside;        /* 1 if the point lies beyond the rim of an open sheet, outside on both sides; not set beyond the
                          limit */
} dermis_distance;

/* Measure the signed distance of one point to a body that `dermis_body_fit` has checked.

   If the body consists of several solids, the smallest of their signed distances is taken. Outside, this is the
   distance to the union of the solids. Inside, it is the depth in the solid in which the point is deepest, so the depth
   in the union is as large or larger.

   x: the point, finite [m]. limit: largest distance outside that is measured, may be infinite [m]; points inside a
   closed body are found at any depth. hint: `slot` of the result for a point nearby, or -1; it affects only the run
   time. */
void dermis_signed_distance(const dermis_body *body, const double *x, double limit, int64_t hint, dermis_distance *out);

/* Whether a point is so far outside the box of a solid that all its triangles are farther away than the limit [m]. */
int dermis_beyond(const dermis_body *body, const double *x, double limit);

/* Refuse triangles whose area has no finite square above zero; `wrong` is then -1 - index of the triangle. With a tree,
   `dermis_tree_fit` has refused them already. */
int32_t dermis_known_triangles(const dermis_body *body, int64_t *wrong);

/* Whether the counts in the records of a body and its trees have possible values. */
int dermis_sound_body(const dermis_body *body);

#endif
