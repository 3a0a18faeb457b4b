/* Contact of points of smooth skin with bodies: gaps that follow the points, and forces that follow the gaps.

   A point looks at the bodies from two places that are lifted into the finger, a lift and `ratio` lifts away, and
   extrapolates both distances linearly to itself. On a plane this is the exact gap. At an edge, where the distance from
   the surface has a kink, the lifted places are outside the body, where distances are smooth; kinks in hollows are
   rounded. The mean over five places about the point limits how fast the gap turns from cell to cell; how the gradient
   differs between the places tells how the normal turns, so that a point looks again only after it has moved. */
#include "anderson.h"
#include "cone.h"
#include "felt.h"
#include "float_environment.h"
#include "kernels.h"
#include "numbers.h"
#include "posed.h"

#define LOOKS 10
/* SHARE: of a point's way that its normal follows in a visit; with all of it, normals turn back and forth. Where a normal
   still does, its share is halved; else it grows by GROW. Below LEAST the normal is kept.
   TRUST: way since the last look after which a point looks again within the sweeps [m].
   STILL: way after which it looks again in the last round and between rounds, over the tolerance [m]. FLAT: the same
   where its normal does not turn [m].
   ROUNDING: error of a gap by rounding [m]; points are some centimetres from the origin. Forces that it causes are none.
   CLEAR: gap above which a point without force is not visited [m].
   FAR: gap above which a point takes the plane of its first look [m]. */
#define SHARE 0.5
#define GROW 1.1
#define LEAST 0.02
#define TRUST 0.05e-3
#define STILL 0.1
#define FLAT 0.02e-3
#define ROUNDING 1e-17
#define CLEAR 0.05e-3
#define STEADY 300 /* sweeps of a round after which a visit is a step of the fixed-point iteration of sweeps.c: with much
                      friction, exact solutions of single points may turn back and forth without end */
#define LONG 60 /* sweeps of a round after which normals turn in part: points between two faces may look at either in turn */
#define FAR 0.2e-3

/* Return the gap above which a point without force is not visited [m]. */
static double clear_of(const dermis_touch *t) { return t->thorough ? __builtin_inf() : CLEAR; }

static const double PLACES[5][3] = {{1, 1, 1.0 / 6}, {1, -1, 1.0 / 6}, {-1, 1, 1.0 / 6}, {-1, -1, 1.0 / 6}, {0, 0, 2.0 / 6}};

/* The gap about the place of the last look: clearance + normal z + z bend z / 2, for a way z; and its plane at z. */
typedef struct {
    double normal[3], bend[2][3], side[2][3]; /* bend: turn of the normal per metre along both sides */
    double at[3];                             /* z */
    double plane[3], gap;                     /* unit normal at z, and the gap there */
    int64_t flat;                             /* 1: the normal does not turn */
    double own[9];                            /* compliance of the point to its own force */
    int64_t rough;                            /* 1: the point is far, and looked but once */
    double share, turned[3];                  /* of a turn that the normal follows, and its last turn */
    const double *image;                      /* displacement of the point by all forces */
} view;

/* Parts of the workspace, in numbers a point: `view` of each point, the history of sweeps, `drag`, a displacement of 0, `body`,
   `slots`, active points, and the compliance between these. */
enum { VIEWS = 38, PAST = 3 * (4 * DERMIS_KEPT + 10), DRAG = VIEWS + PAST, NONE = DRAG + 3, BODY = NONE + 3, SLOTS = BODY + 1, ACTIVE = SLOTS + LOOKS, GATHERED = ACTIVE + 1 };
_Static_assert(sizeof(view) == 8 * VIEWS && (int)GATHERED == (int)DERMIS_TOUCH_ROOM, "the workspace");

/* The points that sweeps visit: those with a force, and those that are near a body. */
typedef struct {
    int64_t count;     /* of these points */
    int64_t *points;   /* their indices, in ascending order (n) */
    float *compliance; /* between them (3 count, 3 count) */
    felt lag;          /* of the sweeps over them */
    double *image;     /* their displacement by all forces (n, 3) */
    double *known;     /* forces that `t->image` contains (n, 3) */
} active;

/* Find the places of the points' arrays in the blocks. */
static void lay_out(dermis_touch *t) {
    int64_t n = t->count;
    t->where = t->found, t->normal = t->found + 3 * n, t->clearance = t->found + 6 * n, t->gap = t->found + 7 * n;
    t->friction = t->found + 8 * n, t->softness = t->found + 9 * n;
    t->owner = (int64_t *)(t->found + 10 * n), t->triangle = (int64_t *)(t->found + 11 * n);
    if (t->out != NULL) t->force = t->out, t->image = t->out + 3 * n, t->moved = t->out + 6 * n, t->status = (int8_t *)(t->out + 9 * n);
    t->drag = t->room + DRAG * n, t->body = (int64_t *)(t->room + BODY * n), t->slots = (int64_t *)(t->room + SLOTS * n);
}

/* Fill in results that follow from the body of each point and from its gap. */
static void tell(const dermis_touch *t) {
    for (int64_t i = 0; i < t->count; i++) {
        const dermis_posed *by = t->body[i] < 0 ? NULL : t->posed + t->body[i];
        t->owner[i] = by == NULL ? -1 : by->index;
        t->friction[i] = by == NULL ? 0.0 : by->friction, t->softness[i] = by == NULL ? 0.0 : by->softness;
        t->gap[i] = t->clearance[i] - dermis_einsum(t->normal + 3 * i, t->where + 3 * i);
    }
}

static void nothing(dermis_touch *t, view *v, int64_t i) {
    t->body[i] = t->triangle[i] = -1;
    t->clearance[i] = v->gap = __builtin_inf();
    for (int k = 0; k < 3; k++) t->normal[3 * i + k] = v->plane[k] = v->normal[k] = v->at[k] = 0.0;
}

/* Return the share of the lift and the spread that all bodies need everywhere; -1 if it differs. */
static double share_of_all(const dermis_touch *t) {
    double share = t->bodies > 0 ? t->posed[0].sharpness : 1.0;
    for (int64_t b = 0; b < t->bodies; b++)
        if (t->posed[b].shares != NULL || t->posed[b].sharpness != share) return -1.0;
    return share;
}

/* Take a gap and a normal for those of a plane. */
static void take_plane(dermis_touch *t, view *v, int64_t i, double gap, const double *normal) {
    t->clearance[i] = v->gap = gap, v->flat = 1;
    for (int k = 0; k < 3; k++) {
        v->normal[k] = v->plane[k] = t->normal[3 * i + k] = normal[k], v->at[k] = 0.0;
        v->bend[0][k] = v->bend[1][k] = v->side[0][k] = v->side[1][k] = 0.0;
    }
}

/* Whether all places at which a point looks see the same flat face as the lower one at its middle.

   The other places, and their closest points on that face, are within a ball about this place x. */
static int flat(const dermis_touch *t, const dermis_sight *sight, const double *x, const double *inward, const double *spread, double share, double lift) {
    double aside = 0.0, up = (t->ratio - 1.0) * lift, rise = dermis_most(dermis_dot(inward, sight->normal), 0.0);
    for (int a = 0; a < 2; a++) aside += share * dermis_root(dermis_dot(spread + 3 * a, spread + 3 * a));
    return dermis_sees_plane(t->posed, t->bodies, x, up + 2.0 * aside + dermis_abs(sight->gap) + up * rise, sight);
}

/* Look from the largest lift, and return the share of it that is needed there; 0 if that look was enough.

   Where it shows no body, or one flat face, no other look is needed. sight: out, what it shows. */
static double share_at(dermis_touch *t, view *v, int64_t i, int thorough, dermis_sight *sight) {
    const double *inward = t->inward + 3 * i;
    int64_t *slot = t->slots + LOOKS * i + 8;
    double x[3], far = t->limit + t->ratio * t->lift;
    *sight = (dermis_sight){0.0, {0.0, 0.0, 0.0}, t->body[i], -1, *slot};
    for (int k = 0; k < 3; k++) x[k] = t->points[3 * i + k] + t->where[3 * i + k] + t->lift * inward[k];
    dermis_look(t->posed, t->bodies, far, far, x, inward, sight);
    if (sight->body < 0 || sight->gap > t->limit + t->lift) {
        nothing(t, v, i);
        return 0.0;
    }
    *slot = sight->slot, t->body[i] = sight->body, t->triangle[i] = sight->triangle;
    if (!t->thorough && flat(t, sight, x, inward, t->spread + 6 * i, 1.0, t->lift)) {
        take_plane(t, v, i, sight->gap - t->lift * dermis_dot(inward, sight->normal), sight->normal);
        v->rough = !thorough && sight->gap - t->lift > FAR;
        return 0.0;
    }
    return dermis_share_of(t->posed + sight->body, sight->triangle);
}

/* Look at the bodies from where the point is displaced to.

   thorough: 0: a point that is farther than FAR away takes the plane of the first look. */
static void look(dermis_touch *t, view *v, int64_t i, int thorough) {
    const double *inward = t->inward + 3 * i, *spread = t->spread + 6 * i;
    int64_t *slots = t->slots + LOOKS * i, body = t->body[i], slot = -1;
    double share = share_of_all(t), gap = 0.0, turn[3] = {0.0, 0.0, 0.0}, each[5][3], nearest = __builtin_inf();
    dermis_sight middle;
    int fits = 0; /* 1: `middle` is what the first look sees */
    t->looks++, v->rough = 0;
    if (share < 0.0) {
        share = share_at(t, v, i, thorough, &middle);
        if (!(share > 0.0)) return;
        fits = share == 1.0;
    }
    double lift = share * t->lift, high = t->ratio, far = t->limit + high * lift;
    for (int p = 4; p >= 0; p--) {
        double part = PLACES[p][2];
        for (int k = 0; k < 3; k++) each[p][k] = 0.0;
        for (int above = 0; above < 2; above++) {
            double x[3], up = above ? high * lift : lift, weight = above ? -1.0 / (high - 1.0) : high / (high - 1.0);
            int64_t known = slots[2 * p + above];
            /* at the first look, begin at what the middle, or the place before on this side of it, saw from this height */
            if (known < 0 && p < 4) known = slots[2 * (p & 1 ? 4 : p + 1) + above];
            dermis_sight sight = {0.0, {0.0, 0.0, 0.0}, body, -1, known < 0 ? slot : known};
            for (int k = 0; k < 3; k++)
                x[k] = t->points[3 * i + k] + t->where[3 * i + k] + share * (PLACES[p][0] * spread[k] + PLACES[p][1] * spread[3 + k]) + up * inward[k];
            if (fits && p == 4 && !above)
                sight = middle;
            else
                dermis_look(t->posed, t->bodies, far, far, x, inward, &sight);
            if (sight.body < 0 || (p == 4 && !above && sight.gap > t->limit + lift)) {
                nothing(t, v, i);
                return;
            }
            slots[2 * p + above] = slot = sight.slot, body = sight.body;
            if (sight.gap < nearest) nearest = sight.gap, t->body[i] = sight.body, t->triangle[i] = sight.triangle;
            if (p == 4 && above == 0) {
                double there = sight.gap - lift * dermis_dot(inward, sight.normal);
                int rough = !thorough && !t->thorough && sight.gap - lift > FAR;
                if (rough || (!fits && !t->thorough && flat(t, &sight, x, inward, spread, share, lift))) {
                    take_plane(t, v, i, there, sight.normal);
                    v->rough = rough;
                    return;
                }
            }
            if (!above) dermis_round(t->posed, t->bodies, x, lift, &sight);
            gap += weight * part * sight.gap;
            for (int k = 0; k < 3; k++) each[p][k] += weight * sight.normal[k];
        }
        for (int k = 0; k < 3; k++) turn[k] += part * each[p][k];
    }
    double length = dermis_root(dermis_dot(turn, turn)), bent = 0.0, normal[3];
    if (!(length > 0.1)) {
        nothing(t, v, i);
        return;
    }
    for (int k = 0; k < 3; k++) normal[k] = turn[k] / length;
    take_plane(t, v, i, gap / length, normal);
    for (int a = 0; a < 2; a++) {
        double size = dermis_root(dermis_dot(spread + 3 * a, spread + 3 * a));
        for (int k = 0; k < 3; k++) {
            double more = a == 0 ? (each[0][k] + each[1][k]) - (each[2][k] + each[3][k]) : (each[0][k] + each[2][k]) - (each[1][k] + each[3][k]);
            v->bend[a][k] = more / (4.0 * share * size * length), v->side[a][k] = spread[3 * a + k] / size;
            bent = dermis_most(bent, dermis_abs(more));
        }
    }
    v->flat = bent < 1e-9;
}

/* Set the plane of the gap at z. */
static void turn(const dermis_touch *t, view *v, int64_t i) {
    double along[2] = {dermis_dot(v->at, v->side[0]), dermis_dot(v->at, v->side[1])}, gap = t->clearance[i], bend = 0.0;
    for (int k = 0; k < 3; k++) {
        double more = along[0] * v->bend[0][k] + along[1] * v->bend[1][k];
        gap += v->at[k] * v->normal[k], bend += v->at[k] * more;
        v->plane[k] = v->normal[k] + more;
    }
    double length = dermis_root(dermis_dot(v->plane, v->plane));
    for (int k = 0; k < 3; k++) v->plane[k] /= length;
    v->gap = (gap + 0.5 * bend) / length;
}

static int loaded(const dermis_touch *t, int64_t i) { return any(t->force + 3 * i); }

static rows_of all_rows(const dermis_touch *t) { return (rows_of){t->compliance, NULL, t->stride, t->avx2}; }
static rows_of near_rows(const dermis_touch *t, const active *near) { return (rows_of){near->compliance, NULL, 3 * near->count, t->avx2}; }

static double soft_of(const dermis_touch *t, int64_t i) { return t->body[i] < 0 ? 0.0 : t->posed[t->body[i]].softness / t->areas[i]; }
static double rub_of(const dermis_touch *t, int64_t i) { return t->body[i] < 0 ? 0.0 : t->posed[t->body[i]].friction; }

/* Way of the point since its last look (3). */
static void way_of(const dermis_touch *t, const view *v, int64_t i, double *way) {
    for (int k = 0; k < 3; k++)
        way[k] = v->image[k] + t->shift[3 * i + k] + soft_of(t, i) * t->force[3 * i + k] - t->where[3 * i + k];
}

/* Relative displacement of a point under its force: the gap along the normal, and slip across it (3). */
static void relative(const dermis_touch *t, const view *v, int64_t i, double *w) {
    const double *n = v->plane;
    double gap = v->gap, slip = 0.0, way[3];
    way_of(t, v, i, way);
    for (int k = 0; k < 3; k++) {
        gap += n[k] * (way[k] - v->at[k]);
        w[k] = way[k] + t->where[3 * i + k] + t->drag[3 * i + k];
        slip += w[k] * n[k];
    }
    for (int k = 0; k < 3; k++) w[k] += (gap - slip) * n[k];
}

/* Return the gap of a point under its force [m]. */
static double gap_of(const dermis_touch *t, const view *v, int64_t i) {
    double w[3];
    relative(t, v, i, w);
    return dermis_dot(w, v->plane);
}

/* Let a normal that turned at the last look follow in part.

   Where it turns back and forth, it follows half as much each time: between two faces it comes to rest where the
   forces along both balance. */
static void turn_in_part(dermis_touch *t, view *v, int64_t i, const double *before) {
    double change[3];
    for (int k = 0; k < 3; k++) change[k] = v->plane[k] - before[k];
    v->share = dermis_dot(change, v->turned) < 0.0 ? 0.5 * v->share : dermis_least(SHARE, GROW * v->share);
    for (int k = 0; k < 3; k++) v->plane[k] = before[k] + v->share * change[k], v->turned[k] = change[k];
    double length = dermis_root(dermis_dot(v->plane, v->plane));
    for (int k = 0; k < 3; k++) t->normal[3 * i + k] = v->normal[k] = v->plane[k] /= length;
}

/* Let the normal follow the point.

   trust: way since the last look after which the point looks again [m]. calm: 1: it turns in part. */
static void follow(dermis_touch *t, view *v, int64_t i, double trust, int calm) {
    double way[3], before[3];
    way_of(t, v, i, way);
    if (trust < TRUST && dermis_dot(way, way) <= trust * trust) return;
    if (calm && v->share < LEAST) return;
    for (int k = 0; k < 3; k++) v->at[k] += SHARE * (way[k] - v->at[k]), before[k] = v->plane[k];
    if (trust >= TRUST && dermis_dot(v->at, v->at) <= trust * trust) {
        turn(t, v, i);
        return;
    }
    for (int k = 0; k < 3; k++) t->where[3 * i + k] += v->at[k];
    look(t, v, i, 1);
    if (calm && t->body[i] >= 0) turn_in_part(t, v, i, before);
}

/* Improve the force on a point while all others are fixed; return the squared change.

   swept: sweeps of this round so far. change: out (3). */
static double improve(dermis_touch *t, view *v, int64_t i, double trust, int swept, double *change) {
    double *force = t->force + 3 * i, found[3] = {0.0, 0.0, 0.0}, w[3];
    int pressed = loaded(t, i);
    for (int k = 0; k < 3; k++) change[k] = 0.0;
    if (!pressed && (t->body[i] < 0 || gap_of(t, v, i) > clear_of(t))) return 0.0;
    if (v->rough && t->body[i] >= 0) look(t, v, i, 1);
    if (t->body[i] >= 0 && trust > 0.0) follow(t, v, i, trust, swept > LONG);
    if (t->body[i] >= 0) {
        const double *n = v->plane;
        double own = 0.0, normal = 0.0, soft = soft_of(t, i), cn[3];
        relative(t, v, i, w);
        double gap = dermis_dot(w, n), along = dermis_dot(force, n), mu = rub_of(t, i);
        if (!pressed && gap >= 0.0) return 0.0;
        for (int r = 0; r < 3; r++) {
            cn[r] = soft * n[r];
            for (int c = 0; c < 3; c++) cn[r] += v->own[3 * r + c] * n[c];
            own += v->own[4 * r] + soft, normal += n[r] * cn[r];
        }
        if (mu == 0.0) /* first turn the force, with what that does to the gap */
            for (int k = 0; k < 3; k++) gap += cn[k] * (along * n[k] - force[k]);
        double press = along - gap / normal, across = 0.5 * (own - normal);
        if (swept > STEADY) {
            for (int k = 0; k < 3; k++) found[k] = force[k] - w[k] / own;
            project(found, n, mu);
        } else if (press > 0.0) {
            for (int k = 0; k < 3; k++) found[k] = press * n[k];
            if (mu > 0.0) {
                double moved[3], side[3], out;
                for (int k = 0; k < 3; k++) moved[k] = w[k] + cn[k] * (press - along);
                out = dermis_dot(moved, n);
                for (int k = 0; k < 3; k++) side[k] = force[k] - along * n[k] - (moved[k] - out * n[k]) / across;
                double share = shortening(side, mu * press);
                for (int k = 0; k < 3; k++) found[k] += share * side[k];
            }
        }
    }
    for (int k = 0; k < 3; k++) change[k] = found[k] - force[k], force[k] = found[k];
    return dermis_dot(change, change);
}

/* Improve the force on number j of the active points, and let others feel it; return the squared change.

   back: 1 in the second sweep of a pair. */
static double visit(dermis_touch *t, view *views, active *near, int64_t j, double trust, int swept, int back) {
    int64_t i = near->points[j];
    double change[3], square = improve(t, views + i, i, trust, swept, change);
    rows_of c = near_rows(t, near);
    pass_on(&c, near->count, j, change, back, &near->lag, near->image);
    return square;
}

/* Compute the residual of f = P(f - w / own), as in sweeps.c.

   points: indices of the points that are assessed (count); null for all. */
static void assess(dermis_touch *t, view *views, const int64_t *points, int64_t count) {
    double error = 0.0, size = 0.0, projected = 0.0, least = 0.0;
    for (int64_t j = 0; j < count; j++) {
        int64_t i = points == NULL ? j : points[j];
        const double *force = t->force + 3 * i, *n = views[i].plane;
        double *w = t->moved + 3 * i, own = 3.0 * soft_of(t, i), v[3];
        t->status[i] = 0;
        if (t->body[i] < 0) {
            for (int k = 0; k < 3; k++) w[k] = 0.0, error += force[k] * force[k], size += force[k] * force[k];
            continue;
        }
        relative(t, views + i, i, w);
        for (int k = 0; k < 3; k++) own += views[i].own[4 * k];
        for (int k = 0; k < 3; k++) v[k] = force[k] - 3.0 * w[k] / own;
        project(v, n, rub_of(t, i));
        size += dermis_dot(force, force), projected += dermis_dot(v, v), least += 9.0 * ROUNDING * ROUNDING / (own * own);
        for (int k = 0; k < 3; k++) v[k] -= force[k];
        error += dermis_dot(v, v);
        t->status[i] = status_of(force, n, rub_of(t, i));
    }
    size = dermis_most(size, projected) + least;
    t->residual = size > 0.0 ? dermis_root(error / size) : 0.0;
}

/* Let every point that is near or loaded look again from where it is; return whether any had moved. */
static int look_again(dermis_touch *t, view *views) {
    int moved = 0;
    for (int64_t i = 0; i < t->count; i++) {
        view *v = views + i;
        double way[3];
        if (t->body[i] < 0 || (!loaded(t, i) && gap_of(t, v, i) > clear_of(t))) continue;
        way_of(t, v, i, way);
        double still = v->flat ? FLAT : STILL * t->tolerance;
        if (dermis_dot(way, way) <= still * still) continue;
        for (int k = 0; k < 3; k++) t->where[3 * i + k] += way[k];
        look(t, v, i, 1), moved = 1;
    }
    return moved;
}

static int finite(const double *values, int64_t count) {
    for (int64_t k = 0; k < count; k++)
        if (!dermis_finite(values[k])) return 0;
    return 1;
}

/* Bring the displacement of all points up to date with the forces. */
static void bring(dermis_touch *t, active *near) {
    rows_of c = all_rows(t);
    for (int64_t j = 0; j < near->count; j++) {
        int64_t i = near->points[j];
        double change[3], *known = near->known + 3 * i;
        for (int k = 0; k < 3; k++) change[k] = t->force[3 * i + k] - known[k], known[k] = t->force[3 * i + k];
        if (dermis_dot(change, change) > 0.0) move(&c, 0, t->count, i, change, t->image);
    }
    for (int64_t j = 0; j < near->count; j++)
        for (int k = 0; k < 3; k++) t->image[3 * near->points[j] + k] = near->image[3 * j + k];
}

/* Choose the active points, and gather the compliance between them. */
static void gather(dermis_touch *t, view *views, active *near) {
    int64_t m = 0, changed = 0;
    for (int64_t i = 0; i < t->count; i++) {
        views[i].image = t->image + 3 * i;
        if (!loaded(t, i) && (t->body[i] < 0 || gap_of(t, views + i, i) > 2.0 * clear_of(t))) continue;
        changed |= m >= near->count || near->points[m] != i;
        near->points[m++] = i;
    }
    changed |= m != near->count, near->count = m;
    for (int64_t j = 0; j < m; j++) {
        views[near->points[j]].image = near->image + 3 * j;
        for (int k = 0; k < 3 && changed; k++) {
            const float *row = t->compliance + (3 * near->points[j] + k) * t->stride;
            near->image[3 * j + k] = t->image[3 * near->points[j] + k];
            gather_row(row, near->points, m, near->compliance + (3 * j + k) * 3 * m);
        }
    }
}

/* Whether a point that is not active has come so near that it may get a force. */
static int comes(const dermis_touch *t, const view *views) {
    for (int64_t i = 0; i < t->count; i++)
        if (views[i].image == t->image + 3 * i && t->body[i] >= 0 && gap_of(t, views + i, i) <= clear_of(t)) return 1;
    return 0;
}

/* Assess the active points. Where they have converged, and others have come near, choose them anew, and return 1. */
static int chosen(dermis_touch *t, view *views, active *near, double goal) {
    rows_of c = near_rows(t, near);
    pass_rest(&c, near->count, &near->lag, near->image);
    assess(t, views, near->points, near->count);
    if (t->residual > goal) return 0;
    bring(t, near);
    if (!comes(t, views)) return 0;
    gather(t, views, near);
    assess(t, views, near->points, near->count);
    return 1;
}

/* Copy the forces on the active points (count, 3). */
static void forces_of(const dermis_touch *t, const active *near, double *out) {
    for (int64_t j = 0; j < near->count; j++)
        for (int k = 0; k < 3; k++) out[3 * j + k] = t->force[3 * near->points[j] + k];
}

static void solve(dermis_touch *t, view *views) {
    int64_t n = t->count;
    double *past_sweeps = t->room + VIEWS * n, *before = past_sweeps + 4 * (DERMIS_KEPT + 1) * 3 * n, *force = before + 3 * n;
    active near = {0, (int64_t *)(t->room + ACTIVE * n), (float *)(t->room + GATHERED * n), {force + 3 * n, force + 6 * n}, force + 9 * n, force + 12 * n};
    rows_of c = all_rows(t);
    for (int64_t i = 0; i < n; i++) {
        double clearance = t->body[i] < 0 ? 0.0 : t->clearance[i];
        for (int k = 0; k < 3; k++) t->image[3 * i + k] = 0.0, near.known[3 * i + k] = t->force[3 * i + k], near.lag.later[3 * i + k] = near.lag.earlier[3 * i + k] = 0.0;
        for (int k = 0; k < 3; k++) t->drag[3 * i + k] = t->offset[3 * i + k] - clearance * t->normal[3 * i + k];
        for (int k = 0; k < 9; k++) views[i].own[k] = (double)t->compliance[(3 * i + k / 3) * t->stride + 3 * i + k % 3];
    }
    for (int64_t i = 0; i < n; i++)
        if (loaded(t, i)) move(&c, 0, n, i, t->force + 3 * i, t->image);
    for (int64_t i = 0; i < n; i++) views[i].image = t->image + 3 * i;
    for (int round = 0; round < 4 && t->sweeps < t->most; round++) {
        double goal = round < 2 ? 3e-3 : round == 2 ? 1e-3 : t->tolerance, trust = round == 0 ? 0.0 : round < 3 ? TRUST : STILL * t->tolerance;
        if (round > 0) look_again(t, views);
        for (int64_t i = 0; i < n; i++) {
            views[i].share = SHARE;
            for (int k = 0; k < 3; k++) views[i].turned[k] = 0.0;
        }
        gather(t, views, &near);
        assess(t, views, near.points, near.count);
        double still = goal, nearest = __builtin_inf();
        past last = {3 * near.count, 0, past_sweeps, 0.0};
        int waited = 0, alone = 0, in_round = 0;
        /* where normals have turned since the last visit, forces may be beyond their cones */
        while (t->sweeps < t->most && t->residual > (round == 3 && in_round == 0 ? 0.0 : goal)) {
            double change = 0.0, size = 0.0;
            forces_of(t, &near, before);
            for (int64_t j = 0; j < near.count; j++) visit(t, views, &near, j, trust, in_round, 0);
            for (int64_t j = near.count - 1; j >= 0; j--) change += visit(t, views, &near, j, trust, in_round, 1);
            t->sweeps += 2, in_round += 2;
            forces_of(t, &near, force);
            for (int64_t k = 0; k < 3 * near.count; k++) size += force[k] * force[k];
            if (change > still * still * size) {
                waited = change < nearest ? 0 : waited + 1;
                nearest = dermis_least(nearest, change);
                if (waited > PATIENCE) alone = ALONE, waited = 0;
                if (alone > 0) {
                    alone--, last.kept = 0;
                    continue;
                }
                accelerate(force, near.image, near.lag.later, &last, before);
                for (int64_t j = 0; j < near.count; j++)
                    for (int k = 0; k < 3; k++) t->force[3 * near.points[j] + k] = force[3 * j + k];
                continue;
            }
            if (chosen(t, views, &near, goal)) last = (past){3 * near.count, 0, past_sweeps, 0.0};
            still *= 0.25;
        }
        rows_of own = near_rows(t, &near);
        pass_rest(&own, near.count, &near.lag, near.image);
        bring(t, &near);
    }
    assess(t, views, NULL, n);
    for (int64_t i = 0; i < n; i++) {
        if (t->body[i] < 0) continue;
        for (int k = 0; k < 3; k++) t->where[3 * i + k] += views[i].at[k], t->normal[3 * i + k] = views[i].plane[k];
        t->clearance[i] = views[i].gap;
    }
}

DERMIS_NOINLINE static int32_t touch(dermis_touch *t) {
    int64_t n = t->count;
    view *views = (view *)t->room;
    double *none = t->room + NONE * n;
    lay_out(t);
    if (!dermis_known_posed(t->posed, t->bodies) || !finite(t->points, 3 * n) || !finite(t->where, 3 * n)) return DERMIS_NOT_FINITE;
    if (t->compliance != NULL && (!finite(t->force, 3 * n) || !finite(t->offset, 3 * n) || (t->shift != NULL && !finite(t->shift, 3 * n)))) return DERMIS_NOT_FINITE;
    for (int64_t i = 0; i < n && t->looked; i++)
        if (t->body[i] < -1 || t->body[i] >= t->bodies) return DERMIS_BAD_RECORD;
    t->sweeps = t->looks = 0;
    for (int64_t i = 0; i < n && !t->looked; i++) {
        int64_t *slots = t->slots + LOOKS * i;
        for (int k = 0; k < LOOKS; k++) slots[k] = -1;
        t->body[i] = -1;
        if (i > 0) t->body[i] = t->body[i - 1], slots[8] = slots[8 - LOOKS], slots[9] = slots[9 - LOOKS]; /* hints */
        look(t, views + i, i, 0);
    }
    if (t->compliance != NULL) {
        for (int64_t k = 0; k < 3 * n && t->shift == NULL; k++) none[k] = 0.0;
        if (t->shift == NULL) t->shift = none;
        solve(t, views);
    }
    tell(t);
    return DERMIS_DONE;
}

static int sound(const dermis_touch *t) {
    int solved = t->compliance == NULL || (t->out != NULL && t->offset != NULL && t->stride >= 3 * t->count && t->most >= 0 && t->tolerance >= 0.0);
    return t->count >= 0 && t->found != NULL && t->room != NULL && dermis_sound_posed(t->posed, t->bodies) && solved && (t->avx2 == 0 || t->avx2 == 1) &&
           (t->looked == 0 || t->looked == 1) && (t->thorough == 0 || t->thorough == 1);
}

DERMIS_FUNCTION(dermis_touch_points, dermis_touch, sound, touch)
