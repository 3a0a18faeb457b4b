/* Displacement for a force on one point, added to an image. For the library's own files only. */
#ifndef DERMIS_ROWS_H
#define DERMIS_ROWS_H

#include "kernels.h"

/* Add three rows, each multiplied by a component of the force f, to an image.

   The sums and their order are the same in registers of any width. */
static inline __attribute__((always_inline)) void add_rows(int64_t size, const float *restrict a, int64_t stride, const double *f, double *restrict image) {
    const float *restrict b = a + stride, *restrict d = b + stride;
    double x = f[0], y = f[1], z = f[2];
    for (int64_t k = 0; k < size; k++) image[k] += (x * (double)a[k] + y * (double)b[k]) + z * (double)d[k];
}

/* Copy the three numbers of each of some points from a row; return the end of the copies. */
static inline float *gather_row(const float *row, const int64_t *points, int64_t count, float *out) {
    for (int64_t j = 0; j < count; j++, out += 3) __builtin_memcpy(out, row + 3 * points[j], 3 * sizeof(float));
    return out;
}

#if defined(__x86_64__)
__attribute__((target("avx2"), noinline)) static void add_rows_avx2(int64_t size, const float *a, int64_t stride, const double *f, double *image) {
    add_rows(size, a, stride, f, image);
}
#else
#define add_rows_avx2 add_rows
#endif

/* A compliance in single or double precision; the other pointer is null. */
typedef struct {
    const float *narrow;
    const double *wide;
    int64_t stride; /* numbers from the start of one row to the start of the next */
    int64_t avx2;   /* 1: use AVX2, for floats only: with doubles, memory limits the speed */
} rows_of;

/* Add the displacement of the points `from` to `to` for a force on one point to the image of all. */
static void move(const rows_of *c, int64_t from, int64_t to, int64_t point, const double *force, double *image) {
    int64_t first = 3 * point * c->stride + 3 * from, size = 3 * (to - from);
    image += 3 * from;
    if (c->narrow != NULL && c->avx2) {
        add_rows_avx2(size, c->narrow + first, c->stride, force, image);
    } else if (c->narrow != NULL) {
        add_rows(size, c->narrow + first, c->stride, force, image);
    } else {
        const double *a = c->wide + first, *b = a + c->stride, *d = b + c->stride;
        for (int64_t k = 0; k < size; k++) image[k] += (force[0] * a[k] + force[1] * b[k]) + force[2] * d[k];
    }
}

#endif
