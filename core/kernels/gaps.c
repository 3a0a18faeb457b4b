/* Gaps of a skin's nodes to one body, measured at the positions where the nodes are expected. */
#include "distance.h"
#include "float_environment.h"
#include "numbers.h"
#include "poses.h"

/* A node may have passed to the other side of a thin body if the cosine between its last normal and the present one is
   below this. */
#define SAME_SIDE 0.5

/* Convert the expected places to the frame of the body; return whether their bounding box is within the radius of the
   box of the body. The result is stored where the normals will be. */
static int local_places(const dermis_gaps *of, double *local) {
    double low[3] = {__builtin_inf(), __builtin_inf(), __builtin_inf()}, high[3] = {-low[0], -low[0], -low[0]};
    for (int64_t i = 0; i < of->count; i++) {
        double from[3];
        for (int k = 0; k < 3; k++) from[k] = of->places[3 * i + k] - of->pose[9 + k];
        dermis_turned_back(of->pose, from, local + 3 * i);
        for (int k = 0; k < 3; k++) {
            low[k] = dermis_least(low[k], local[3 * i + k]);
            high[k] = dermis_most(high[k], local[3 * i + k]);
        }
    }
    for (int k = 0; k < 3; k++)
        if (!(high[k] + of->radius >= of->box[k] && low[k] - of->radius <= of->box[3 + k])) return 0;
    return 1;
}

DERMIS_NOINLINE static int32_t measure(dermis_gaps *of) {
    int64_t n = of->count, slot = -1;
    double *clearance = of->told, *gap = clearance + n, *friction = gap + n, *softness = friction + n, *normal = softness + n;
    int64_t *owner = of->which, *triangle = owner + n, *turned = triangle + n;
    of->turned = 0, of->wrong = -1, of->met = 0;
    for (int64_t k = 0; k < 3 * n; k++) {
        of->wrong = k / 3;
        if (!dermis_finite(of->places[k]) || !dermis_finite(of->points[k])) return DERMIS_NOT_FINITE;
    }
    of->wrong = -1;
    if (!dermis_all_finite(of->pose, 12)) return DERMIS_NOT_FINITE;
    of->met = local_places(of, normal);
    if (!of->met) return DERMIS_DONE;
    int32_t status = dermis_known_triangles(of->body, &of->wrong);
    for (int64_t i = 0; i < n && status == DERMIS_DONE; i++) {
        dermis_distance found;
        double *out = normal + 3 * i, own[3], moved = 0.0;
        dermis_signed_distance(of->body, out, of->radius, slot, &found);
        int met = found.triangle >= 0;
        double side = met && !found.beside ? of->side : 1.0;
        if (met) slot = found.slot;
        for (int k = 0; k < 3; k++) own[k] = side * found.normal[k];
        dermis_turned(of->pose, own, out);
        for (int k = 0; k < 3; k++) moved += (of->places[3 * i + k] - of->points[3 * i + k]) * out[k];
        clearance[i] = side * found.gap, gap[i] = clearance[i] - moved;
        owner[i] = met ? of->index : -1, triangle[i] = found.triangle;
        friction[i] = met ? of->friction : 0.0, softness[i] = met ? of->softness : 0.0;
        if (met && of->came != NULL && of->came[i] == of->index && dermis_dot(of->before + 3 * i, out) < SAME_SIDE) turned[of->turned++] = i;
    }
    return status;
}

static int sound(const dermis_gaps *of) {
    if (of->body == NULL) return 0;
    for (const dermis_body *body = of->body; body != NULL; body = body->next)
        if (!dermis_sound_body(body)) return 0;
    return of->count >= 0 && of->radius >= 0.0 && (of->side == 1.0 || of->side == -1.0);
}

DERMIS_FUNCTION(dermis_node_gaps, dermis_gaps, sound, measure)
