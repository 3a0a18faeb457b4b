/* The closest point on one triangle.

   A row has 16 numbers. They begin at these positions: 0 corner a; 3 edge ab; 6 edge ac; 9, 10 and 11 squared lengths
   of ab, ac and bc; 12 dot product of ab and ac; 13 reciprocal of the Gram determinant of ab and ac; 14 whether the
   triangle is a sliver; 15 its index in the table. */
#ifndef DERMIS_TRIANGLE_H
#define DERMIS_TRIANGLE_H

#include "kernels.h"
#include "numbers.h"

enum { AB = 3, AC = 6, AB_AB = 9, AC_AC = 10, BC_BC = 11, AB_AC = 12, INVERSE = 13, SLIVER = 14, NUMBER = 15 };

/* A point is measured again if its squared distance is below this share of the squared edges: the first measurement
   compares squared distances, in which half of the digits are lost. */
#define DERMIS_NEAR 1e-12

/* Copy one triangle of the table to a row. */
static inline void dermis_gather(const dermis_tree *tree, int64_t triangle, double *row) {
    for (int k = 0; k < SLIVER; k++) row[k] = tree->rows[k * tree->total + triangle];
    row[SLIVER] = tree->slivers != NULL && tree->slivers[triangle];
    row[NUMBER] = (double)triangle;
}

/* Compute the unit normal of a triangle; return twice its area [m^2]. */
static inline double dermis_facing(const double *row, double *out) {
    dermis_cross(row + AB, row + AC, out);
    double length = dermis_root(dermis_dot(out, out));
    for (int k = 0; k < 3; k++) out[k] /= length;
    return length;
}

/* Compute the weights of corners b and c for a point of the plane, from its dot products with ab and ac, seen from
   corner a. */
static inline void dermis_solved(const double *row, double along_ab, double along_ac, double *u, double *w) {
    *u = (row[AC_AC] * along_ab - row[AB_AC] * along_ac) * row[INVERSE];
    *w = (row[AB_AB] * along_ac - row[AB_AC] * along_ab) * row[INVERSE];
}

/* Compute the vector to the point v from the point with weights u and w; v is relative to corner a. */
static inline void dermis_left(const double *row, const double *v, double u, double w, double *out) {
    for (int k = 0; k < 3; k++) {
        out[k] = v[k] - u * row[AB + k];
        out[k] -= w * row[AC + k];
    }
}

/* Compute the weights of the closest point on the three edges.

   The squared distances are compared without |v|^2, which they have in common. to_ab, to_ac: dot products of v with ab
   and ac, where v is the point relative to corner a. */
static inline void dermis_on_edges(const double *row, double to_ab, double to_ac, double *u, double *w) {
    double from_b = row[AB_AB] - to_ab;
    double to_bc = to_ac + from_b - row[AB_AC];
    double on_ab = dermis_clamped(to_ab / row[AB_AB]);
    double on_ac = dermis_clamped(to_ac / row[AC_AC]);
    double on_bc = dermis_clamped(to_bc / row[BC_BC]);
    double square_ab = (row[AB_AB] * on_ab - 2.0 * to_ab) * on_ab;
    double square_ac = (row[AC_AC] * on_ac - 2.0 * to_ac) * on_ac;
    double square_bc = (row[BC_BC] * on_bc - 2.0 * to_bc) * on_bc + (from_b - to_ab);
    if (square_ab <= dermis_least(square_ac, square_bc)) {
        *u = on_ab, *w = 0.0;
    } else if (square_ac <= square_bc) {
        *u = 0.0, *w = on_ac;
    } else {
        *u = 1.0 - on_bc, *w = on_bc;
    }
}

/* Compute the closest point from the vectors to all edges and to the face; return the squared distance.

   This is more exact than `dermis_on_edges` for slivers and for points close to the triangle. v: the point relative to
   corner a. u, w: in, a first guess of the weights of corners b and c; out, the weights. */
static inline double dermis_measured(const double *row, const double *v, double *u, double *w) {
    double edge[3][3], start[3][3], share[3], square[4], left[3];
    for (int k = 0; k < 3; k++) {
        edge[0][k] = row[AB + k], edge[1][k] = row[AC + k], edge[2][k] = row[AC + k] - row[AB + k];
        start[0][k] = start[1][k] = v[k], start[2][k] = v[k] - row[AB + k];
    }
    for (int i = 0; i < 3; i++)
        share[i] = dermis_clamped(dermis_dot(start[i], edge[i]) / dermis_most(row[AB_AB + i], 1e-300));
    for (int round = 0; round < 2; round++) { /* the part of the vector along the face is the error of the guess */
        double more_u, more_w;
        dermis_left(row, v, *u, *w, left);
        dermis_solved(row, dermis_dot(left, edge[0]), dermis_dot(left, edge[1]), &more_u, &more_w);
        *u += more_u, *w += more_w;
    }
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) left[k] = start[i][k] - share[i] * edge[i][k];
        square[i] = dermis_dot(left, left);
    }
    int best = 0;
    for (int i = 1; i < 3; i++)
        if (square[i] < square[best]) best = i;
    if (dermis_least(*u, *w) > 0.0 && *u + *w < 1.0) {
        dermis_left(row, v, *u, *w, left);
        square[3] = dermis_dot(left, left);
        if (square[3] < square[best]) return square[3];
    }
    *u = best == 0 ? share[0] : best == 1 ? 0.0 : 1.0 - share[2];
    *w = best == 0 ? 0.0 : best == 1 ? share[1] : share[2];
    return square[best];
}

/* Return the squared distance of a point to a triangle, and the weights of corners b and c at the closest point.

   On an edge, the weight of the opposite corner is exactly 0, or u and w sum to 1, so the weights show the feature. */
static inline double dermis_on_triangle(const double *row, const double *x, double *u, double *w) {
    double v[3] = {x[0] - row[0], x[1] - row[1], x[2] - row[2]}, left[3];
    double to_ab = dermis_dot(v, row + AB), to_ac = dermis_dot(v, row + AC);
    dermis_solved(row, to_ab, to_ac, u, w);
    if (dermis_least(dermis_least(*u, *w), 1.0 - *u - *w) < 0.0) dermis_on_edges(row, to_ab, to_ac, u, w);
    if (row[SLIVER] != 0.0) dermis_measured(row, v, u, w);
    dermis_left(row, v, *u, *w, left);
    double square = dermis_dot(left, left);
    if (square < DERMIS_NEAR * (row[AB_AB] + row[AC_AC])) square = dermis_measured(row, v, u, w);
    return square;
}

#endif
