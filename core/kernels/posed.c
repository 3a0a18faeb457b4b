/* The closest of some bodies to a point of the skin. */
#include "posed.h"

#include "closest.h"
#include "distance.h"
#include "numbers.h"
#include "poses.h"
#include "rim.h"

/* OPPOSITE: a normal belongs to the far side of a thin body if its component into the finger is below this.
   ABOVE: the near side is then searched from a point this much deeper in the finger [m]. */
#define OPPOSITE -0.7
#define ABOVE 0.4e-3

/* Convert a point from the frame of the skin to that of a body. */
static void localised(const dermis_posed *posed, const double *x, double *local) {
    double from[3];
    for (int k = 0; k < 3; k++) from[k] = x[k] - posed->translation[k];
    dermis_turned_back(posed->rotation, from, local);
}

/* Return the distance of a point from the axis of a disc [m]. */
static double reach_of(const dermis_posed *posed, const double *local) {
    double height = dermis_dot(local, posed->plane), across[3];
    for (int k = 0; k < 3; k++) across[k] = local[k] - height * posed->plane[k];
    return dermis_root(dermis_dot(across, across));
}

/* Measure the signed distance of a point to one body; return the closest triangle, 0 for a plane, -1 beyond the limit.

   The gap of a disc is measured along the normal of its face, also at its rim.

   slot: in, a hint or -1; out, see `dermis_distance`. gap: out [m]. normal: out, in the frame of the skin (3). */
static int64_t measure(const dermis_posed *posed, const double *x, double limit, int64_t *slot, double *gap, double *normal) {
    double local[3], turned[3];
    int64_t triangle = 0;
    localised(posed, x, local);
    if (posed->body == NULL) {
        *gap = dermis_dot(local, posed->plane) - posed->plane[3];
        if (posed->rounding > 0.0) *gap += dermis_rim(posed->radius, posed->rounding, reach_of(posed, local));
        for (int k = 0; k < 3; k++) turned[k] = posed->plane[k];
        if (*gap > limit) return -1;
    } else {
        dermis_distance found;
        dermis_signed_distance(posed->body, local, limit, *slot, &found);
        if (found.triangle < 0) return -1;
        double side = found.beside ? 1.0 : posed->side; /* beyond a rim a point is outside of either side */
        *gap = side * found.gap, *slot = found.slot, triangle = found.triangle;
        for (int k = 0; k < 3; k++) turned[k] = side * found.normal[k];
    }
    dermis_turned(posed->rotation, turned, normal);
    return triangle;
}

void dermis_look(const dermis_posed *posed, int64_t bodies, double limit, double behind, const double *x, const double *inward, dermis_sight *sight) {
    double best = limit;
    int64_t before = sight->body, hint = sight->slot;
    *sight = (dermis_sight){limit, {0.0, 0.0, 0.0}, -1, -1, -1};
    for (int64_t b = 0; b < bodies; b++) {
        const dermis_posed *one = posed + b;
        double gap, out[3], farthest = dermis_most(best, 0.0);
        /* behind an open sheet, or in a body that is inside out, a point is found only within the distance that is
           searched: do not reduce it; skin may be deep in a soft one */
        if (one->body != NULL && (one->body->outside < 0 || !one->body->closed))
            farthest = one->softness > 0.0 ? dermis_most(limit, behind) : limit;
        int64_t slot = b == before ? hint : -1, on = measure(one, x, farthest, &slot, &gap, out);
        if (on < 0) continue;
        if (one->body != NULL && dermis_dot(out, inward) < OPPOSITE) {
            double above[3];
            for (int k = 0; k < 3; k++) above[k] = x[k] + ABOVE * inward[k];
            on = measure(one, above, dermis_most(limit, farthest), &slot, &gap, out);
            if (on < 0 || dermis_dot(out, inward) < OPPOSITE) continue;
            gap -= ABOVE * dermis_dot(out, inward);
        }
        if (gap >= best) continue;
        best = sight->gap = gap, sight->body = b, sight->triangle = on, sight->slot = slot;
        for (int k = 0; k < 3; k++) sight->normal[k] = out[k];
    }
}

int dermis_sees_plane(const dermis_posed *posed, int64_t bodies, const double *x, double radius, const dermis_sight *sight) {
    for (int64_t b = 0; b < bodies; b++) {
        const dermis_posed *one = posed + b;
        double local[3], plane[4] = {0.0, 0.0, 0.0, 0.0}; /* `plane` stays 0 for a body that is not the closest, so
                                                             no triangle lies in it */
        localised(one, x, local);
        if (one->body == NULL) {
            if (b == sight->body ? one->rounding > 0.0 && reach_of(one, local) + radius > one->radius : dermis_dot(local, one->plane) - one->plane[3] <= radius) return 0;
            continue;
        }
        if (b == sight->body) dermis_turned_back(one->rotation, sight->normal, plane);
        plane[3] = dermis_dot(local, plane) - sight->gap;
        for (const dermis_body *body = one->body; body != NULL; body = body->next)
            if (!body->closed || body->by_rays || !(dermis_beyond(body, local, radius) || dermis_only_plane(body->tree, local, radius, plane))) return 0;
    }
    return sight->body >= 0;
}

int dermis_sound_posed(const dermis_posed *posed, int64_t bodies) {
    if (bodies < 0) return 0;
    for (int64_t b = 0; b < bodies; b++)
        for (const dermis_body *body = posed[b].body; body != NULL; body = body->next)
            if (!dermis_sound_body(body)) return 0;
    return 1;
}

static int finite(const double *values, int64_t count) {
    for (int64_t k = 0; k < count; k++)
        if (!dermis_finite(values[k])) return 0;
    return 1;
}

int dermis_known_posed(const dermis_posed *posed, int64_t bodies) {
    for (int64_t b = 0; b < bodies; b++) {
        const dermis_posed *one = posed + b;
        if (!finite(one->rotation, 9) || !finite(one->translation, 3) || !finite(one->plane, 4) || !dermis_finite(one->radius + one->rounding)) return 0;
        if (!(one->friction >= 0.0) || !(one->softness >= 0.0) || !dermis_finite(one->friction + one->softness + one->sharpness)) return 0;
    }
    return 1;
}
