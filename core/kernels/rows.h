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

static inline int any(const double *force) { return force[0] != 0.0 || force[1] != 0.0 || force[2] != 0.0; }

/* Changes of the forces that the images of points with a higher number (later) or with a lower one (earlier) do not contain
   yet (count, 3).

   A sweep visits the points in ascending order, the next one in descending order. A change is needed by the points that the
   sweep still visits, and by the others only in the next sweep. So each sweep needs only half of the compliance. */
typedef struct {
    double *later, *earlier;
} felt;

/* Let the points that the sweep still visits move by a change of the force on a point i, and itself. back: 1 in the second
   sweep of a pair. */
static void pass_on(const rows_of *c, int64_t count, int64_t i, const double *change, int back, const felt *lag, double *image) {
    double *send = (back ? lag->earlier : lag->later) + 3 * i;
    if (any(change)) {
        for (int k = 0; k < 3; k++) lag->later[3 * i + k] += change[k], lag->earlier[3 * i + k] += change[k];
        move(c, i, i + 1, i, change, image);
    }
    if (!any(send)) return;
    move(c, back ? 0 : i + 1, back ? i : count, i, send, image);
    for (int k = 0; k < 3; k++) send[k] = 0.0;
}

/* Let all points feel all forces after a pair of sweeps. */
static inline void pass_rest(const rows_of *c, int64_t count, const felt *lag, double *image) {
    for (int64_t i = 0; i < count; i++) {
        const double none[3] = {0.0, 0.0, 0.0};
        pass_on(c, count, i, none, 0, lag, image);
    }
}

#endif
