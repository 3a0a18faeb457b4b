/* The signed distance to a body and its unit gradient: for the library's own files.

   Rounding must be to nearest and denormal numbers kept: call it between `dermis_enter` and `dermis_leave`. */
#ifndef DERMIS_DISTANCE_H
#define DERMIS_DISTANCE_H

#include "kernels.h"

typedef struct {
    double gap;        /* signed distance, negative inside; infinite beyond the limit [m] */
    double normal[3];  /* unit gradient of the gap; the face's, edge's or corner's normal where the distance is all but 0 */
    double point[3];   /* the closest point [m]; not set beyond the limit, nor is what follows but for triangle and slot */
    double weights[3]; /* of the triangle's corners at the closest point */
    int64_t triangle;  /* the closest, -1 beyond the limit */
    int64_t slot;      /* of the triangle in the trees, one after the other, -1 beyond the limit: a hint for a point nearby */
    int feature;       /* 0 within the face, 1 + k on edge k (k to k + 1), 4 + k on corner k */
    int beside;        /* 1 where the point has passed beside the rim of an open sheet: it is outside of either side */
} dermis_distance;

/* Measure the signed distance of one point to a body that `dermis_body_fit` has checked, solid by solid.

   Of several solids it is the smallest: right outside, and inside no deeper than it is in one of them.

   x: finite [m]. limit: the largest distance of interest outside, may be infinite [m]; points inside a closed body are always
   answered. hint: `slot` of an answer nearby, such as that of the frame before, or -1; it changes the time alone. */
void dermis_signed_distance(const dermis_body *body, const double *x, double limit, int64_t hint, dermis_distance *out);

/* Whether a body's record can be one. */
int dermis_sound_body(const dermis_body *body);

#endif
