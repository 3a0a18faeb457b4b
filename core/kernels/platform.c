/* Kinematics of a thimble's platform; see core/devices/linkage.py and inverse_kinematics.py for the formulas. */
#include "platform.h"

#include "numbers.h"

/* BENT: largest absolute cosine of a knee, see core/devices/inverse_kinematics.py. UPRIGHT: determinant for a level
   platform on upright rods, 3/2 root 3. HALF_ROOT: half the root of 3. */
#define BENT (1.0 - 1e-6)
#define UPRIGHT 2.59807621135331594
#define HALF_ROOT 0.866025403784438647

/* Directions of the legs from the base's centre. */
#define ENDS {{1.0, 0.0}, {-0.5, HALF_ROOT}, {-0.5, -HALF_ROOT}}

/* A leg: the vector along its rod (out, rise) [m], and the direction of its crank. `by` is the derivative of the joint's
   place on the platform, divided by the platform's radius, with respect to pitch, roll, and distance over that radius. */
typedef struct {
    double out, rise, cosine, sine, m, m_by[THREE], by[THREE][2];
} leg;

/* Compute the derivatives of the limits' distances with respect to pitch, roll, and distance over the platform's radius.

   rows: the change of each rod's length times the length, by each of these; the margin is their determinant. */
static void slope_limits(const dermis_thimble *of, const leg *legs, double rows[THREE][3], const double *x, double *slopes) {
    static const double ends[THREE][2] = ENDS;
    double sp, cp, sr, cr, size = of->platform_radius, cofactors[THREE][3], *margin = slopes + 3 * MARGIN;
    dermis_turn(x[0], &sp, &cp), dermis_turn(x[1], &sr, &cr);
    double up = cp * cr, k = 1.0 / (1.0 + up), up_by[2] = {-sp * cr, -cp * sr}, up_both[2][2] = {{-up, sp * sr}, {sp * sr, -up}};
    for (int i = 0; i < THREE; i++) dermis_cross(rows[(i + 1) % THREE], rows[(i + 2) % THREE], cofactors[i]);
    for (int b = 0; b < 3; b++) margin[b] = 0.0;
    for (int i = 0; i < THREE; i++) {
        const leg *l = legs + i;
        double ex = ends[i][0], ey = ends[i][1], m = l->m, lever = of->crank * (l->rise * l->cosine - l->out * l->sine);
        double m_both[2][2] = {{sp * cr * ey, cp * sr * ey}, {cp * sr * ey, sp * cr * ey - sr * ex}};
        for (int b = 0; b < 3; b++) {
            double turn = size * rows[i][b] / lever, out = size * l->by[b][0] + of->crank * l->sine * turn, rise = size * l->by[b][1] - of->crank * l->cosine * turn;
            slopes[3 * i + b] = -turn, slopes[3 * (THREE + i) + b] = turn;
            for (int a = 0; a < 3; a++) {
                double change = out * l->by[a][0] + rise * l->by[a][1];
                if (a < 2 && b < 2) {
                    double crossed = l->m_by[a] * up_by[b] + l->m_by[b] * up_by[a];
                    change += l->out * ((2.0 * k * k * m * m - 0.5) * up_both[a][b] - 4.0 * k * (l->m_by[a] * l->m_by[b] + m * m_both[a][b]) +
                                        4.0 * k * k * m * crossed - 4.0 * k * k * k * m * m * up_by[a] * up_by[b]);
                    change -= l->rise * m_both[a][b];
                }
                margin[b] += cofactors[i][a] * change;
            }
        }
    }
    for (int b = 0; b < 3; b++) margin[b] *= of->side / (UPRIGHT * of->rod * of->rod * of->rod);
}

int dermis_close_legs(const dermis_thimble *of, const double *x, double *angles, double *margin, double *slopes) {
    static const double ends[THREE][2] = ENDS;
    double sp, cp, sr, cr, rows[THREE][3], normal[3];
    leg legs[THREE];
    if (!(dermis_abs(x[0]) < 0.5 * PI && dermis_abs(x[1]) < 0.5 * PI)) return 0;
    dermis_turn(x[0], &sp, &cp), dermis_turn(x[1], &sr, &cr);
    double up = cp * cr, by_pitch = -sp * cr, by_roll = -cp * sr, across = 1.0 / (1.0 + up);
    for (int i = 0; i < THREE; i++) {
        double ex = ends[i][0], ey = ends[i][1], m = sr * ex + by_pitch * ey, m_pitch = -up * ey, m_roll = cr * ex + sp * sr * ey;
        double bent = 2.0 * m * across, r = of->platform_radius * (1.5 - 0.5 * up - bent * m) - of->base_radius;
        double h = x[2] - of->platform_radius * m, square = r * r + h * h, size = dermis_root(square);
        double stretched = of->crank * of->crank - of->rod * of->rod + square, whole = 2.0 * of->crank * size;
        if (!(dermis_abs(stretched) < BENT * whole)) return 0;
        double cosine = stretched / whole, sine = dermis_root((1.0 - cosine) * (1.0 + cosine)), turn = dermis_angle(dermis_abs(h), r);
        angles[i] = (h < 0.0 ? -turn : turn) - of->bend * dermis_angle(sine, cosine) - of->servo_zero;
        /* the crank has the direction of (r, h), turned by the knee's angle */
        double along = (r * cosine + of->bend * h * sine) / size, above = (h * cosine - of->bend * r * sine) / size, curve = bent * m * across - 0.5;
        legs[i] = (leg){r - of->crank * along, h - of->crank * above, along, above, m, {m_pitch, m_roll, 0.0},
                        {{curve * by_pitch - 2.0 * bent * m_pitch, -m_pitch}, {curve * by_roll - 2.0 * bent * m_roll, -m_roll}, {0.0, 1.0}}};
        for (int j = 0; j < 3; j++) rows[i][j] = legs[i].out * legs[i].by[j][0] + legs[i].rise * legs[i].by[j][1];
    }
    dermis_cross(rows[1], rows[2], normal);
    *margin = of->side * dermis_dot(rows[0], normal) / (UPRIGHT * of->rod * of->rod * of->rod);
    if (slopes != NULL) slope_limits(of, legs, rows, x, slopes);
    return 1;
}

/* Turn a vector from the base's frame to the finger's. */
static void mount(const dermis_thimble *of, double a, double b, double c, double *out) {
    for (int i = 0; i < 3; i++) out[i] = of->mount[3 * i] * a + of->mount[3 * i + 1] * b + of->mount[3 * i + 2] * c;
}

void dermis_place_disc(const dermis_thimble *of, const double *x, double *pose) {
    double sp, cp, sr, cr, u[3], v[3], column[3], r = of->platform_radius;
    dermis_turn(x[0], &sp, &cp), dermis_turn(x[1], &sr, &cr);
    double n = -sp * sr, d = cp + cr, scale = 1.0 / (n * n + d * d), c = d * dermis_root(scale), sine = n * dermis_root(scale);
    double yaw_pitch = (d * -cp * sr + n * sp) * scale, yaw_roll = (d * -sp * cr + n * sr) * scale;
    double axis[3] = {sr, -sp * cr, cp * cr}, first[3] = {cr, sp * sr, -cp * sr}, second[3] = {0.0, cp, sp};
    double spin[THREE][3] = {{1.0 + yaw_pitch * axis[0], yaw_pitch * axis[1], yaw_pitch * axis[2]},
                             {yaw_roll * axis[0], cp + yaw_roll * axis[1], sp + yaw_roll * axis[2]},
                             {0.0, 0.0, 0.0}};
    for (int i = 0; i < 3; i++) u[i] = c * first[i] + sine * second[i], v[i] = c * second[i] - sine * first[i];
    const double *columns[3] = {u, v, axis};
    for (int j = 0; j < 3; j++) {
        mount(of, columns[j][0], columns[j][1], columns[j][2], column);
        for (int i = 0; i < 3; i++) pose[3 * i + j] = column[i];
    }
    mount(of, 0.5 * r * (u[0] - v[1]), -r * u[1], x[2], pose + 9);
    for (int i = 0; i < 3; i++) pose[9 + i] += of->mount[9 + i];
    for (int j = 0; j < THREE; j++) {
        const double *w = spin[j];
        mount(of, w[0], w[1], w[2], pose + 12 + 3 * j);
        mount(of, 0.5 * r * (w[1] * u[2] - w[2] * u[1] - w[2] * v[0] + w[0] * v[2]), -r * (w[2] * u[0] - w[0] * u[2]), j == 2 ? 1.0 : 0.0, column);
        for (int i = 0; i < 3; i++) pose[21 + 3 * i + j] = column[i];
    }
}
