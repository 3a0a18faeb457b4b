/* Whether the closest triangle determines the side of every point, or rays are needed.

   The closest triangle is enough if triangles meet only at common edges and corners, if no neighbours lie back to back,
   and if no part of the body is inside the solid of another part. */
#include "boxes.h"
#include "float_environment.h"
#include "rays.h"

/* Neighbours lie back to back if the cosine between their normals is within this of -1. */
#define BACK_TO_BACK 1e-9

/* A triangle: its row, its corners [m], its normal of any length, and its index in the table. */
typedef struct {
    const double *row;
    double corner[3][3], normal[3];
    int64_t number;
} triangle;

/* Fill in a triangle from its row. */
static void put(const double *row, triangle *out) {
    out->row = row, out->number = (int64_t)row[NUMBER];
    for (int k = 0; k < 3; k++)
        out->corner[0][k] = row[k], out->corner[1][k] = row[k] + row[AB + k], out->corner[2][k] = row[k] + row[AC + k];
    dermis_cross(row + AB, row + AC, out->normal);
}

/* Return whether a triangle has corners on both sides of another triangle's plane.

   apart: possible error of the corners [m]. */
static int straddles(const triangle *one, const triangle *other, double apart) {
    int above = 0, below = 0;
    for (int i = 0; i < 3; i++) {
        double offset[3];
        for (int k = 0; k < 3; k++) offset[k] = one->corner[i][k] - other->corner[0][k];
        double height = dermis_dot(offset, other->normal);
        double slack = (DERMIS_ROUNDING * dermis_size(offset) + apart) * dermis_size(other->normal);
        above |= height > slack, below |= height < -slack;
    }
    return above && below;
}

/* Return whether an edge of one triangle passes through another triangle. only: the edge to test, or -1 for all
   three. */
static int pierces(const triangle *one, int only, const triangle *other, double apart) {
    for (int i = 0; i < 3; i++) {
        double way[3], along, depth;
        if (only >= 0 && i != only) continue;
        for (int k = 0; k < 3; k++) way[k] = one->corner[(i + 1) % 3][k] - one->corner[i][k];
        if (dermis_meets(other->row, one->corner[i], way, apart, &along, &depth) == DERMIS_MISSED) continue;
        if (dermis_abs(depth) <= dermis_abs(along)) return 1;
    }
    return 0;
}

/* Return whether two triangles intersect, or are neighbours that lie back to back. */
static int tangled(const dermis_body *body, const triangle *a, const triangle *b, double apart) {
    int shared = 0, of_a = -1, of_b = -1;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            if (body->corners[3 * a->number + i] == body->corners[3 * b->number + j]) shared++, of_a = i, of_b = j;
    if (shared >= 2) {
        double square = dermis_dot(a->normal, a->normal) * dermis_dot(b->normal, b->normal);
        return dermis_dot(a->normal, b->normal) < (BACK_TO_BACK - 1.0) * dermis_root(square);
    }
    if (!straddles(b, a, apart) || !straddles(a, b, apart)) return 0;
    /* If the triangles share a corner, an edge from that corner cannot pass through the other triangle: only the third
       edge is tested. */
    return pierces(a, shared ? (of_a + 1) % 3 : -1, b, apart) || pierces(b, shared ? (of_b + 1) % 3 : -1, a, apart);
}

/* Return whether the triangle in slot `own` is tangled with one in a later slot; see `tangled`. */
static int tangled_after(const dermis_body *body, int64_t own) {
    const dermis_tree *tree = body->all;
    int64_t inner = (((int64_t)1 << 2 * tree->depth) - 1) / 3, blocks = (tree->count + DERMIS_LANES - 1) / DERMIS_LANES;
    int64_t nodes[64];
    double middle[3], radius = 0.0, apart = body->weld + DERMIS_ROUNDING * tree->largest;
    triangle one, other;
    dermis_place place;
    int open = 1;
    put(tree->packed + own * DERMIS_ROW, &one);
    for (int k = 0; k < 3; k++) middle[k] = (one.corner[0][k] + one.corner[1][k] + one.corner[2][k]) / 3.0;
    for (int i = 0; i < 3; i++) {
        double d[3] = {one.corner[i][0] - middle[0], one.corner[i][1] - middle[1], one.corner[i][2] - middle[2]};
        radius = dermis_most(radius, dermis_dot(d, d));
    }
    if (!dermis_placed(tree, middle, &place)) return 1;
    float limit = dermis_limit(tree, radius), squares[DERMIS_LANES];
    nodes[0] = 0;
    while (open) {
        int64_t node = nodes[--open];
        if (node < inner) {
            dermis_away(tree->boxes + node * DERMIS_BOXES, &place, squares);
            for (int k = 0; k < DERMIS_LANES; k++)
                if (squares[k] <= limit) nodes[open++] = 4 * node + 1 + k;
            continue;
        }
        int64_t j = node - inner, low = j * blocks >> 2 * tree->depth, high = (j + 1) * blocks >> 2 * tree->depth;
        for (int64_t b = low; b < high; b++) {
            if (DERMIS_LANES * (b + 1) <= own) continue;
            dermis_away(tree->boxes + (inner + b) * DERMIS_BOXES, &place, squares);
            for (int k = 0; k < DERMIS_LANES; k++) {
                int64_t slot = b * DERMIS_LANES + k;
                if (slot <= own || slot >= tree->count || !(squares[k] <= limit)) continue;
                put(tree->packed + slot * DERMIS_ROW, &other);
                if (tangled(body, &one, &other, apart)) return 1;
            }
        }
    }
    return 0;
}

/* Return whether the part of a triangle may be inside the solid of another part.

   It is not if the winding number just behind the triangle is that of a simple inside: the outside is then in front of
   it. */
static int within_another(const dermis_body *body, int64_t number) {
    double row[DERMIS_ROW], middle[3];
    int64_t winding;
    dermis_gather(body->all, number, row);
    if (!(row[INVERSE] > 0.0)) return 0;
    for (int k = 0; k < 3; k++) middle[k] = row[k] + (row[AB + k] + row[AC + k]) / 3.0;
    return !dermis_winding(body, middle, number, &winding) || winding != body->outside + 1;
}

static int sound(const dermis_body *body) {
    return body != NULL && body->all != NULL && body->all->count >= 1 && body->all->packed != NULL && body->closed;
}

DERMIS_NOINLINE static int32_t judge(dermis_body *body) {
    body->by_rays = 1;
    for (int64_t i = 0; i < body->parts; i++)
        if (within_another(body, body->part[i])) return DERMIS_DONE;
    for (int64_t i = 0; i < body->all->count; i++)
        if (tangled_after(body, i)) return DERMIS_DONE;
    body->by_rays = 0;
    return DERMIS_DONE;
}

DERMIS_FUNCTION(dermis_body_judge, dermis_body, sound, judge)
