/* Products of vectors with three components, with a fixed order of operations, and functions of numbers without a C
   library. */
#ifndef DERMIS_NUMBERS_H
#define DERMIS_NUMBERS_H

#include <float.h>
#include <stdint.h>

static inline double dermis_root(double x) { return __builtin_sqrt(x); }

static inline double dermis_abs(double x) { return __builtin_fabs(x); }

static inline int dermis_finite(double x) { return dermis_abs(x) <= DBL_MAX; }

/* Whether all of some numbers are finite. */
static inline int dermis_all_finite(const double *values, int64_t count) {
    for (int64_t k = 0; k < count; k++)
        if (!dermis_finite(values[k])) return 0;
    return 1;
}

static inline double dermis_least(double a, double b) { return a < b ? a : b; }

static inline double dermis_most(double a, double b) { return a > b ? a : b; }

static inline double dermis_clamped(double t) { return t < 0.0 ? 0.0 : t > 1.0 ? 1.0 : t; }

static inline double dermis_dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* The same, summed in the order of NumPy's einsum. Earlier versions used einsum; the results are still the same bits. */
static inline double dermis_einsum(const double *a, const double *b) { return a[0] * b[0] + a[2] * b[2] + a[1] * b[1]; }

static inline void dermis_cross(const double *a, const double *b, double *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

#define PI 3.14159265358979323846

/* Return the angle, 0 to pi [rad], from multiples of its sine and cosine with the same factor; the sine is at least 0.

   The angle is halved until its tangent is at most 0.1. Eight terms of the series of the arc tangent then have a
   relative error of up to 6e-18. */
static inline double dermis_angle(double sine, double cosine) {
    double size = dermis_root(sine * sine + cosine * cosine), t = cosine > 0.0 ? sine / (size + cosine) : (size - cosine) / sine;
    double times = 2.0, square, sum = 0.0;
    for (; t > 0.1; times *= 2.0) t = t / (1.0 + dermis_root(1.0 + t * t));
    square = t * t;
    for (int n = 8; n--;) sum = 1.0 / (2 * n + 1) - square * sum;
    return times * t * sum;
}

/* Compute sine and cosine of an angle from -pi/2 to pi/2 [rad].

   The series are those of half the angle, with nine terms each; the tenth is below 3e-18. */
static inline void dermis_turn(double angle, double *sine, double *cosine) {
    double half = 0.5 * angle, square = half * half, s = 0.0, c = 0.0;
    for (int n = 9; n--;) s = 1.0 - square * s / ((2 * n + 2) * (2 * n + 3)), c = 1.0 - square * c / ((2 * n + 1) * (2 * n + 2));
    *sine = 2.0 * (half * s) * c;
    *cosine = 1.0 - 2.0 * (half * s) * (half * s);
}

/* Return the natural logarithm of a number above zero.

   x = 2^e m with m from 0.707 to 1.414, and log m = 2 artanh(f) with f = (m - 1) / (m + 1), |f| <= 0.172. Eleven terms
   of the series then have an error of up to 2e-18. */
static inline double dermis_log(double x) {
    union {
        double number;
        uint64_t bits;
    } of = {x};
    int64_t exponent = 0;
    if (x < DBL_MIN) of.number = x * 18014398509481984.0, exponent = -54; /* 2^54, since x may be denormal */
    exponent += (int64_t)(of.bits >> 52) - 1022;
    of.bits = (of.bits & 0xfffffffffffffu) | 0x3fe0000000000000u; /* m in 0.5 to 1 */
    if (of.number < 0.70710678118654752) of.number *= 2.0, exponent--;
    double f = (of.number - 1.0) / (of.number + 1.0), square = f * f, sum = 0.0;
    for (int n = 11; n--;) sum = 1.0 / (2 * n + 1) + square * sum;
    return (double)exponent * 0.69314718055994531 + 2.0 * f * sum;
}

#endif
