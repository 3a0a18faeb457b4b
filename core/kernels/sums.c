/* Resultants, depth and slide of a skin's contact in one frame; core/contact/solver/path_step.py describes them. */
#include "float_environment.h"
#include "numbers.h"

/* STEEP: least cosine between a face's normal and the direction to the bone with which the depth is computed.
   BONE_END: extent of the bone along the finger, from the point `bone` towards the tip [m]. */
#define STEEP 0.5
#define BONE_END 4e-3

/* Return the share of a node's penetration that counts as depth: that of its displacement towards the bone in a
   displacement along the normal. */
static double share_of(const dermis_sums *of, int64_t i) {
    const double *normal = of->normals + 3 * i;
    double inward[3], way[3], above = dermis_dot(of->displacement + 3 * i, normal);
    for (int k = 0; k < 3; k++) inward[k] = of->bone[k] - of->points[3 * i + k], way[k] = of->image[3 * i + k] - above * normal[k];
    /* to the nearest part of the bone: beside the bone the direction has no Y part, beyond its end it has one */
    inward[1] = dermis_least(inward[1] + BONE_END, 0.0);
    double straight = dermis_most(dermis_dot(normal, inward), STEEP * dermis_root(dermis_dot(inward, inward)));
    return dermis_clamped(dermis_dot(way, inward) / dermis_most(dermis_dot(way, normal) * straight, 1e-12));
}

DERMIS_NOINLINE static int32_t sum(dermis_sums *of) {
    double moved[3] = {0.0, 0.0, 0.0}, up[3] = {0.0, 0.0, 0.0}, across[3] = {0.0, 0.0, 0.0}, drag[3], along;
    of->normal = of->depth = of->slide = of->size = 0.0, of->sticking = of->slipping = 0;
    for (int k = 0; k < 3; k++) of->resultant[k] = of->mean[k] = 0.0;
    for (int64_t i = 0; i < of->count; i++) {
        const double *force = of->force + 3 * i, *normal = of->normals + 3 * i;
        double press = dermis_dot(force, normal), size = dermis_root(dermis_dot(force, force));
        of->normal += press, of->size += size;
        for (int k = 0; k < 3; k++) {
            of->resultant[k] += force[k], of->mean[k] += size * of->image[3 * i + k];
            across[k] += force[k] - press * normal[k];
            moved[k] += press * of->image[3 * i + k], up[k] += press * normal[k];
        }
        of->sticking += of->status[i] == DERMIS_STICK, of->slipping += of->status[i] == DERMIS_SLIP;
        if (of->gaps != NULL && of->gaps[i] < 0.0) of->depth = dermis_most(of->depth, -of->gaps[i] * (of->from_rest ? 1.0 : share_of(of, i)));
    }
    for (int k = 0; k < 3 && of->size > 0.0; k++) of->mean[k] /= of->size;
    of->tangential = dermis_root(dermis_dot(across, across));
    if (!(of->normal > 0.0)) return DERMIS_DONE;
    for (int k = 0; k < 3; k++) moved[k] /= of->normal;
    double length = dermis_most(dermis_root(dermis_dot(up, up)), 1e-300);
    for (int k = 0; k < 3; k++) up[k] /= length;
    along = dermis_dot(moved, up);
    for (int k = 0; k < 3; k++) drag[k] = moved[k] - along * up[k];
    of->slide = dermis_root(dermis_dot(drag, drag));
    return DERMIS_DONE;
}

static int sound(const dermis_sums *of) { return of->count >= 0 && (of->from_rest == 0 || of->from_rest == 1); }

DERMIS_FUNCTION(dermis_sum, dermis_sums, sound, sum)
