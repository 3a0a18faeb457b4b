/* Products of vectors of three, in one fixed order of operations; square roots and the like without a C library. */
#ifndef DERMIS_NUMBERS_H
#define DERMIS_NUMBERS_H

#include <float.h>
#include <stdint.h>

static inline double dermis_root(double x) { return __builtin_sqrt(x); }

static inline double dermis_abs(double x) { return __builtin_fabs(x); }

static inline int dermis_finite(double x) { return dermis_abs(x) <= DBL_MAX; }

static inline double dermis_least(double a, double b) { return a < b ? a : b; }

static inline double dermis_most(double a, double b) { return a > b ? a : b; }

static inline double dermis_clamped(double t) { return t < 0.0 ? 0.0 : t > 1.0 ? 1.0 : t; }

static inline double dermis_dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline void dermis_cross(const double *a, const double *b, double *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

#endif
