/* Search for the pose of a thimble's disc by damped Gauss-Newton steps, while no limit is active; see
   core/matching/descent.py.

   The normal equations of the three unknowns, bordered by the residual r, are B'B of B = (J S, r). S scales the derivative
   with respect to the distance by the platform's radius. */
#include "float_environment.h"
#include "kernels.h"
#include "numbers.h"

/* Number of values in a configuration; it is the number of legs, too. */
#define THREE 3

/* BENT: largest absolute cosine of a knee, see core/devices/inverse_kinematics.py. UPRIGHT: determinant for a level
   platform on upright rods, 3/2 root 3. HALF_ROOT: half the root of 3. */
#define BENT (1.0 - 1e-6)
#define UPRIGHT 2.59807621135331594
#define HALF_ROOT 0.866025403784438647

enum { BEGINS, STARTS, TRIES };

/* Compute the angles of the servos from neutral, and the singularity margin; return 0 if a leg cannot reach.

   The formulas are those of core/devices/inverse_kinematics.py. */
static int close_legs(const dermis_thimble *of, const double *x, double *angles, double *margin) {
    static const double legs[THREE][2] = {{1.0, 0.0}, {-0.5, HALF_ROOT}, {-0.5, -HALF_ROOT}};
    double sp, cp, sr, cr, rows[THREE][3];
    if (!(dermis_abs(x[0]) < 0.5 * PI && dermis_abs(x[1]) < 0.5 * PI)) return 0;
    dermis_turn(x[0], &sp, &cp), dermis_turn(x[1], &sr, &cr);
    double up = cp * cr, by_pitch = -sp * cr, by_roll = -cp * sr, across = 1.0 / (1.0 + up);
    for (int i = 0; i < THREE; i++) {
        double ex = legs[i][0], ey = legs[i][1], m = sr * ex + by_pitch * ey, m_pitch = -up * ey, m_roll = cr * ex + sp * sr * ey;
        double bent = 2.0 * m * across, r = of->platform_radius * (1.5 - 0.5 * up - bent * m) - of->base_radius;
        double h = x[2] - of->platform_radius * m, square = r * r + h * h, size = dermis_root(square);
        double stretched = of->crank * of->crank - of->rod * of->rod + square, whole = 2.0 * of->crank * size;
        if (!(dermis_abs(stretched) < BENT * whole)) return 0;
        double cosine = stretched / whole, sine = dermis_root((1.0 - cosine) * (1.0 + cosine)), turn = dermis_angle(dermis_abs(h), r);
        angles[i] = (h < 0.0 ? -turn : turn) - of->bend * dermis_angle(sine, cosine) - of->servo_zero;
        /* the rod, from the end of the crank, whose direction is that of (r, h) turned by the knee's angle */
        double out = r - of->crank * (r * cosine + of->bend * h * sine) / size;
        double rise = h - of->crank * (h * cosine - of->bend * r * sine) / size, curve = bent * m * across - 0.5;
        rows[i][0] = out * (curve * by_pitch - 2.0 * bent * m_pitch) - rise * m_pitch;
        rows[i][1] = out * (curve * by_roll - 2.0 * bent * m_roll) - rise * m_roll;
        rows[i][2] = rise;
    }
    double normal[3];
    dermis_cross(rows[1], rows[2], normal);
    *margin = of->side * dermis_dot(rows[0], normal) / (UPRIGHT * of->rod * of->rod * of->rod);
    return 1;
}

/* Compute the distances of a trial from the limits; return 0 if it is beyond one. */
static int has_room(dermis_search *s) {
    double margin, least = __builtin_inf(), *room = s->trial_room;
    if (!close_legs(s->thimble, s->trial, s->trial_angles, &margin)) return 0;
    for (int i = 0; i < THREE; i++) room[i] = s->high[i] - s->trial_angles[i], room[THREE + i] = s->trial_angles[i] - s->low[i];
    room[2 * THREE] = margin - s->thimble->least;
    for (int i = 0; i <= 2 * THREE; i++) {
        if (!dermis_finite(room[i])) return 0;
        least = dermis_least(least, room[i]);
    }
    return least >= 0.0;
}

/* Turn a vector from the base's frame to the finger's. */
static void mount(const dermis_thimble *of, double a, double b, double c, double *out) {
    for (int i = 0; i < 3; i++) out[i] = of->mount[3 * i] * a + of->mount[3 * i + 1] * b + of->mount[3 * i + 2] * c;
}

/* Compute the pose of the disc at a trial, with its derivatives; the formulas are those of core/devices/linkage.py. */
static void place(dermis_search *s) {
    const dermis_thimble *of = s->thimble;
    double sp, cp, sr, cr, u[3], v[3], column[3], *pose = s->pose, r = of->platform_radius;
    dermis_turn(s->trial[0], &sp, &cp), dermis_turn(s->trial[1], &sr, &cr);
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
    mount(of, 0.5 * r * (u[0] - v[1]), -r * u[1], s->trial[2], pose + 9);
    for (int i = 0; i < 3; i++) pose[9 + i] += of->mount[9 + i];
    for (int j = 0; j < THREE; j++) {
        const double *w = spin[j];
        mount(of, w[0], w[1], w[2], pose + 12 + 3 * j);
        mount(of, 0.5 * r * (w[1] * u[2] - w[2] * u[1] - w[2] * v[0] + w[0] * v[2]), -r * (w[2] * u[0] - w[0] * u[2]), j == 2 ? 1.0 : 0.0, column);
        for (int i = 0; i < 3; i++) pose[21 + 3 * i + j] = column[i];
        pose[30 + j] = s->trial[j] - s->at[j];
    }
}

/* Compute the trial's values by the disc's contact; return 0 if the caller has to do it. */
static int pressed(dermis_search *s) {
    dermis_disc *disc = s->disc;
    if (disc == NULL) return 0;
    place(s);
    disc->pose = s->pose, s->own = s->held = 0;
    if (dermis_press_disc(disc) != DERMIS_DONE || disc->strays || !disc->count || !(disc->residual <= disc->tolerance)) return 0;
    for (int64_t k = 0; k < 4 * s->size; k++) s->trial_values[k] = 0.0;
    for (int64_t i = 0; i < 3 * disc->count; i++) {
        const double *force = disc->answer + 4 * i, *row = s->observation + (3 * disc->near[i / 3] + i % 3) * s->size;
        if (force[0] == 0.0 && force[1] == 0.0 && force[2] == 0.0 && force[3] == 0.0) continue;
        for (int j = 0; j < 4; j++)
            for (int64_t k = 0; k < s->size; k++) s->trial_values[j * s->size + k] += force[j] * row[k];
    }
    s->presses++;
    if (!disc->touching) return 1;
    for (int64_t k = 0; k < 12 * disc->count; k++) s->answer[k] = disc->answer[k];
    for (int64_t k = 0; k < 3 * disc->count; k++) s->moved[k] = disc->moved[k];
    for (int64_t i = 0; i < disc->count; i++) s->status[i] = disc->status[i];
    for (int j = 0; j < THREE; j++) s->at[j] = s->trial[j];
    disc->told = s->answer, disc->leading = THREE, s->held = 1;
    return 1;
}

/* Make the trial the present configuration. */
static void take(dermis_search *s) {
    for (int k = 0; k < 7; k++) s->room[k] = s->trial_room[k];
    for (int j = 0; j < THREE; j++) s->x[j] = s->trial[j], s->angles[j] = s->trial_angles[j];
    for (int64_t k = 0; k < 4 * s->size; k++) s->values[k] = s->trial_values[k];
    s->own = s->held;
}

/* Compute B'B of a stimulus and its derivative, both in `values`, and a target; return 0 if it is not finite. */
static int gram_of(const dermis_search *s, const double *stimulus, const double *slope, const double *target, double *gram) {
    double sum = 0.0, scale = s->thimble->platform_radius;
    for (int k = 0; k < 16; k++) gram[k] = 0.0;
    for (int64_t k = 0; k < s->size; k++) {
        double row[4] = {slope[k], slope[s->size + k], slope[2 * s->size + k] * scale, stimulus[k] - target[k]};
        for (int a = 0; a < 4; a++)
            for (int b = a; b < 4; b++) gram[4 * a + b] += row[a] * row[b];
    }
    for (int k = 0; k < 16; k++) sum += dermis_abs(gram[k]);
    return dermis_finite(sum);
}

/* Compute the damped step -(J'J + D)^-1 J'r by Cholesky's method; return 0 if J is zero. */
static int step_of(const dermis_search *s, const double *gram, double *way) {
    double more = s->damping * dermis_most(gram[0], dermis_most(gram[5], gram[10])), l[3], y[3];
    if (!(more > 0.0)) return 0;
    double first = dermis_root(gram[0] + more);
    l[0] = gram[1] / first, l[1] = gram[2] / first;
    double second = dermis_root(dermis_most(gram[5] + more - l[0] * l[0], more));
    l[2] = (gram[6] - l[1] * l[0]) / second;
    double third = dermis_root(dermis_most(gram[10] + more - l[1] * l[1] - l[2] * l[2], more));
    y[0] = -gram[3] / first;
    y[1] = (-gram[7] - l[0] * y[0]) / second;
    y[2] = (-gram[11] - l[1] * y[0] - l[2] * y[1]) / third;
    way[2] = y[2] / third;
    way[1] = (y[1] - l[2] * way[2]) / second;
    way[0] = (y[0] - l[0] * way[1] - l[1] * way[2]) / first;
    return 1;
}

/* Put the share of the step into the trial; return 0 if it is beyond a limit. */
static int tries(dermis_search *s) {
    for (int j = 0; j < 2; j++) s->trial[j] = s->x[j] + s->share * s->way[j];
    s->trial[2] = s->x[2] + s->share * s->thimble->platform_radius * s->way[2];
    return has_room(s);
}

/* Put the start into the trial: the configuration that the earlier search predicts for the present target, unless it is
   beyond a limit or too far away for its slope. */
static int began(dermis_search *s) {
    double gram[16];
    s->share = 1.0;
    if (s->before != NULL && gram_of(s, s->before, s->slope, s->target, gram) && step_of(s, gram, s->way) && dermis_dot(s->way, s->way) <= s->longest * s->longest && tries(s))
        return 1;
    for (int j = 0; j < THREE; j++) s->trial[j] = s->x[j];
    return has_room(s);
}

/* Choose the next step; return 0 if the search ends, and then set `why`. */
static int steps(dermis_search *s) {
    const double *g = s->gram, gradient[3] = {g[3], g[7], g[11]};
    double left = dermis_root(dermis_dot(gradient, gradient)), weight = (g[0] + g[5] + g[10]) * g[15], hardly, promise;
    s->kkt = weight > 0.0 ? left / dermis_root(weight) : 0.0;
    s->why = DERMIS_LIMIT;
    if (2.0 * s->cost <= s->goal) return 0;
    if (s->kkt <= s->optimal) return s->why = DERMIS_OPTIMAL, 0;
    if (s->iterations >= s->most_steps || s->evaluations >= s->most_evaluations || !step_of(s, g, s->way)) return 0;
    s->length = dermis_root(dermis_dot(s->way, s->way));
    for (int j = 0; j < THREE && s->length > s->longest; j++) s->way[j] *= s->longest / s->length;
    s->descent = -dermis_dot(gradient, s->way);
    hardly = s->follows && s->evaluations > 1 ? s->later : s->hardly, promise = 0.5 * s->reach * s->descent;
    if (promise <= hardly * s->cost) return s->why = DERMIS_GAIN, 0;
    s->share = s->reach < s->nearly ? s->reach : 1.0;
    if (!tries(s)) return s->why = DERMIS_BOUNDED, 0;
    if (promise > s->foreseen * s->cost) return 1;
    for (int64_t k = 0; k < s->size; k++) {
        const double *slope = s->values + s->size + k, way[3] = {s->way[0], s->way[1], s->way[2] * s->thimble->platform_radius};
        double by = slope[0] * way[0] + slope[s->size] * way[1] + slope[2 * s->size] * way[2];
        s->trial_values[k] = s->values[k] + s->share * by;
        for (int j = 0; j < THREE; j++) s->trial_values[(1 + j) * s->size + k] = slope[j * s->size];
    }
    s->cost -= s->share * (1.0 - 0.5 * s->share) * s->descent;
    s->iterations++;
    s->held = 0;
    take(s);
    return s->why = DERMIS_FORESEEN, 0;
}

/* Judge a trial and choose the next one; return 0 if the search ends. */
static int judged(dermis_search *s, const double *gram) {
    double cost = 0.5 * gram[15], full = s->share * s->descent, curve = cost - s->cost + full;
    /* the parabola through the costs at both ends of the step and the slope at its start */
    s->reach = curve > 0.0 ? dermis_least(dermis_most(0.5 * s->share * full / curve, s->least_reach), 1.0) : 1.0;
    /* a pose without contact has no gradient that would lead back to contact, so it is never taken */
    if (cost <= s->cost - s->armijo * dermis_most(full, 0.0) && cost < s->cost && gram[0] + gram[5] + gram[10] > 0.0) {
        double moved = s->share * dermis_least(s->length, s->longest), gained = 1.0 - cost / s->cost;
        take(s);
        s->cost = cost, s->iterations++;
        for (int k = 0; k < 16; k++) s->gram[k] = gram[k];
        if (moved > s->small_step && gained > s->small_gain) return steps(s);
        return s->why = moved <= s->small_step ? DERMIS_STEP : DERMIS_GAIN, 0;
    }
    s->why = s->length <= s->small_step ? DERMIS_STEP : s->evaluations >= s->most_evaluations ? DERMIS_LIMIT : DERMIS_STALLED;
    if (s->share * s->length >= s->small_step && s->evaluations < s->most_evaluations) {
        if (curve > 0.0 && 0.25 * full * full / curve <= (s->follows ? s->later : s->hardly) * s->cost) {
            s->why = DERMIS_GAIN;
        } else {
            s->share *= curve > 0.0 ? dermis_least(dermis_most(0.5 * full / curve, 0.1), 0.5) : 0.5;
            if (s->share >= s->shortest) {
                if (tries(s)) return 1;
                return s->why = DERMIS_BOUNDED, 0;
            }
        }
    }
    s->iterations++;
    return 0;
}

DERMIS_NOINLINE static int32_t descend(dermis_search *s) {
    double gram[16];
    int given = s->phase != BEGINS, on = 1;
    if (!given) {
        s->iterations = s->evaluations = s->presses = s->own = s->held = 0, s->why = DERMIS_BOUNDED, s->goal = 0.0;
        for (int64_t k = 0; k < s->size; k++) s->goal += s->target[k] * s->target[k];
        s->goal *= s->exact * s->exact;
        if (!began(s)) return DERMIS_DONE;
        s->phase = STARTS;
    }
    while (on) {
        if (!given && !pressed(s)) return DERMIS_ASKS;
        if (!gram_of(s, s->trial_values, s->trial_values + s->size, s->target, gram)) return DERMIS_NOT_FINITE;
        s->evaluations++;
        if (s->phase == STARTS) {
            take(s);
            s->cost = s->start_cost = 0.5 * gram[15], s->phase = TRIES;
            for (int k = 0; k < 16; k++) s->gram[k] = gram[k];
            on = steps(s);
        } else {
            on = judged(s, gram);
        }
        given = 0;
    }
    if (s->why != DERMIS_BOUNDED && 2.0 * s->cost <= s->goal) {
        s->why = DERMIS_EXACT;
        s->kkt = s->goal > 0.0 ? s->exact * dermis_root(2.0 * s->cost / s->goal) : 0.0;
    }
    return DERMIS_DONE;
}

static int sound(const dermis_search *s) {
    return s->thimble != NULL && s->size >= 1 && s->phase >= BEGINS && s->phase <= TRIES && (s->disc == NULL || s->disc->freedoms == THREE);
}

DERMIS_FUNCTION(dermis_descend, dermis_search, sound, descend)
