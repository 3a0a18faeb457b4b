/* Intersections of lines with triangles, and winding numbers. For the library's own files only. */
#ifndef DERMIS_RAYS_H
#define DERMIS_RAYS_H

#include "kernels.h"
#include "numbers.h"
#include "triangle.h"

/* A product differs from 0 if it exceeds this share of the product of its factors' sizes; rounding errors are 16 times
   smaller. */
#define DERMIS_ROUNDING (64.0 * DBL_EPSILON)

enum { DERMIS_MISSED = 0, DERMIS_MET = 1, DERMIS_UNSURE = 2 };

/* Return the size of a vector: the sum of its absolute components. */
static inline double dermis_size(const double *a) { return dermis_abs(a[0]) + dermis_abs(a[1]) + dermis_abs(a[2]); }

/* Return whether a ray from x along `way` passes through a triangle: DERMIS_MISSED, DERMIS_MET, or DERMIS_UNSURE if
   rounding could change the result. Moeller and Trumbore 1997.

   apart: possible error of the corners [m]. along: out, dot product of `way` and the triangle's normal (of any length),
   above 0 if the ray leaves by the front. depth: out, dot product of the vector from x to the triangle's plane and that
   normal. */
static inline int dermis_meets(const double *row, const double *x, const double *way, double apart, double *along, double *depth) {
    double normal[3], offset[3], turned[3];
    for (int k = 0; k < 3; k++) offset[k] = x[k] - row[k];
    dermis_cross(row + AB, row + AC, normal);
    dermis_cross(offset, way, turned);
    *along = dermis_dot(way, normal), *depth = -dermis_dot(offset, normal);
    double sign = *along < 0.0 ? -1.0 : 1.0, near = DERMIS_ROUNDING * dermis_size(offset) + apart;
    double b = -sign * dermis_dot(turned, row + AC), c = sign * dermis_dot(turned, row + AB), a = sign * *along - b - c;
    double slack = near * dermis_size(way) * (dermis_size(row + AB) + dermis_size(row + AC)), thick = near * dermis_size(normal);
    if (a < -slack || b < -slack || c < -slack || sign * *depth < -thick) return DERMIS_MISSED;
    return a <= slack || b <= slack || c <= slack || sign * *depth <= thick ? DERMIS_UNSURE : DERMIS_MET;
}

/* Compute the winding number of a closed body's triangles around a point x [m]; return 0 if every ray was uncertain.

   without: index of a triangle that contains the point; the winding number just behind the triangle is then computed.
   -1 for none. */
int dermis_winding(const dermis_body *body, const double *x, int64_t without, int64_t *winding);

#endif
