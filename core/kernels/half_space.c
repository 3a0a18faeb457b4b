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

/* Return asinh(x1 / |y|) - asinh(x0 / |y|) for x1 >= x0; r0 and r1 are the roots of x^2 + y^2. */
static double grown(const double *x, double y, double r0, double r1) {
    double other = dermis_most(dermis_abs(y), TINY);
    double low = dermis_most(dermis_abs(x[0]) + r0, other), high = dermis_most(dermis_abs(x[1]) + r1, other);
    return dermis_log(x[0] >= 0.0 ? high / low : x[1] < 0.0 ? low / high : (low / other) * (high / other));
}

/* Return |y| (atan(x1 / |y|) - atan(x0 / |y|)) for x1 >= x0. */
static double turned(const double *x, double y) {
    double other = dermis_most(dermis_abs(y), TINY);
    return other * dermis_angle(other * (x[1] - x[0]), other * other + x[0] * x[1]);
}

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
    double s[2] = {along[0] - half[0], along[0] + half[0]}, t[2] = {along[1] - half[1], along[1] + half[1]};
    double r[2][2], log_r[2][2]; /* of the corner with s[i] and t[j] */
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++) r[i][j] = dermis_root(s[i] * s[i] + t[j] * t[j]), log_r[i][j] = dermis_log(dermis_most(r[i][j], TINY));
    for (int i = 0; i < 2; i++) {
        double sign = i ? 1.0 : -1.0;
        sum[0] += sign * t[i] * grown(s, t[i], r[0][i], r[1][i]); /* s^2 / r^3 */
        sum[1] += sign * s[i] * grown(t, s[i], r[i][0], r[i][1]); /* t^2 / r^3 */
        sum[2] -= sign * (r[i][1] - r[i][0]);                     /* s t / r^3 */
        sum[3] += sign * (t[i] * (log_r[1][i] - log_r[0][i]) + turned(t, s[i])); /* s / r^2 */
        sum[4] += sign * (s[i] * (log_r[i][1] - log_r[i][0]) + turned(s, t[i])); /* t / r^2 */
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

/* Compute the displacement of a point for unit forces on another one, out (3, 3) [1/m].

   chord: vector from the latter to the former (3) [m]. normal: unit normal of the half-space (3). r2: squared length of
   the chord [m^2]. */
static inline __attribute__((always_inline)) void press_point(const double *chord, const double *normal, double r2, double poisson, double *out) {
    double inverse = 1.0 / dermis_root(r2), strength = (1.0 + poisson) / PI * inverse, way[3];
    double even = poisson * strength, odd = (0.5 - poisson) * strength;
    for (int k = 0; k < 3; k++) way[k] = chord[k] * inverse;
    for (int a = 0; a < 3; a++) {
        out[4 * a] = even * way[a] * way[a] + (1.0 - poisson) * strength;
        for (int b = 0; b < a; b++) {
            double symmetric = even * way[a] * way[b], turning = odd * (way[a] * normal[b] - way[b] * normal[a]);
            out[3 * a + b] = symmetric + turning, out[3 * b + a] = symmetric - turning;
        }
    }
}

/* Compute the displacement of piece i of the field for unit forces on piece j of the source, out (3, 3) [1/m]. */
static void between(const dermis_patches *field, int64_t i, const dermis_patches *source, int64_t j, double poisson, double *out) {
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
        rectangle(chord, normal, ratio > 0.0 ? field->sides + 6 * i : source->sides + 6 * j, poisson, out);
        return;
    }
    press_point(chord, normal, r2, poisson, out);
}

DERMIS_NOINLINE static int32_t press(dermis_pieces *of) {
    for (int64_t i = 0; i < of->field->count; i++)
        for (int64_t j = 0; j < of->source->count; j++) {
            double one[9];
            between(of->field, i, of->source, j, of->poisson, one);
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++) of->out[((3 * i + a) * of->source->count + j) * 3 + b] = one[3 * a + b];
        }
    return DERMIS_DONE;
}

static int sound(const dermis_pieces *of) {
    return of->field != NULL && of->source != NULL && of->field->count >= 0 && of->source->count >= 0;
}

DERMIS_FUNCTION(dermis_press_pieces, dermis_pieces, sound, press)

/* The displacement of one cell for unit forces on `AT_ONCE` others. */
#define AT_ONCE 32
typedef struct {
    double position[3][AT_ONCE], normal[3][AT_ONCE]; /* of the others */
    double apart[AT_ONCE];                           /* squared distance [m^2] */
    float pressed[9][AT_ONCE];                       /* displacement for E = 1 [1/m] */
} few;

/* Compute the displacement of a cell for forces on others as if all were points. */
static inline __attribute__((always_inline)) void press_points(const double *position, const double *normal, double poisson, few *of) {
    for (int j = 0; j < AT_ONCE; j++) {
        double chord[3], mean[3], r2 = 0.0, both = 0.0, out[9];
        for (int k = 0; k < 3; k++) chord[k] = position[k] - of->position[k][j];
        r2 = chord[0] * chord[0] + chord[1] * chord[1] + chord[2] * chord[2];
        both = normal[0] * of->normal[0][j] + normal[1] * of->normal[1][j] + normal[2] * of->normal[2][j];
        double scale = 1.0 / dermis_root(dermis_most(2.0 + 2.0 * both, 1e-6));
        for (int k = 0; k < 3; k++) mean[k] = scale * (normal[k] + of->normal[k][j]);
        press_point(chord, mean, r2, poisson, out);
        of->apart[j] = r2;
        for (int k = 0; k < 9; k++) of->pressed[k][j] = (float)out[k];
    }
}

#if defined(__x86_64__)
__attribute__((target("avx2"), noinline)) static void press_points_avx2(const double *position, const double *normal, double poisson, few *of) {
    press_points(position, normal, poisson, of);
}
#else
#define press_points_avx2 press_points
#endif

/* Compute the displacement of cell i for unit forces on cells j. */
static void press_few(const dermis_cells *of, int64_t i, const int64_t *j, int64_t count, few *out) {
    const dermis_patches *cells = of->cells;
    const double *position = cells->positions + 3 * i, *normal = cells->normals + 3 * i;
    if (of->avx2)
        press_points_avx2(position, normal, of->poisson, out);
    else
        press_points(position, normal, of->poisson, out);
    for (int64_t n = 0; n < count; n++) {
        double one[9];
        if (!(out->apart[n] < NEAR * NEAR * dermis_most(cells->areas[i], cells->areas[j[n]]))) continue;
        between(cells, i, cells, j[n], of->poisson, one);
        for (int k = 0; k < 9; k++) out->pressed[k][n] = (float)one[k];
    }
}

DERMIS_NOINLINE static int32_t join(dermis_cells *of) {
    float factor = (float)of->factor, spring[9];
    for (int k = 0; k < 9; k++) spring[k] = (float)of->spring[k];
    for (int64_t start = 0; start < of->columns; start += AT_ONCE) {
        few part = {0};
        int64_t count = of->columns - start < AT_ONCE ? of->columns - start : AT_ONCE;
        for (int64_t n = 0; n < count; n++)
            for (int k = 0; k < 3; k++) {
                part.position[k][n] = of->cells->positions[3 * of->source[start + n] + k];
                part.normal[k][n] = of->cells->normals[3 * of->source[start + n] + k];
            }
        int64_t mirrored = of->mirrored - start < count ? of->mirrored - start : count;
        for (int64_t i = 0; i < of->rows; i++) {
            press_few(of, of->field[i], of->source + start, count, &part);
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++) {
                    float *pressed = part.pressed[3 * a + b], *row = of->out + (3 * i + a) * of->stride + 3 * start + b;
                    const float *smooth = of->smooth + ((3 * i + a) * 3 + b) * of->columns + start;
                    for (int64_t n = 0; n < count; n++) {
                        pressed[n] = (pressed[n] + smooth[n]) * factor + spring[3 * a + b];
                        row[3 * n] = pressed[n];
                    }
                }
            for (int64_t n = 0; n < mirrored; n++)
                for (int b = 0; b < 3; b++)
                    for (int a = 0; a < 3; a++) of->mirror[(3 * (start + n) + b) * of->stride + 3 * i + a] = part.pressed[3 * a + b][n];
        }
    }
    return DERMIS_DONE;
}

static int known(const dermis_cells *of, const int64_t *cells, int64_t count) {
    for (int64_t n = 0; n < count; n++)
        if (cells[n] < 0 || cells[n] >= of->cells->count) return 0;
    return 1;
}

static int sound_rows(const dermis_cells *of) {
    if (of->cells == NULL || of->rows < 0 || of->columns < 0 || of->mirrored < 0 || of->mirrored > of->columns || of->stride < 3 * of->columns) return 0;
    if (of->mirrored > 0 && (of->mirror == NULL || of->stride < 3 * of->rows)) return 0;
    return (of->avx2 == 0 || of->avx2 == 1) && known(of, of->field, of->rows) && known(of, of->source, of->columns);
}

DERMIS_FUNCTION(dermis_compliance_rows, dermis_cells, sound_rows, join)
