/* Anderson's acceleration of sweeps over contact forces (Walker and Ni, SIAM J. Numer. Anal. 49, 2011). For the library's
   own files only. */
#ifndef DERMIS_ANDERSON_H
#define DERMIS_ANDERSON_H

#include "kernels.h"
#include "numbers.h"

/* This share of the trace is added to the diagonal of the least-squares matrix for Anderson's weights. Otherwise the
   matrix is nearly singular if two pairs of sweeps changed the forces in nearly the same way. */
#define APART 1e-10
/* With much friction, acceleration may go round in circles. After more than PATIENCE pairs of sweeps without a smaller
   change than before, ALONE pairs are done without acceleration. */
#define PATIENCE 20
#define ALONE 100
/* If the squared change of the forces grew by more than this factor, the earlier pairs of sweeps are discarded. */
#define ASTRAY 4.0

/* History of the last pairs of sweeps. */
typedef struct {
    int64_t size;    /* 3 count */
    int kept;        /* number of earlier pairs in the store */
    double *store;   /* for each pair: the force, the image and `later` after it, and the change of the force in it
                        (DERMIS_KEPT + 1, 4, size) */
    double last;     /* square of the last change */
} past;

/* Return a vector of pair number `which`: its force for `what` = 0, its image for 1, its change for 2, `later` for 3. */
static double *told(const past *known, int which, int what) { return known->store + (4 * (int64_t)which + what) * known->size; }

/* Find the weights for which now - sum_a weight_a (now - change_a) is smallest: least squares by Cholesky
   factorisation.

   now: change of the last pair. right: out, the weights of the earlier pairs (kept). */
static void weigh(const past *known, const double *now, double *right) {
    double matrix[DERMIS_KEPT][DERMIS_KEPT], trace = 0.0;
    int m = known->kept;
    for (int a = 0; a < m; a++) {
        const double *ra = told(known, a, 2);
        right[a] = 0.0;
        for (int64_t k = 0; k < known->size; k++) right[a] += (now[k] - ra[k]) * now[k];
        for (int b = 0; b <= a; b++) {
            const double *rb = told(known, b, 2);
            matrix[a][b] = 0.0;
            for (int64_t k = 0; k < known->size; k++) matrix[a][b] += (now[k] - ra[k]) * (now[k] - rb[k]);
        }
        trace += matrix[a][a];
    }
    for (int a = 0; a < m; a++) {
        matrix[a][a] += APART * trace + DBL_MIN;
        for (int b = 0; b <= a; b++) {
            for (int k = 0; k < b; k++) matrix[a][b] -= matrix[a][k] * matrix[b][k];
            matrix[a][b] = a == b ? dermis_root(dermis_most(matrix[a][b], DBL_MIN)) : matrix[a][b] / matrix[b][b];
        }
        for (int k = 0; k < a; k++) right[a] -= matrix[a][k] * right[k];
        right[a] /= matrix[a][a];
    }
    for (int a = m - 1; a >= 0; a--) {
        for (int k = a + 1; k < m; k++) right[a] -= matrix[k][a] * right[k];
        right[a] /= matrix[a][a];
    }
}

/* Combine the last pairs of sweeps such that their changes cancel best.

   force, image, later: after the last pair, replaced by the combination (size); see felt.h. before: forces before
   it (size). */
static void accelerate(double *force, double *image, double *later, past *known, const double *before) {
    int64_t size = known->size;
    double square = 0.0;
    int m = known->kept;
    double *now[4] = {told(known, m, 0), told(known, m, 1), told(known, m, 2), told(known, m, 3)};
    for (int64_t k = 0; k < size; k++) {
        now[0][k] = force[k], now[1][k] = image[k], now[2][k] = force[k] - before[k], now[3][k] = later[k];
        square += now[2][k] * now[2][k];
    }
    if (m > 0 && square > ASTRAY * known->last) { /* keep only the last pair as history */
        for (int what = 0; what < 4; what++)
            for (int64_t k = 0; k < size; k++) told(known, 0, what)[k] = now[what][k];
        known->kept = 1, known->last = square;
        return;
    }
    known->last = square;
    double right[DERMIS_KEPT];
    weigh(known, now[2], right);
    for (int a = 0; a < m; a++) {
        const double *fa = told(known, a, 0), *ua = told(known, a, 1), *la = told(known, a, 3);
        for (int64_t k = 0; k < size; k++) {
            force[k] -= right[a] * (now[0][k] - fa[k]);
            image[k] -= right[a] * (now[1][k] - ua[k]);
            later[k] -= right[a] * (now[3][k] - la[k]);
        }
    }
    if (m < DERMIS_KEPT) {
        known->kept++;
        return;
    }
    for (int a = 0; a < m; a++)
        for (int what = 0; what < 4; what++)
            for (int64_t k = 0; k < size; k++) told(known, a, what)[k] = told(known, a + 1, what)[k];
}

#endif
