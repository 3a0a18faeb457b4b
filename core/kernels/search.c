/* Search for the pose of a thimble's disc by damped Gauss-Newton steps; see core/matching/descent.py.

   The normal equations of the three unknowns, bordered by the residual r, are B'B of B = (J S, r). S scales the derivative
   with respect to the distance by the platform's radius. From the first trial that is beyond a limit on, each step is the
   minimum of the linearised mismatch within the linearised limits: the search is `bounded`. */
#include "float_environment.h"
#include "kernels.h"
#include "numbers.h"
#include "platform.h"

enum { BEGINS, STARTS, TRIES };

/* RESTORING: largest number of attempts to bring a trial back within the limits. */
#define RESTORING 4

/* Rounding error of a limit's distance after a step [rad]. */
#define ROUNDING 1e-12

/* Compute the distances of a trial from the limits; return 0 if they cannot be computed, or if one is below `least`. */
static int has_room(dermis_search *s, double least) {
    double margin, *room = s->trial_room;
    if (!dermis_close_legs(s->thimble, s->trial, s->trial_angles, &margin, s->bounded ? s->trial_slopes : NULL)) return 0;
    for (int i = 0; i < THREE; i++) room[i] = s->high[i] - s->trial_angles[i], room[THREE + i] = s->trial_angles[i] - s->low[i];
    room[MARGIN] = margin - s->thimble->least;
    for (int i = 0; i < LIMITS; i++)
        if (!(room[i] >= least) || !dermis_finite(room[i])) return 0;
    return 1;
}

/* Compute the trial's values by the disc's contact; return 0 if the caller has to do it. */
static int pressed(dermis_search *s) {
    dermis_disc *disc = s->disc;
    if (disc == NULL) return 0;
    dermis_place_disc(s->thimble, s->trial, s->pose);
    for (int j = 0; j < THREE; j++) s->pose[30 + j] = s->trial[j] - s->at[j];
    disc->pose = s->pose, s->own = s->held = 0;
    if (dermis_press_disc(disc) != DERMIS_DONE || disc->strays || !disc->count || !(disc->residual <= disc->tolerance)) return 0;
    for (int64_t k = 0; k < 4 * s->size; k++) s->trial_values[k] = 0.0;
    for (int64_t i = 0; i < 3 * disc->count; i++) {
        const double *force = disc->answer + 4 * i, *row = s->observation + (3 * disc->near[i / 3] + i % 3) * s->size;
        if (force[0] == 0.0 && force[1] == 0.0 && force[2] == 0.0 && force[3] == 0.0) continue;
        for (int j = 0; j < 4; j++)
            for (int64_t k = 0; k < s->size; k++) s->trial_values[j * s->size + k] += force[j] * row[k];
    }
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
    for (int k = 0; k < LIMITS; k++) s->room[k] = s->trial_room[k];
    for (int k = 0; k < 3 * LIMITS; k++) s->slopes[k] = s->trial_slopes[k];
    for (int j = 0; j < THREE; j++) s->x[j] = s->trial[j], s->angles[j] = s->trial_angles[j];
    for (int64_t k = 0; k < 4 * s->size; k++) s->values[k] = s->trial_values[k];
    s->own = s->held;
}

/* Compute B'B (4, 4), of which only the upper half is set, for a stimulus (k), its derivative (3, k) and a target (k);
   return 0 if it is not finite. */
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

/* Factorise a symmetric matrix as L L' by Cholesky's method, with rows of three; return 0 if it is singular. */
static int factorise(int size, const double *matrix, double *factor) {
    for (int i = 0; i < size; i++)
        for (int j = 0; j <= i; j++) {
            double sum = matrix[3 * i + j];
            for (int k = 0; k < j; k++) sum -= factor[3 * i + k] * factor[3 * j + k];
            if (i == j && !(sum > 0.0)) return 0;
            factor[3 * i + j] = i == j ? dermis_root(sum) : sum / factor[3 * j + j];
        }
    return 1;
}

/* Solve L L' x = b; x replaces b. */
static void solve(int size, const double *factor, double *x) {
    for (int i = 0; i < size; i++) {
        for (int k = 0; k < i; k++) x[i] -= factor[3 * i + k] * x[k];
        x[i] /= factor[3 * i + i];
    }
    for (int i = size; i-- > 0;) {
        for (int k = i + 1; k < size; k++) x[i] -= factor[3 * k + i] * x[k];
        x[i] /= factor[3 * i + i];
    }
}

/* Compute the damped step -(J'J + D)^-1 J'r, and the factor of J'J + D; return 0 if J is zero. */
static int step_of(const dermis_search *s, const double *gram, double *factor, double *way) {
    double more = s->damping * dermis_most(gram[0], dermis_most(gram[5], gram[10])), matrix[9];
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j <= i; j++) matrix[3 * i + j] = gram[4 * j + i] + (i == j ? more : 0.0);
        way[i] = -gram[4 * i + 3];
    }
    if (!(more > 0.0) || !factorise(3, matrix, factor)) return 0;
    solve(3, factor, way);
    return 1;
}

/* Compute the step of a bounded search if some limits are active; return 0 if it goes beyond another limit, or if a limit
   would pull.

   The step is d = d0 + V l, with the step d0 without limits, V = (J'J + D)^-1 A', and the derivatives A of the active
   limits. The multipliers l follow from A d = -room. left: out: norm of J'r - A'l. */
static int held_step(dermis_search *s, const double *factor, const double *free, int count, const int *active, double *left) {
    double solved[3][3], schur[9] = {0.0}, lower[9], l[3], gradient[3] = {s->gram[3], s->gram[7], s->gram[11]}, way[3] = {free[0], free[1], free[2]};
    for (int a = 0; a < count; a++) {
        const double *slope = s->slopes + 3 * active[a];
        for (int k = 0; k < 3; k++) solved[a][k] = slope[k];
        solve(3, factor, solved[a]);
        l[a] = -dermis_most(s->room[active[a]], 0.0) - dermis_dot(slope, free);
        for (int b = 0; b <= a; b++) schur[3 * a + b] = dermis_dot(s->slopes + 3 * active[b], solved[a]);
    }
    if (!factorise(count, schur, lower)) return 0;
    solve(count, lower, l);
    for (int a = 0; a < count; a++) {
        if (!(l[a] >= 0.0)) return 0;
        for (int k = 0; k < 3; k++) way[k] += l[a] * solved[a][k], gradient[k] -= l[a] * s->slopes[3 * active[a] + k];
    }
    for (int i = 0; i < LIMITS; i++) {
        int held = 0;
        for (int a = 0; a < count; a++) held |= active[a] == i;
        if (!held && !(dermis_most(s->room[i], 0.0) + dermis_dot(s->slopes + 3 * i, way) >= -ROUNDING)) return 0;
    }
    s->actives = count, *left = dermis_root(dermis_dot(gradient, gradient));
    for (int k = 0; k < 3; k++) s->way[k] = way[k], s->active[k] = k < count ? active[k] : -1, s->multipliers[k] = k < count ? l[k] : 0.0;
    return 1;
}

/* Choose the active limits of a bounded search, and compute the step; return the norm of J'r - A'l.

   The sets of limits that can be active together are tried, first none, then those of the step before. No servo is at both
   ends of its range. */
static double choose(dermis_search *s, const double *factor, const double *free) {
    double left;
    int last[3] = {(int)s->active[0], (int)s->active[1], (int)s->active[2]}, set[3] = {0, 0, 0};
    if (held_step(s, factor, free, 0, set, &left) || (s->actives && held_step(s, factor, free, (int)s->actives, last, &left))) return left;
    for (int count = 1; count <= 3; count++)
        for (set[0] = 0; set[0] < LIMITS; set[0]++)
            for (set[1] = count > 1 ? set[0] + 1 : LIMITS - 1; set[1] < LIMITS; set[1]++)
                for (set[2] = count > 2 ? set[1] + 1 : LIMITS - 1; set[2] < LIMITS; set[2]++) {
                    int apart = 1;
                    for (int a = 1; a < count; a++)
                        for (int b = 0; b < a; b++) apart &= set[a] == MARGIN || set[a] - set[b] != THREE;
                    if (apart && held_step(s, factor, free, count, set, &left)) return left;
                }
    /* only by rounding where limits meet: no step, since all limits hold here */
    s->actives = 0;
    for (int k = 0; k < 3; k++) s->way[k] = 0.0;
    return dermis_root(s->gram[3] * s->gram[3] + s->gram[7] * s->gram[7] + s->gram[11] * s->gram[11]);
}

/* Move a trial back within the limits, which it may violate because their linearisation is not exact; return 0 if it still
   violates one after RESTORING attempts. */
static int restored(dermis_search *s) {
    double rows[LIMITS][3], by[LIMITS], matrix[9], factor[9], right[3], move[3];
    for (int again = 0; again < RESTORING; again++) {
        int count = 0;
        if (!has_room(s, -__builtin_inf())) return 0;
        for (int i = 0; i < LIMITS; i++) {
            if (!(s->trial_room[i] < 0.0)) continue;
            for (int k = 0; k < 3; k++) rows[count][k] = s->trial_slopes[3 * i + k];
            by[count++] = 0.01 * s->on_limit - s->trial_room[i];
        }
        if (!count) return 1;
        /* the least move if there are at most three rows, else that of least squares */
        int side = count < 3 ? count : 3;
        for (int a = 0; a < side; a++) {
            right[a] = count > 3 ? 0.0 : by[a];
            for (int i = 0; i < count && count > 3; i++) right[a] += rows[i][a] * by[i];
            for (int b = 0; b <= a; b++) {
                double sum = count > 3 ? 0.0 : dermis_dot(rows[a], rows[b]);
                for (int i = 0; i < count && count > 3; i++) sum += rows[i][a] * rows[i][b];
                matrix[3 * a + b] = sum;
            }
        }
        if (!factorise(side, matrix, factor)) return 0;
        solve(side, factor, right);
        for (int k = 0; k < 3; k++) {
            move[k] = count > 3 ? right[k] : 0.0;
            for (int i = 0; i < count && count <= 3; i++) move[k] += rows[i][k] * right[i];
            s->trial[k] += k == 2 ? s->thimble->platform_radius * move[k] : move[k];
        }
    }
    return 0;
}

/* Put the share of the step into the trial; return 0 if it is beyond a limit. */
static int tries(dermis_search *s) {
    for (int j = 0; j < 2; j++) s->trial[j] = s->x[j] + s->share * s->way[j];
    s->trial[2] = s->x[2] + s->share * s->thimble->platform_radius * s->way[2];
    return s->bounded ? restored(s) : has_room(s, 0.0);
}

/* Put the start into the trial: the configuration that the earlier search predicts for the present target, unless it is
   beyond a limit or too far away for its slope. Return 0 if the start is outside the limits. */
static int began(dermis_search *s) {
    double gram[16], factor[9];
    s->share = 1.0;
    if (!s->bounded && s->before != NULL && gram_of(s, s->before, s->slope, s->target, gram) && step_of(s, gram, factor, s->way) && dermis_dot(s->way, s->way) <= s->longest * s->longest && tries(s))
        return 1;
    for (int j = 0; j < THREE; j++) s->trial[j] = s->x[j];
    if (!s->bounded && has_room(s, 0.0)) return 1;
    s->bounded = 1;
    return has_room(s, -s->on_limit);
}

static int steps(dermis_search *s);

/* Go on as a bounded search from the present configuration; return 0 if the search ends. It has as many steps and
   evaluations as one that begins there. */
static int bound(dermis_search *s) {
    double angles[THREE], margin;
    s->bounded = 1, s->actives = 0, s->most_steps += s->iterations, s->most_evaluations += s->evaluations - 1;
    return dermis_close_legs(s->thimble, s->x, angles, &margin, s->slopes) && steps(s);
}

/* Choose the next trial of a bounded search; return 0 if there is none. */
static int tries_shorter(dermis_search *s) {
    for (; s->share >= s->shortest; s->share *= 0.5) {
        if (tries(s)) return 1;
        if (s->share * s->length < s->small_step) return 0;
    }
    return 0;
}

/* End the search after a step of which no share lowers the cost enough. */
static int stalls(dermis_search *s) {
    s->iterations++;
    if (s->why != DERMIS_GAIN) s->why = s->length <= s->small_step ? DERMIS_STEP : s->evaluations >= s->most_evaluations ? DERMIS_LIMIT : DERMIS_STALLED;
    return 0;
}

/* Choose the next step; return 0 if the search ends, and then set `why`. */
static int steps(dermis_search *s) {
    const double *g = s->gram, gradient[3] = {g[3], g[7], g[11]};
    double weight = (g[0] + g[5] + g[10]) * g[15], left = dermis_root(dermis_dot(gradient, gradient)), hardly, promise, factor[9], free[3];
    int whole = step_of(s, g, factor, free);
    for (int k = 0; k < 3; k++) s->way[k] = free[k];
    if (s->bounded && whole) left = choose(s, factor, free);
    s->kkt = weight > 0.0 ? left / dermis_root(weight) : 0.0;
    s->why = DERMIS_LIMIT;
    if (2.0 * s->cost <= s->goal) return 0;
    if (s->kkt <= s->optimal) return s->why = DERMIS_OPTIMAL, 0;
    if (s->iterations >= s->most_steps || s->evaluations >= s->most_evaluations || !whole) return 0;
    s->length = dermis_root(dermis_dot(s->way, s->way));
    for (int j = 0; j < THREE && s->length > s->longest; j++) s->way[j] *= s->longest / s->length;
    s->descent = -dermis_dot(gradient, s->way);
    if (s->bounded) return s->share = 1.0, tries_shorter(s) || stalls(s);
    hardly = s->follows && s->evaluations > 1 ? s->later : s->hardly, promise = 0.5 * s->reach * s->descent;
    if (promise <= hardly * s->cost) return s->why = DERMIS_GAIN, 0;
    s->share = s->reach < s->nearly ? s->reach : 1.0;
    if (!tries(s)) return bound(s);
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
        double way[3] = {s->trial[0] - s->x[0], s->trial[1] - s->x[1], (s->trial[2] - s->x[2]) / s->thimble->platform_radius};
        double moved = dermis_root(dermis_dot(way, way)), gained = 1.0 - cost / s->cost;
        take(s);
        s->cost = cost, s->iterations++;
        for (int k = 0; k < 16; k++) s->gram[k] = gram[k];
        if (moved > s->small_step && gained > s->small_gain) return steps(s);
        return s->why = moved <= s->small_step ? DERMIS_STEP : DERMIS_GAIN, 0;
    }
    s->why = DERMIS_STALLED;
    if (s->share * s->length < s->small_step || s->evaluations >= s->most_evaluations) return stalls(s);
    if (!s->bounded && curve > 0.0 && 0.25 * full * full / curve <= (s->follows ? s->later : s->hardly) * s->cost)
        return s->why = DERMIS_GAIN, stalls(s);
    s->share *= curve > 0.0 ? dermis_least(dermis_most(0.5 * full / curve, 0.1), 0.5) : 0.5;
    if (s->bounded) return tries_shorter(s) || stalls(s);
    if (s->share < s->shortest) return stalls(s);
    return tries(s) || bound(s);
}

DERMIS_NOINLINE static int32_t descend(dermis_search *s) {
    double gram[16];
    int given = s->phase != BEGINS, on = 1;
    if (!given) {
        s->iterations = s->evaluations = s->own = s->held = s->actives = 0, s->why = DERMIS_OUTSIDE, s->goal = 0.0;
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
    if (s->bounded) s->reach = 1.0;
    if (2.0 * s->cost <= s->goal) {
        s->why = DERMIS_EXACT;
        s->kkt = s->goal > 0.0 ? s->exact * dermis_root(2.0 * s->cost / s->goal) : 0.0;
    }
    return DERMIS_DONE;
}

static int sound(const dermis_search *s) {
    return s->thimble != NULL && s->size >= 1 && s->phase >= BEGINS && s->phase <= TRIES && s->actives >= 0 && s->actives <= 3 &&
           (s->bounded == 0 || s->bounded == 1) && (s->disc == NULL || s->disc->freedoms == THREE);
}

DERMIS_FUNCTION(dermis_descend, dermis_search, sound, descend)
