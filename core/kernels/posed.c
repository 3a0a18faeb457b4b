/* The closest of some bodies to a point of the skin. */
#include "posed.h"

#include "closest.h"
#include "distance.h"
#include "numbers.h"
#include "poses.h"
#include "rim.h"
#include "triangle.h"

/* OPPOSITE: a normal belongs to the far side of a thin body if its component into the finger is below this.
   ABOVE: the near side is then searched from a point this much deeper in the finger [m]. */
#define OPPOSITE -0.7
#define ABOVE 0.4e-3
/* A second face counts only if it rises above the plane through the closest point by more than this, h [m]. At distances
   D of the closest face and E of the second, a face that rises by h reduces the gap by at most h E / (4 (D - h)). */
#define LOW 1e-6
/* A second face that is at the end of the kink's width up to this does not count, for rounding [m]. */
#define ROUNDING 1e-10
/* The distance falls along a way if the cosine between the way and the direction to the point is above FALL: triangles that
   are a nanometre apart over some hundredths of a millimetre are continuous. RING: at most this many triangles around a
   vertex are asked. PASSED: at most this many triangles without area between two faces are passed. */
#define FALL 1e-4
#define RING 64
#define PASSED 8

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

/* Whether two unit normals turn by less than an angle [rad]. */
static int parallel(const double *one, const double *other, double turn) {
    double apart[3];
    for (int k = 0; k < 3; k++) apart[k] = one[k] - other[k];
    return dermis_dot(apart, apart) < turn * turn;
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
        if (sight->body >= 0 && gap > best - one->tie && parallel(out, sight->normal, one->turn)) {
            best = sight->gap = gap;
            continue;
        }
        best = sight->gap = gap, sight->body = b, sight->triangle = on, sight->slot = slot;
        for (int k = 0; k < 3; k++) sight->normal[k] = out[k];
    }
}

/* The closest faces of a point, in the frame of a body. */
typedef struct {
    const dermis_body *body;
    double x[3], gap, normal[3]; /* the point, its gap and the gradient, by the closest face [m] */
    double width, side;          /* width of the kink [m]; 1, or -1 behind an open sheet */
    double less, turn[3];        /* out: reduction of the gap by a second face [m], and change of the gradient */
} kink;

/* Return the width of the kink with a second face [m]; 0 if it reduces the gap no more than the best one so far.

   distance: from the point [m]. normal: unit vector from the face to the point (3). */
static double width_of(const kink *at, double distance, const double *normal) {
    double cosine = dermis_dot(at->normal, normal), width = at->width * dermis_least(1.0, 1.0 + cosine), more = distance - at->gap;
    /* a face in or below the plane through the closest point is at least this much farther */
    if (cosine > 0.0) width = dermis_least(width, dermis_most(at->gap, 0.0) * (1.0 / cosine - 1.0));
    return width - more > ROUNDING && (width - more) * (width - more) / (4.0 * width) > at->less ? width : 0.0;
}

/* Take a face as the second one, with the width of its kink [m]; nothing is changed if this is 0. */
static void reduce(kink *at, double width, double distance, const double *normal) {
    double over = width - (distance - at->gap);
    if (!(width > 0.0)) return;
    at->less = over * over / (4.0 * width);
    for (int k = 0; k < 3; k++) at->turn[k] = over / (2.0 * width) * (normal[k] - at->normal[k]);
}

/* Return the distance of a point beyond which no face reduces the gap more than the best one so far [m]. */
static double reach_of_kink(const kink *at) { return at->gap + at->width - 2.0 * dermis_root(at->less * at->width); }

/* Whether the distance of a point falls along the way from one corner of a triangle to another. normal: see `lowest`. */
static int falls(const dermis_tree *tree, int64_t triangle, int from, int to, const double *normal) {
    double way[3];
    for (int k = 0; k < 3; k++) {
        const double *column = tree->rows + k * tree->total + triangle;
        double ab = column[AB * tree->total], ac = column[AC * tree->total];
        way[k] = (to == 1 ? ab : to == 2 ? ac : 0.0) - (from == 1 ? ab : from == 2 ? ac : 0.0);
    }
    return dermis_dot(normal, way) > FALL * dermis_root(dermis_dot(way, way));
}

/* Return the place of a vertex among the corners of a triangle; 3 if it is none of them. */
static int corner_at(const dermis_body *body, int64_t triangle, int64_t vertex) {
    int corner = 0;
    while (corner < 3 && body->corners[3 * triangle + corner] != vertex) corner++;
    return corner;
}

/* Whether the distance falls from an edge of a triangle into the face beyond it; triangles without area between both are passed,
   at most `passed` of them. normal: see `lowest`. */
static int falls_beyond(const dermis_body *body, int64_t triangle, int edge, const double *normal, int passed) {
    int64_t next = body->across[3 * triangle + edge];
    int own = next < 0 ? 3 : corner_at(body, next, body->corners[3 * triangle + edge]);
    if (own == 3) return 0;
    if (body->tree->rows[INVERSE * body->tree->total + next] > 0.0) return falls(body->tree, next, own, (own + 1) % 3, normal) || falls(body->tree, next, own, (own + 2) % 3, normal);
    for (int k = 0; k < 3 && passed > 0; k++)
        if (body->across[3 * next + k] != triangle && falls_beyond(body, next, k, normal, passed - 1)) return 1;
    return 0;
}

/* Whether the closest point on a triangle is closest among all points near it on the surface.

   If it is on the border, a neighbouring triangle may have closer ones. Counting those alone that are closest makes the
   result independent of how a face is cut into triangles.

   u, w: weights of corners b and c at the closest point. normal: unit vector from there to the point whose distance is measured (3). */
static int lowest(const dermis_body *body, int64_t triangle, double u, double w, const double *normal) {
    int on[3] = {w == 0.0, 1.0 - u - w <= DBL_EPSILON, u == 0.0}; /* edges ab, bc and ca */
    for (int k = 0; k < 3; k++) { /* at corner k; between corners k and k + 1 */
        int corner = on[k] && on[(k + 2) % 3];
        if (!corner && !(on[k] && !on[(k + 1) % 3] && !on[(k + 2) % 3])) continue;
        if (!corner && falls_beyond(body, triangle, k, normal, PASSED)) return 0;
        int64_t vertex = body->corners[3 * triangle + k], at = triangle;
        for (int back = 0; back < 2 * corner; back++) {
            int own = k;
            at = triangle;
            for (int step = 0; step < RING; step++) {
                at = body->across[3 * at + (back ? (own + 2) % 3 : own)];
                own = at < 0 ? 3 : corner_at(body, at, vertex);
                if (own == 3 || at == triangle) break;
                if (falls(body->tree, at, own, (own + 1) % 3, normal) || falls(body->tree, at, own, (own + 2) % 3, normal)) return 0;
                if (!(body->tree->rows[INVERSE * body->tree->total + at] > 0.0) && falls_beyond(body, at, (own + 1) % 3, normal, PASSED)) return 0;
            }
            if (at == triangle) break;
        }
    }
    return 1;
}

static double reduce_by_triangle(void *state, const double *row) {
    kink *at = state;
    double u, w, normal[3], facing[3], distance = dermis_root(dermis_on_triangle(row, at->x, &u, &w));
    if (distance < at->gap + at->width && distance > 0.0) {
        for (int k = 0; k < 3; k++) normal[k] = (at->x[k] - row[k] - u * row[AB + k] - w * row[AC + k]) / distance;
        dermis_cross(row + AB, row + AC, facing);
        double found = at->side * dermis_dot(facing, normal) > 0.0 ? width_of(at, distance, normal) : 0.0;
        if (found > 0.0 && lowest(at->body, (int64_t)row[NUMBER], u, w, normal)) reduce(at, found, distance, normal);
    }
    double reach = reach_of_kink(at);
    return reach < 0.0 ? reach : reach * reach;
}

/* Whether two faces of a body may be equally close to a point outside. */
static int hollow(const dermis_body *body) { return body != NULL && (body->hollow || body->by_rays || body->next != NULL); }

void dermis_round(const dermis_posed *posed, int64_t bodies, const double *x, double width, dermis_sight *sight) {
    double less = 0.0, turn[3] = {0.0, 0.0, 0.0};
    for (int64_t b = 0; b < bodies && sight->body >= 0; b++) {
        const dermis_posed *one = posed + b;
        kink at = {.gap = sight->gap, .width = width, .side = one->side, .less = less};
        if (!(reach_of_kink(&at) > 0.0) || (b == sight->body && !hollow(one->body))) continue;
        localised(one, x, at.x);
        dermis_turned_back(one->rotation, sight->normal, at.normal);
        double plane[4] = {at.normal[0], at.normal[1], at.normal[2], dermis_dot(at.x, at.normal) - at.gap + LOW};
        for (const dermis_body *body = at.body = one->body; body != NULL; at.body = body = body->next)
            if (!dermis_beyond(body, at.x, at.gap + width)) dermis_visit(body->tree, at.x, reach_of_kink(&at), plane, reduce_by_triangle, &at);
        if (one->body == NULL) {
            double gap, normal[3];
            int64_t slot = -1;
            if (measure(one, x, sight->gap + width, &slot, &gap, normal) >= 0) reduce(&at, width_of(&at, gap, one->plane), gap, one->plane);
        }
        if (at.less <= less) continue;
        less = at.less;
        dermis_turned(one->rotation, at.turn, turn);
    }
    sight->gap -= less;
    for (int k = 0; k < 3; k++) sight->normal[k] += turn[k];
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

/* The sharp parts about a point x, in the frame of a body. */
typedef struct {
    const dermis_posed *posed;
    double share, x[3], square; /* square: of the radius [m^2] */
    int found;                  /* out: 1 if there is one */
} sharp_search;

static double find_sharp(void *state, const double *row) {
    sharp_search *of = state;
    double u, w;
    of->found = dermis_share_of(of->posed, (int64_t)row[NUMBER]) > of->share && dermis_on_triangle(row, of->x, &u, &w) < of->square;
    return of->found ? -1.0 : of->square;
}

int dermis_sharp_near(const dermis_posed *posed, double share, const double *x, double radius) {
    sharp_search of = {.posed = posed, .share = share, .square = radius * radius, .found = 0};
    if (!(posed->sharpness > share)) return 0;
    localised(posed, x, of.x);
    for (const dermis_body *body = posed->body; body != NULL && !of.found; body = body->next)
        if (!dermis_beyond(body, of.x, radius)) dermis_visit(body->tree, of.x, radius, NULL, find_sharp, &of);
    return of.found;
}

int dermis_sound_posed(const dermis_posed *posed, int64_t bodies) {
    if (bodies < 0) return 0;
    for (int64_t b = 0; b < bodies; b++) {
        for (const dermis_body *body = posed[b].body; body != NULL; body = body->next)
            if (!dermis_sound_body(body)) return 0;
        if (posed[b].shares != NULL && (posed[b].body == NULL || posed[b].part == NULL)) return 0;
    }
    return 1;
}

int dermis_known_posed(const dermis_posed *posed, int64_t bodies) {
    for (int64_t b = 0; b < bodies; b++) {
        const dermis_posed *one = posed + b;
        if (!dermis_all_finite(one->rotation, 9) || !dermis_all_finite(one->translation, 3) || !dermis_all_finite(one->plane, 4) || !dermis_finite(one->radius + one->rounding)) return 0;
        if (!(one->friction >= 0.0) || !(one->softness >= 0.0) || !dermis_finite(one->friction + one->softness + one->sharpness + one->tie + one->turn)) return 0;
    }
    return 1;
}
