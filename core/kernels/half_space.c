/* Displacement of pieces of skin for forces on other pieces: the half-space of Boussinesq, Cerruti and Love, for E = 1.

   For each pair of pieces, the half-space has their mean normal, and the distance is the chord between their centres. A
   pair far apart is treated as two points. For a near pair, the force is spread evenly over the larger piece, or the
   displacement is averaged over it; both are the same integral. Johnson, Contact Mechanics, chapter 3; Love, Phil.
   Trans. A 228 (1929). */
#include "float_environment.h"
#include "kernels.h"
#include "numbers.h"

/* Pieces are near each other if their distance is below this many times the side of the larger one, the root of its
   area. */
#define NEAR 2.0
/* Areas are equal if they differ by less than this share. The direction of the chord then decides which piece counts as
   the larger, so that the choice is the same if the two are exchanged. */
#define TIE 1e-9
/* [m] A length that replaces zero in divisions and logarithms; the terms in which it occurs are then zero. */
#define TINY 1e-30

/* Compute the displacement of a point for unit forces that are spread evenly over a rectangle, out (3, 3) [1/m].

   chord: vector from the rectangle's centre to the point (3) [m]. normal: unit normal of the half-space (3). sides:
   side vectors of the rectangle (2, 3) [m]. The integrals over the rectangle are sums over its four corners. */
static void rectangle(const double *chord, const double *normal, const double *sides, double poisson, double *out) {
    double axes[2][3], half[2], along[2], off = dermis_dot(sides, normal), sum[5] = {0.0, 0.0, 0.0, 0.0, 0.0};
    for (int k = 0; k < 3; k++) axes[0][k] = sides[k] - off * normal[k];
    double length = dermis_root(dermis_dot(axes[0], axes[0]));
    for (int k = 0; k < 3; k++) axes[0][k] /= length;
    dermis_cross(normal, axes[0], axes[1]);
    half[0] = 0.5 * length, half[1] = 0.5 * dermis_abs(dermis_dot(axes[1], sides + 3));
    for (int k = 0; k < 2; k++) along[k] = dermis_dot(chord, axes[k]);
    for (int corner = 0; corner < 4; corner++) {
        double sign = corner == 0 || corner == 3 ? 1.0 : -1.0;
        double s = along[0] + (corner & 2 ? -half[0] : half[0]), t = along[1] + (corner & 1 ? -half[1] : half[1]);
        double far = dermis_abs(s), wide = dermis_abs(t), r = dermis_root(s * s + t * t);
        double size = dermis_most(far, TINY), other = dermis_most(wide, TINY), log_r = dermis_log(dermis_most(r, TINY));
        double turn = dermis_angle(wide, size); /* arc tangent of |t / s| */
        double rest = dermis_angle(far, other);
        sum[0] += sign * t * (s < 0.0 ? -1.0 : 1.0) * dermis_log(dermis_most(far + r, other) / other); /* s^2 / r^3 */
        sum[1] += sign * s * (t < 0.0 ? -1.0 : 1.0) * dermis_log(dermis_most(wide + r, size) / size);  /* t^2 / r^3 */
        sum[2] -= sign * r;                                                                            /* s t / r^3 */
        sum[3] += sign * (t * log_r + size * (t < 0.0 ? -turn : turn));                                /* s / r^2 */
        sum[4] += sign * (s * log_r + other * (s < 0.0 ? -rest : rest));                               /* t / r^2 */
    }
    double even[2][3], odd[3], scale = (1.0 + poisson) / (4.0 * PI * half[0] * half[1]);
    for (int k = 0; k < 3; k++) {
        even[0][k] = sum[0] * axes[0][k] + sum[2] * axes[1][k];
        even[1][k] = sum[2] * axes[0][k] + sum[1] * axes[1][k];
        odd[k] = sum[3] * axes[0][k] + sum[4] * axes[1][k];
    }
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) {
            double one = poisson * (even[0][a] * axes[0][b] + even[1][a] * axes[1][b]);
            one += (0.5 - poisson) * (odd[a] * normal[b] - odd[b] * normal[a]);
            if (a == b) one += (1.0 - poisson) * (sum[0] + sum[1]);
            out[3 * a + b] = scale * one;
        }
}

/* Compute the displacement of piece i of the field for unit forces on piece j of the source, out (3, 3) [1/m]. */
static void between(const dermis_pieces *of, int64_t i, int64_t j, double *out) {
    const dermis_patches *field = of->field, *source = of->source;
    const double *one = field->normals + 3 * i, *other = source->normals + 3 * j;
    double chord[3], normal[3], scale = 1.0 / dermis_root(dermis_most(2.0 + 2.0 * dermis_dot(one, other), 1e-6));
    for (int k = 0; k < 3; k++) {
        chord[k] = field->positions[3 * i + k] - source->positions[3 * j + k];
        normal[k] = scale * (one[k] + other[k]);
    }
    double r2 = dermis_dot(chord, chord);
    if (r2 < NEAR * NEAR * dermis_most(field->areas[i], source->areas[j])) {
        double ratio = field->areas[i] / source->areas[j] - 1.0;
        if (dermis_abs(ratio) < TIE) ratio = chord[0] + 1.41 * chord[1] + 1.73 * chord[2];
        rectangle(chord, normal, ratio > 0.0 ? field->sides + 6 * i : source->sides + 6 * j, of->poisson, out);
        return;
    }
    double inverse = 1.0 / dermis_root(r2), strength = (1.0 + of->poisson) / PI * inverse;
    double even = of->poisson * strength, odd = (0.5 - of->poisson) * strength;
    for (int k = 0; k < 3; k++) chord[k] *= inverse;
    for (int a = 0; a < 3; a++) {
        out[4 * a] = even * chord[a] * chord[a] + (1.0 - of->poisson) * strength;
        for (int b = 0; b < a; b++) {
            double symmetric = even * chord[a] * chord[b], turning = odd * (chord[a] * normal[b] - chord[b] * normal[a]);
            out[3 * a + b] = symmetric + turning, out[3 * b + a] = symmetric - turning;
        }
    }
}

DERMIS_NOINLINE static int32_t press(dermis_pieces *of) {
    for (int64_t i = 0; i < of->field->count; i++)
        for (int64_t j = 0; j < of->source->count; j++) {
            double one[9];
            between(of, i, j, one);
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++) {
                    int64_t at = ((3 * i + a) * of->source->count + j) * 3 + b;
                    if (of->single)
                        ((float *)of->out)[at] = (float)one[3 * a + b];
                    else
                        ((double *)of->out)[at] = one[3 * a + b];
                }
        }
    return DERMIS_DONE;
}

static int sound(const dermis_pieces *of) {
    return of->field != NULL && of->source != NULL && of->field->count >= 0 && of->source->count >= 0 && (of->single == 0 || of->single == 1);
}

DERMIS_FUNCTION(dermis_press_pieces, dermis_pieces, sound, press)
