/* Straight ways through triangles. For the library's own files. */
#ifndef DERMIS_RAYS_H
#define DERMIS_RAYS_H

#include "kernels.h"
#include "numbers.h"
#include "triangle.h"

/* Products are told from 0 where they exceed this share of their factors: rounding is 16 times smaller. */
#define DERMIS_ROUNDING (64.0 * DBL_EPSILON)

enum { DERMIS_MISSED = 0, DERMIS_MET = 1, DERMIS_UNSURE = 2 };

static inline double dermis_size(const double *a) { return dermis_abs(a[0]) + dermis_abs(a[1]) + dermis_abs(a[2]); }

/* Tell whether a line from x along `way` passes through a triangle, ahead of x or at it. Moeller and Trumbore 1997.

   apart: by how much corners of triangles may be off [m]. along: out, way times the triangle's normal, above 0 where the
   line leaves by the front; depth: out, the same of the way to the triangle's plane. */
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

/* Count how often a closed body's triangles wind round a point; return 0 where no ray that was tried tells.

   without: the number of a triangle that the point lies on, whose back is then asked for; -1 for none. */
int dermis_winding(const dermis_body *body, const double *x, int64_t without, int64_t *winding);

#endif
