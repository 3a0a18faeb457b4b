/* Friction of a skin's nodes: the anchors in the material of the bodies, and the corrections within a frame.

   core/contact/solver/history.py and within_frame.py describe the method. */
#include "float_environment.h"
#include "numbers.h"
#include "poses.h"

#define TINY 1e-300
/* Two adjacent bodies form one smooth surface if the cosine between their normals is above this. */
#define LEVEL 0.7
/* FORESEEN: largest factor by which slip and drag are extrapolated in proportion to the movement of the material below.
   OWN: movement of the skin is not extrapolated if the material below moves by less than this share of it.
   SHORT: slip shorter than this multiple of the slip length is treated as if it had this length. */
#define FORESEEN 2.0
#define OWN 0.1
#define SHORT 1e-2
/* Length of the load-weighted mean normal below which the drift of skin is not extrapolated, since the skin may lie on
   an edge, and above which it is extrapolated fully. */
#define ROUND_LOW 0.8
#define ROUND_HIGH 0.9
/* Slip in a frame below this length counts as rest [m]. */
#define AT_REST 1e-9

/* Places in a row of `poses`, see kernels.h. */
enum { PLACE = 9, CARRY = 12, CARRY_BACK = 21, IS_AWAY = 30, IS_SHAPED = 31 };

static double length_of(const double *v) { return dermis_root(dermis_dot(v, v)); }

/* The tangential part of a vector with respect to a unit normal. */
static void across(const double *v, const double *normal, double *out) {
    double along = dermis_dot(v, normal);
    for (int k = 0; k < 3; k++) out[k] = v[k] - along * normal[k];
}

static int loaded(const double *force) { return force[0] != 0.0 || force[1] != 0.0 || force[2] != 0.0; }

/* Return exp(-x) - 1 for x >= 0: the series at x / 2^n, which is 0.1 or less, and n doublings of the argument. */
static double grown_less(double x) {
    int n = 0;
    double sum = 1.0;
    if (x > 50.0) return -1.0;
    for (; x > 0.1; x *= 0.5) n++;
    for (int k = 11; k > 1; k--) sum = 1.0 - x / k * sum;
    for (sum *= -x; n > 0; n--) sum *= 2.0 + sum;
    return sum;
}

/* Whether the record has possible counts, and every anchor a body that there is. */
static int sound(const dermis_friction *of) {
    if (of->count < 0 || of->bodies < 0 || of->shifted < 0 || of->shifted > of->count || of->entered < 0 || of->entered > of->count) return 0;
    for (int64_t i = 0; i < of->count; i++)
        if (of->owner[i] < -1 || of->owner[i] >= of->bodies) return 0;
    return 1;
}

/* Whether the bodies below the nodes and the indices of nodes in a frame are possible. */
static int sound_frame(const dermis_friction *of) {
    if (!sound(of)) return 0;
    for (int64_t i = 0; i < of->count; i++)
        if (of->below[i] < -1 || of->below[i] >= of->bodies) return 0;
    return 1;
}

static int sound_lists(const dermis_friction *of) {
    if (!sound_frame(of)) return 0;
    for (int64_t i = 0; i < of->shifted; i++)
        if (of->nodes[i] < 0 || of->nodes[i] >= of->count) return 0;
    for (int64_t i = 0; i < of->entered; i++)
        if (of->entering[i] < 0 || of->entering[i] >= of->count) return 0;
    return 1;
}

static const double *pose_of(const dermis_friction *of, int64_t body) { return of->poses + DERMIS_POSE * body; }

/* Compute the expected movement of the loaded skin in this frame from the drift of the last one (3). */
static void drift_ahead(const dermis_friction *of, double *ahead) {
    double load = 0.0, passed[3] = {0.0, 0.0, 0.0};
    for (int64_t i = 0; i < of->count; i++) {
        const double *force = of->force + 3 * i;
        if (of->owner[i] < 0 || !loaded(force)) continue;
        if (pose_of(of, of->owner[i])[IS_AWAY] != 0.0) return;
        double size = length_of(force);
        load += size;
        for (int k = 0; k < 3; k++) passed[k] -= size * (of->anchors[3 * i + k] - of->image[3 * i + k]);
    }
    if (!(load > 0.0)) return;
    for (int k = 0; k < 3; k++) passed[k] /= load;
    double own = OWN * OWN * dermis_dot(of->drift, of->drift);
    double grown = dermis_dot(passed, of->passed) / dermis_most(dermis_dot(of->passed, of->passed) + own, TINY);
    for (int k = 0; k < 3; k++) ahead[k] = dermis_least(dermis_most(grown, 0.0), FORESEEN) * of->drift[k];
    double share = dermis_least(length_of(passed) / dermis_most(length_of(ahead), TINY), 1.0);
    for (int k = 0; k < 3; k++) ahead[k] *= share;
}

DERMIS_NOINLINE static int32_t expect(dermis_friction *of) {
    double ahead[3] = {0.0, 0.0, 0.0};
    if (!dermis_all_finite(of->poses, DERMIS_POSE * of->bodies) || !dermis_all_finite(of->image, 3 * of->count)) return DERMIS_NOT_FINITE;
    for (int64_t i = 0; i < of->count; i++) {
        double *anchor = of->anchors + 3 * i, *normal = of->normals + 3 * i, own[3];
        if (of->owner[i] < 0) {
            for (int k = 0; k < 3; k++) anchor[k] = __builtin_nan(""), normal[k] = 0.0;
            continue;
        }
        const double *pose = pose_of(of, of->owner[i]);
        dermis_turned(pose, of->normal + 3 * i, normal);
        if (pose[IS_SHAPED] != 0.0) continue; /* Python has set the anchor */
        dermis_turned(pose + CARRY, of->material + 3 * i, own);
        dermis_turned(pose, own, anchor);
        for (int k = 0; k < 3; k++) anchor[k] += pose[PLACE + k];
    }
    if (of->force != NULL) drift_ahead(of, ahead);
    for (int64_t i = 0; i < of->count; i++) {
        const double *anchor = of->anchors + 3 * i;
        double moved[3];
        for (int k = 0; k < 3; k++) moved[k] = anchor[k] - of->image[3 * i + k];
        int carried = of->sticking[i] && dermis_dot(moved, moved) <= of->radius * of->radius;
        for (int k = 0; k < 3; k++) of->places[3 * i + k] = carried ? anchor[k] : of->image[3 * i + k] + ahead[k];
    }
    return DERMIS_DONE;
}

DERMIS_NOINLINE static int32_t offset(dermis_friction *of) {
    for (int64_t i = 0; i < of->count; i++) {
        const double *normal = of->facing + 3 * i;
        double *b = of->offset + 3 * i;
        int64_t was = of->owner[i], now = of->below[i];
        /* friction continues across the seam to a body that continues the surface */
        int anchored = was >= 0 && (was == now || (now >= 0 && pose_of(of, was)[IS_AWAY] == 0.0 && dermis_dot(of->normals + 3 * i, normal) > LEVEL));
        for (int k = 0; k < 3; k++) b[k] = anchored ? of->points[3 * i + k] - of->anchors[3 * i + k] : 0.0;
        double gap = (now >= 0 ? of->gaps[i] : 0.0) - dermis_dot(b, normal);
        for (int k = 0; k < 3; k++) b[k] += gap * normal[k];
    }
    return DERMIS_DONE;
}

/* Compute the share of the shifts of a node's slip that is held back along the first direction of its force. */
static double foreseen_slip(const dermis_friction *of, int64_t i, const double *swept, double length) {
    const double *slip = of->slip + 3 * i, *before = of->swept + 3 * i;
    double size = dermis_dot(slip, slip);
    double grown = dermis_dot(swept, before) / dermis_most(dermis_dot(before, before) + OWN * OWN * size, TINY);
    double far = dermis_least(dermis_most(grown, 0.0), FORESEEN) * dermis_root(size);
    double x = dermis_most(far / dermis_most(length * of->own[i], TINY), SHORT);
    return (1.0 + 1.0 / x + 1.0 / grown_less(x)) * far;
}

DERMIS_NOINLINE static int32_t foresee(dermis_friction *of) {
    double total = 0.0;
    if (!dermis_all_finite(of->force, 3 * of->count) || !dermis_all_finite(of->image, 3 * of->count)) return DERMIS_NOT_FINITE;
    of->shifted = 0;
    for (int k = 0; k < 3; k++) of->passed[k] = 0.0;
    for (int64_t i = 0; i < of->count; i++) {
        const double *normal = of->facing + 3 * i, *force = of->force + 3 * i;
        double *swept = of->sweeping + 3 * i, *b = of->offset + 3 * i, way[3], back[3];
        for (int k = 0; k < 3; k++) swept[k] = 0.0;
        if (!of->loaded[i]) continue;
        for (int k = 0; k < 3; k++) way[k] = b[k] + of->image[3 * i + k];
        across(way, normal, swept);
        double size = length_of(force);
        total += size;
        for (int k = 0; k < 3; k++) of->passed[k] += size * swept[k];
        if (of->sticking[i] || of->owner[i] != of->below[i] || !(of->friction[i] > 0.0)) continue;
        across(force, normal, back);
        double length = length_of(back), shift = of->share * foreseen_slip(of, i, swept, length);
        for (int k = 0; k < 3; k++) {
            double *one = of->shift + 3 * of->shifted + k;
            *one = shift * (back[k] / dermis_most(length, TINY));
            b[k] += *one;
        }
        of->nodes[of->shifted++] = i;
    }
    for (int k = 0; k < 3; k++) of->passed[k] /= dermis_most(total, TINY);
    return DERMIS_DONE;
}

/* Return the distance by which the anchor of a node that came into contact lags behind it (3). */
static void lag(const dermis_friction *of, int64_t i, const double *shift, double *back) {
    double ahead[3];
    across(of->force + 3 * i, of->facing + 3 * i, back);
    for (int k = 0; k < 3; k++) ahead[k] = shift[k] + of->slip[3 * i + k];
    double share = dermis_most(dermis_dot(ahead, back), 0.0) / dermis_most(dermis_dot(back, back), TINY);
    for (int k = 0; k < 3; k++) back[k] = of->status[i] == DERMIS_STICK ? ahead[k] : share * back[k];
}

/* Move the anchor of a node to its present position on a body. */
static void anchor_at(dermis_friction *of, int64_t i, const double *position) {
    const double *pose = pose_of(of, of->below[i]);
    double from[3], local[3];
    of->triangle[i] = of->faces[i];
    for (int k = 0; k < 3; k++) of->corners[3 * i + k] = -1;
    for (int k = 0; k < 3; k++) from[k] = position[k] - pose[PLACE + k];
    dermis_turned_back(pose, from, local);
    dermis_turned(pose + CARRY_BACK, local, of->material + 3 * i);
}

DERMIS_NOINLINE static int32_t keep(dermis_friction *of) {
    if (!dermis_all_finite(of->force, 3 * of->count) || !dermis_all_finite(of->image, 3 * of->count) || !dermis_all_finite(of->moved, 3 * of->count)) return DERMIS_NOT_FINITE;
    of->slides = of->entered > 0;
    for (int64_t i = 0; i < of->count; i++) {
        const double *normal = of->facing + 3 * i, *w = of->moved + 3 * i;
        double gap = dermis_dot(w, normal);
        int near = of->below[i] >= 0, sticks = of->status[i] == DERMIS_STICK;
        for (int k = 0; k < 3; k++) {
            of->slip[3 * i + k] = w[k] - gap * normal[k];
            of->positions[3 * i + k] = of->image[3 * i + k] + of->soft[i] * of->force[3 * i + k] - gap * normal[k];
        }
        of->renewed[i] = (uint8_t)(near && !(sticks && of->owner[i] == of->below[i]));
        of->owner[i] = of->below[i], of->sticking[i] = (uint8_t)(near && sticks), of->gap[i] = dermis_most(gap, 0.0);
        if (near) dermis_turned_back(pose_of(of, of->below[i]), normal, of->normal + 3 * i);
    }
    /* the anchors of shifted nodes and of those that came into contact are moved even if they stick now */
    for (int64_t j = 0; j < of->shifted; j++) {
        int64_t i = of->nodes[j];
        of->renewed[i] = of->owner[i] >= 0;
        for (int k = 0; k < 3; k++) of->slip[3 * i + k] -= of->shift[3 * j + k];
    }
    for (int64_t j = 0; j < of->entered; j++) {
        int64_t i = of->entering[j];
        double back[3];
        lag(of, i, of->crossing + 3 * j, back);
        of->renewed[i] = of->owner[i] >= 0;
        for (int k = 0; k < 3; k++) of->positions[3 * i + k] -= back[k];
    }
    for (int64_t i = 0; i < of->count; i++) {
        if (of->renewed[i]) anchor_at(of, i, of->positions + 3 * i);
        for (int k = 0; k < 3 && of->status[i] == DERMIS_SLIP; k++) of->slides |= !(dermis_abs(of->slip[3 * i + k]) <= AT_REST);
    }
    return DERMIS_DONE;
}

DERMIS_NOINLINE static int32_t drift(dermis_friction *of) {
    double load = 0.0, mean[3] = {0.0, 0.0, 0.0};
    for (int k = 0; k < 3; k++) of->drift[k] = 0.0;
    for (int64_t i = 0; i < of->count; i++) {
        const double *force = of->force + 3 * i, *normal = of->facing + 3 * i;
        double size = length_of(force), moved[3];
        if (!loaded(force)) continue;
        load += size;
        across(of->moved + 3 * i, normal, moved);
        for (int k = 0; k < 3; k++) mean[k] += size * normal[k], of->drift[k] += size * moved[k];
    }
    for (int k = 0; k < 3; k++) mean[k] /= dermis_most(load, TINY);
    double smooth = dermis_clamped((length_of(mean) - ROUND_LOW) / (ROUND_HIGH - ROUND_LOW));
    for (int k = 0; k < 3; k++) of->drift[k] *= smooth / dermis_most(load, TINY);
    return DERMIS_DONE;
}

/* Shift the slip of nodes that came into contact back to where their path crosses the surface. */
DERMIS_NOINLINE static int32_t arrive(dermis_arrivals *of) {
    of->entered = 0;
    for (int64_t i = 0; i < of->count; i++) {
        const double *normal = of->normals + 3 * i, *force = of->force + 3 * i;
        double free[3], *crossing = of->crossing + 3 * of->entered; /* free: relative displacement without the node's own force */
        if (of->status[i] == 0 || of->loaded[i] || of->owner[i] != of->below[i] || !(of->friction[i] > 0.0)) continue;
        for (int a = 0; a < 3; a++) {
            const float *row = of->compliance + (3 * i + a) * of->stride + 3 * i;
            double own[3] = {row[0], row[1], row[2]};
            own[a] += of->soft[i];
            free[a] = of->moved[3 * i + a] - dermis_einsum(own, force);
        }
        double along = dermis_einsum(free, normal), beneath = dermis_most(-along, 0.0), share = of->gap[i] / dermis_most(of->gap[i] + beneath, TINY);
        for (int k = 0; k < 3; k++) crossing[k] = -share * (free[k] - along * normal[k]);
        of->entering[of->entered++] = i;
    }
    return DERMIS_DONE;
}

static int sound_arrivals(const dermis_arrivals *of) { return of->count >= 0 && of->stride >= 3 * of->count; }

DERMIS_FUNCTION(dermis_arrive, dermis_arrivals, sound_arrivals, arrive)
DERMIS_FUNCTION(dermis_expect, dermis_friction, sound, expect)
DERMIS_FUNCTION(dermis_offset, dermis_friction, sound_frame, offset)
DERMIS_FUNCTION(dermis_foresee, dermis_friction, sound_frame, foresee)
DERMIS_FUNCTION(dermis_keep, dermis_friction, sound_lists, keep)
DERMIS_FUNCTION(dermis_drift, dermis_friction, sound, drift)
