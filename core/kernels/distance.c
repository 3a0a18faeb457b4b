/* The signed distance of a point to a body.

   If a closed body does not intersect itself, the angle-weighted normal of the closest face, edge or corner determines
   whether the point is inside (Baerentzen and Aanaes 2005). If it does intersect itself, or if the closest edge or
   corner is irregular, the winding number determines it, which is counted along rays. If several solids overlap, the
   smallest of their signed distances is taken. For an open sheet, the distance is negative behind its faces; points
   beyond its rim are outside. */
#include "distance.h"

#include "closest.h"
#include "float_environment.h"
#include "rays.h"

/* A point whose closest point is on a rim is straight above the rim if its offset across the normal is at most this
   share of its distance. Otherwise it is beyond the rim. */
#define STRAIGHT 1e-6
/* Up to this distance [m], the direction to the closest point is not accurate, so the surface's normal is used
   instead. */
#define ON_SURFACE 1e-9
/* Boxes and distances are enlarged by this share for rounding. */
#define SLACK 1e-9
/* A pseudonormal that is not longer than this has no direction. */
#define NO_LENGTH 1e-9

/* Sine of the angle between two faces from which a concave edge makes a body hollow; vertices of flat faces are rounded
   to less. */
#define HOLLOW 1e-3

/* Add the unit normals of faces, weighted by the faces' angles, to the sums of their vertices.

   vertex: the only vertex whose sum is wanted, or -1 for all. out: the sum (3), or those of all vertices (vertices,
   3). */
static void add_normals(const dermis_body *body, int64_t vertex, double *out) {
    const dermis_tree *tree = body->tree;
    int64_t total = tree->total;
    const double *ab_ab = tree->rows + AB_AB * total, *ac_ac = tree->rows + AC_AC * total, *ab_ac = tree->rows + AB_AC * total;
    for (int64_t j = 0; j < total; j++) {
        const int64_t *corners = body->corners + 3 * j;
        if (vertex >= 0 && corners[0] != vertex && corners[1] != vertex && corners[2] != vertex) continue;
        if (!(tree->rows[INVERSE * total + j] > 0.0)) continue;
        double area = dermis_root(dermis_most(ab_ab[j] * ac_ac[j] - ab_ac[j] * ab_ac[j], 0.0));
        double angle[3] = {dermis_angle(area, ab_ac[j]), dermis_angle(area, ab_ab[j] - ab_ac[j]), 0.0};
        angle[2] = PI - angle[0] - angle[1];
        for (int i = 0; i < 3; i++) {
            double *sum = vertex < 0 ? out + 3 * corners[i] : out;
            for (int k = 0; k < 3 && (vertex < 0 || corners[i] == vertex); k++)
                sum[k] += angle[i] * tree->bounds[(3 + k) * total + j];
        }
    }
}

/* Compute the pseudonormal of the closest face, edge or corner, of any length; return its kind, such as
   DERMIS_REGULAR. */
static int pseudonormal(const dermis_body *body, const dermis_closest_point *found, double *out) {
    const dermis_tree *tree = body->tree;
    int64_t triangle = (int64_t)found->row[NUMBER];
    if (found->feature >= 4) {
        int64_t vertex = body->corners[3 * triangle + found->feature - 4];
        for (int k = 0; k < 3; k++) out[k] = body->normals != NULL ? body->normals[3 * vertex + k] : 0.0;
        if (body->normals == NULL) add_normals(body, vertex, out);
        return body->vertex_kind[vertex];
    }
    if (body->convex != NULL)
        for (int k = 0; k < 3; k++) out[k] = body->convex->facing[4 * found->slot + k];
    else
        dermis_facing(found->row, out);
    if (found->feature == 0) return DERMIS_REGULAR;
    int64_t edge = 3 * triangle + found->feature - 1, other = body->across[edge];
    if (other < 0) return body->edge_kind[edge];
    for (int k = 0; k < 3; k++) out[k] += tree->bounds[(3 + k) * tree->total + other];
    return tree->rows[INVERSE * tree->total + other] > 0.0 ? body->edge_kind[edge] : DERMIS_IRREGULAR;
}

/* Determine the side of a point from its closest triangle, and fill in the results. */
static void measure(const dermis_body *body, const double *x, const dermis_closest_point *found, dermis_distance *out) {
    double offset[3], pseudo[3], sign;
    int kind = pseudonormal(body, found, pseudo);
    for (int k = 0; k < 3; k++) offset[k] = x[k] - found->point[k];
    double distance = dermis_root(dermis_einsum(offset, offset)), along = dermis_einsum(offset, pseudo);
    sign = along < 0.0 ? -1.0 : 1.0;
    out->beside = 0;
    if (kind == DERMIS_BOUNDARY) {
        double height = along / dermis_most(dermis_root(dermis_einsum(pseudo, pseudo)), 1e-300);
        double aside = dermis_root(dermis_most(distance * distance - height * height, 0.0));
        out->beside = aside > STRAIGHT * distance;
        if (out->beside) sign = 1.0;
    } else if (body->closed && body->all != NULL && distance > ON_SURFACE && (body->by_rays || kind == DERMIS_IRREGULAR)) {
        int64_t winding;
        if (dermis_winding(body, x, -1, &winding)) sign = winding > body->outside ? -1.0 : 1.0;
    }
    out->gap = sign * distance;
    if (distance <= ON_SURFACE) {
        double length = dermis_root(dermis_einsum(pseudo, pseudo));
        if (!(length > NO_LENGTH)) dermis_facing(found->row, pseudo), length = 1.0;
        for (int k = 0; k < 3; k++) out->normal[k] = pseudo[k] / length;
    } else {
        for (int k = 0; k < 3; k++) out->normal[k] = offset[k] * (sign / distance);
    }
    for (int k = 0; k < 3; k++) out->point[k] = found->point[k], out->weights[k] = found->weights[k];
    out->triangle = (int64_t)found->row[NUMBER], out->slot = found->slot, out->feature = found->feature;
}

/* Return whether a point may be inside a body although no triangle is within the limit [m].

   A ball of that radius around the point would then be in the body, and therefore within each slab. */
static int may_be_inside(const dermis_body *body, const double *x, double limit) {
    for (int64_t i = 0; i < body->slabs; i++) {
        const double *slab = body->slab + 5 * i;
        double along = dermis_dot(x, slab);
        if (dermis_most(along - slab[4], slab[3] - along) > -limit) return 0;
    }
    return 1;
}

int dermis_beyond(const dermis_body *body, const double *x, double limit) {
    double square = 0.0;
    limit *= 1.0 + SLACK;
    limit *= limit;
    for (int k = 0; k < 3 && !(square > limit); k++) {
        double over = dermis_most(dermis_most(body->low[k] - x[k], x[k] - body->high[k]), 0.0);
        square += over * over;
    }
    return square > limit;
}

/* Find the closest triangle; see `dermis_find_closest`. */
static int find(const dermis_body *body, const double *x, double limit, int64_t hint, dermis_closest_point *out) {
    if (hint >= body->tree->count) hint = -1;
    if (body->convex != NULL && !body->by_rays) {
        int found = dermis_walk_to_closest(body->tree, body->convex, x, limit, &hint, out);
        if (found >= 0) return found;
    }
    return dermis_find_closest(body->tree, x, limit, hint, out);
}

/* Fill in the results for a point with no triangle within the limit. */
static void nothing(dermis_distance *out) {
    out->gap = __builtin_inf(), out->triangle = out->slot = -1;
    for (int k = 0; k < 3; k++) out->normal[k] = 0.0;
}

/* Measure the signed distance to the first solid of a body only, which is not beyond the limit; see `dermis_beyond`. */
static void one(const dermis_body *body, const double *x, double limit, int64_t hint, dermis_distance *out) {
    dermis_closest_point found;
    if (find(body, x, limit, hint, &found)) {
        measure(body, x, &found, out);
        return;
    }
    if (body->closed && limit <= DBL_MAX && may_be_inside(body, x, limit) &&
        dermis_find_closest(body->tree, x, __builtin_inf(), hint, &found)) {
        measure(body, x, &found, out);
        if (out->gap < 0.0) return;
    }
    nothing(out);
}

void dermis_signed_distance(const dermis_body *body, const double *x, double limit, int64_t hint, dermis_distance *out) {
    const dermis_body *first = body;
    int64_t start = 0, before = 0;
    /* The solid of the hint is probably the closest one. It is measured first, so that others need not be searched
       farther than it is. */
    for (; first->next != NULL && hint - start >= first->tree->count; first = first->next) start += first->tree->count;
    if (dermis_beyond(first, x, limit))
        nothing(out);
    else
        one(first, x, limit, hint - start, out);
    if (out->triangle >= 0) out->slot += start;
    for (const dermis_body *next = body; next != NULL; before += next->tree->count, next = next->next) {
        dermis_distance other;
        /* A solid farther away than the closest one so far need not be found; even a limit of 0 finds points inside.
           The inside of a solid that is inside out is unbounded, and `may_be_inside` misses points beyond its slabs, so
           the limit stays. */
        double nearer = next->outside < 0 ? limit : dermis_most(dermis_least(limit, before < start ? out->gap * (1.0 + SLACK) : out->gap), 0.0);
        if (next == first || dermis_beyond(next, x, nearer)) continue;
        one(next, x, nearer, hint - before, &other);
        /* of two solids at the same distance, the one that comes first counts */
        if (other.gap < out->gap || (other.triangle >= 0 && other.gap == out->gap && before < start)) {
            *out = other, out->slot += before;
            start = before;
        }
    }
}

static int sound_tree(const dermis_tree *tree) {
    return tree != NULL && tree->count >= 1 && tree->count <= tree->total && tree->depth >= 0 && tree->depth <= 15;
}

int dermis_sound_body(const dermis_body *body) {
    return body != NULL && sound_tree(body->tree) && (body->all == NULL || sound_tree(body->all)) && body->vertices >= 1 &&
           body->parts >= 0 && body->slabs >= 0 && body->weld >= 0.0;
}

static int sound(const dermis_query *query) {
    if (query->body == NULL) return 0;
    for (const dermis_body *body = query->body; body != NULL; body = body->next)
        if (!dermis_sound_body(body)) return 0;
    return query->count >= 0 && query->limit >= 0.0;
}

/* Whether faces meet in a hollow: at a concave edge, or at an edge of several faces. Both sides of an open sheet count. */
static int hollow(const dermis_body *body) {
    const dermis_tree *tree = body->tree;
    int64_t total = tree->total;
    for (int64_t slot = 0; slot < tree->count; slot++)
        for (int i = 0; i < 3; i++) {
            int64_t j = tree->order[slot], other = body->across[3 * j + i];
            double facing[3], next[3], edge[3], turned[3];
            if (other < 0 && body->edge_kind[3 * j + i] == DERMIS_BOUNDARY) continue;
            if (other < 0 || !(tree->rows[INVERSE * total + other] > 0.0)) return 1;
            for (int k = 0; k < 3; k++) {
                double ab = tree->rows[(AB + k) * total + j], ac = tree->rows[(AC + k) * total + j];
                facing[k] = tree->bounds[(3 + k) * total + j], next[k] = tree->bounds[(3 + k) * total + other];
                edge[k] = i == 0 ? ab : i == 1 ? ac - ab : -ac;
            }
            dermis_cross(facing, next, turned);
            double along = dermis_dot(turned, edge) / dermis_root(dermis_dot(edge, edge));
            if (!body->closed) along = -dermis_abs(along);
            if (along < -HOLLOW || (along < 0.0 && dermis_dot(facing, next) < 0.0)) return 1;
        }
    return 0;
}

DERMIS_NOINLINE static int32_t fit(dermis_body *body) {
    int64_t total = body->tree->total;
    if (body->all != NULL && body->all->total != total) return DERMIS_BAD_RECORD;
    for (int64_t i = 0; i < 3 * total; i++) {
        if (body->corners[i] < 0 || body->corners[i] >= body->vertices) return DERMIS_BAD_RECORD;
        if (body->across[i] < -1 || body->across[i] >= total) return DERMIS_BAD_RECORD;
    }
    for (int64_t i = 0; i < body->parts; i++)
        if (body->part[i] < 0 || body->part[i] >= total) return DERMIS_BAD_RECORD;
    body->hollow = body->hollow || hollow(body);
    for (int k = 0; k < 3; k++) {
        body->low[k] = -__builtin_inf(), body->high[k] = __builtin_inf();
        if (k >= body->slabs) continue;
        const double *slab = body->slab + 5 * k;
        double more = SLACK * (dermis_abs(slab[3]) + dermis_abs(slab[4]));
        body->low[k] = slab[3] - more, body->high[k] = slab[4] + more;
    }
    if (body->normals == NULL) return DERMIS_DONE;
    for (int64_t i = 0; i < 3 * body->vertices; i++) body->normals[i] = 0.0;
    add_normals(body, -1, body->normals);
    return DERMIS_DONE;
}

int32_t dermis_known_triangles(const dermis_body *body, int64_t *wrong) {
    const dermis_tree *tree = body->tree;
    for (int64_t j = 0; j < tree->count && tree->packed == NULL; j++) {
        double inverse = tree->rows[INVERSE * tree->total + tree->order[j]];
        *wrong = -1 - tree->order[j];
        if (!(inverse > 0.0 && dermis_finite(inverse))) return DERMIS_NOT_FINITE;
    }
    return DERMIS_DONE;
}

DERMIS_NOINLINE static int32_t distances(dermis_query *query) {
    int32_t status = dermis_known_triangles(query->body, &query->wrong);
    int64_t slot = -1; /* hint: slot for the last point, since consecutive points are usually near each other */
    for (int64_t i = 0; i < query->count && status == DERMIS_DONE; i++) {
        const double *x = query->points + 3 * i;
        dermis_distance found;
        query->wrong = i;
        if (!dermis_all_finite(x, 3)) return DERMIS_NOT_FINITE;
        dermis_signed_distance(query->body, x, query->limit, slot, &found);
        int met = found.triangle >= 0;
        if (met) slot = found.slot;
        query->gap[i] = found.gap, query->triangle[i] = found.triangle;
        query->feature[i] = (int8_t)(met ? found.feature : 0), query->beside[i] = (int8_t)(met && found.beside);
        for (int k = 0; k < 3; k++) {
            query->normal[3 * i + k] = found.normal[k];
            query->closest[3 * i + k] = met ? found.point[k] : __builtin_nan("");
            query->weights[3 * i + k] = met ? found.weights[k] : 0.0;
        }
    }
    return status;
}

DERMIS_NOINLINE static int32_t find_bulge(dermis_body *body) {
    dermis_convex *convex = body->convex;
    if (convex == NULL) return DERMIS_BAD_RECORD;
    for (int64_t i = 0; i < 3 * body->tree->count; i++)
        if (convex->beside[i] < -1 || convex->beside[i] >= body->tree->count) return DERMIS_BAD_RECORD;
    convex->bulge = dermis_bulge(body->tree, convex->facing);
    return DERMIS_DONE;
}

DERMIS_FUNCTION(dermis_body_fit, dermis_body, dermis_sound_body, fit)
DERMIS_FUNCTION(dermis_body_bulge, dermis_body, dermis_sound_body, find_bulge)
DERMIS_FUNCTION(dermis_distances, dermis_query, sound, distances)
