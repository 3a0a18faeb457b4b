/* Unilateral contact with Coulomb friction on a dense compliance.

   The forces are a fixed point f = P(f - w / r) with Alart and Curnier's projection P. A sweep improves one node after
   the other (Gauss-Seidel); sweeps come in pairs, the second in reverse order. Anderson's method accelerates them
   (Walker and Ni, SIAM J. Numer. Anal. 49, 2011). */
#include "anderson.h"
#include "cone.h"
#include "felt.h"
#include "float_environment.h"
#include "kernels.h"
#include "numbers.h"

/* If the forces hardly change any more but the residual is still too large, the limit of their change is multiplied by
   this factor. */
#define STILLER 0.25

static inline double entry(const rows_of *c, int64_t row, int64_t column) {
    int64_t at = row * c->stride + column;
    return c->narrow != NULL ? (double)c->narrow[at] : c->wide[at];
}

/* Compute the image C f from the forces. */
static void move_anew(const dermis_contact *contact, const rows_of *c) {
    int64_t count = contact->count;
    for (int64_t k = 0; k < 3 * count; k++) contact->image[k] = 0.0;
    for (int64_t i = 0; i < count; i++) {
        const double *force = contact->force + 3 * i;
        if (any(force)) move(c, 0, count, i, force, contact->image);
    }
}

/* Whether a body is near the node. Otherwise the normal is zero, up to rounding. */
static int near(const double *normal) { return dermis_dot(normal, normal) > 0.5; }

/* Return the trace of a node's own compliance, including that of the body below it. No eigenvalue is larger. */
static double own_of(const rows_of *c, int64_t node, double softness) {
    double sum = 3.0 * softness;
    for (int64_t k = 3 * node; k < 3 * node + 3; k++) sum += entry(c, k, k);
    return sum;
}

/* Improve the force on one node while all other forces are fixed; return the squared change of the force.

   This is one step of the fixed-point iteration. With an exact solution for each single node, more sweeps are needed,
   and with much friction the forces jump back and forth without end. change: out (3). */
static double improve(const dermis_contact *contact, const rows_of *c, int64_t i, double *change) {
    double *force = contact->force + 3 * i, free[3], found[3] = {0.0, 0.0, 0.0};
    const double *normal = contact->normals + 3 * i, *image = contact->image + 3 * i, *offset = contact->offset + 3 * i;
    int loaded = any(force);
    for (int k = 0; k < 3; k++) change[k] = 0.0;
    if (near(normal)) {
        for (int k = 0; k < 3; k++) free[k] = image[k] + offset[k];
        if (!loaded && dermis_dot(free, normal) >= 0.0) return 0.0;
        double soft = contact->softness[i], trace = own_of(c, i, soft);
        for (int k = 0; k < 3; k++) found[k] = force[k] - (free[k] + soft * force[k]) / trace;
        project(found, normal, contact->friction[i]);
    } else if (!loaded) {
        return 0.0;
    }
    for (int k = 0; k < 3; k++) change[k] = found[k] - force[k], force[k] = found[k];
    return dermis_dot(change, change);
}

/* Improve the force on one node, and let others feel it; return the squared change. back: 1 in the second sweep of a pair. */
static double visit(const dermis_contact *contact, const rows_of *c, int64_t i, int back, const felt *lag) {
    double change[3], square = improve(contact, c, i, change);
    pass_on(c, contact->count, i, change, back, lag, contact->image);
    return square;
}

/* Return the residual of f = P(f - w / own), relative to the larger norm of both sides, as `cone.assess` does.

   It is infinite if a number in it is not finite. Otherwise a NaN would end the sweeps like a small residual. */
static double residual_of(const dermis_contact *contact, const rows_of *c) {
    double error = 0.0, size = 0.0, projected = 0.0;
    for (int64_t i = 0; i < contact->count; i++) {
        const double *force = contact->force + 3 * i, *normal = contact->normals + 3 * i;
        const double *image = contact->image + 3 * i, *offset = contact->offset + 3 * i;
        double soft = contact->softness[i], own = own_of(c, i, soft) / 3.0, v[3];
        for (int k = 0; k < 3; k++) v[k] = force[k] - (image[k] + soft * force[k] + offset[k]) / own;
        if (near(normal))
            project(v, normal, contact->friction[i]);
        else
            v[0] = v[1] = v[2] = 0.0;
        size += dermis_dot(force, force), projected += dermis_dot(v, v);
        for (int k = 0; k < 3; k++) v[k] -= force[k];
        error += dermis_dot(v, v);
    }
    if (!dermis_finite(error + size + projected)) return __builtin_inf();
    size = dermis_most(size, projected);
    return size > 0.0 ? dermis_root(error / size) : 0.0;
}

/* Whether all numbers of the nodes are finite, and friction and softness not negative; `wrong` is the node that is
   not. */
static int known(dermis_contact *contact) {
    for (int64_t i = 0; i < contact->count; i++) {
        const double *given[] = {contact->offset + 3 * i, contact->normals + 3 * i, contact->force + 3 * i};
        contact->wrong = i;
        for (int a = 0; a < 3; a++)
            if (!dermis_all_finite(given[a], 3)) return 0;
        if (!(contact->friction[i] >= 0.0 && dermis_finite(contact->friction[i]))) return 0;
        if (!(contact->softness[i] >= 0.0 && dermis_finite(contact->softness[i]))) return 0;
    }
    return 1;
}

_Static_assert(12 * DERMIS_KEPT + 21 == DERMIS_SWEEP_ROOM, "the workspace");

/* Sweep all nodes of a contact until the residual is within the tolerance. */
static void sweep_all(dermis_contact *contact, const rows_of *c) {
    int64_t count = contact->count;
    double *work = contact->room, still = contact->tolerance, *before = work + 4 * (DERMIS_KEPT + 1) * 3 * count;
    felt lag = {before + 3 * count, before + 6 * count};
    past last = {3 * count, 0, work, 0.0};
    double nearest = __builtin_inf();
    int waited = 0, alone = 0;
    for (int64_t k = 0; k < 3 * count; k++) lag.later[k] = lag.earlier[k] = 0.0;
    move_anew(contact, c);
    contact->sweeps = 0;
    contact->residual = residual_of(contact, c);
    /* the initial forces may violate the friction limit: unless their residual is exactly 0, sweep at least once */
    while (contact->residual > (contact->sweeps ? contact->tolerance : 0.0) && contact->sweeps < contact->most) {
        double change = 0.0, size = 0.0;
        for (int64_t k = 0; k < 3 * count; k++) before[k] = contact->force[k];
        for (int64_t k = 0; k < count; k++) visit(contact, c, k, 0, &lag);
        for (int64_t k = 0; k < count; k++) change += visit(contact, c, count - 1 - k, 1, &lag);
        for (int64_t k = 0; k < 3 * count; k++) size += contact->force[k] * contact->force[k];
        contact->sweeps += 2;
        if (!dermis_finite(size)) { /* forces grow without limit if the compliance is not positive definite */
            for (int64_t k = 0; k < 3 * count; k++) contact->force[k] = contact->image[k] = 0.0;
            contact->residual = __builtin_inf();
            break;
        }
        if (change > still * still * size && contact->sweeps < contact->most) {
            waited = change < nearest ? 0 : waited + 1;
            nearest = dermis_least(nearest, change);
            if (waited > PATIENCE) alone = ALONE, waited = 0;
            if (alone > 0)
                alone--, last.kept = 0;
            else
                accelerate(contact->force, contact->image, lag.later, &last, before);
            continue;
        }
        move_anew(contact, c);
        for (int64_t k = 0; k < 3 * count; k++) lag.later[k] = 0.0;
        contact->residual = residual_of(contact, c);
        still *= STILLER;
    }
}

/* Compute the relative displacements, and the status of each node. */
static void assess(dermis_contact *contact) {
    for (int64_t i = 0; i < contact->count; i++) {
        const double *force = contact->force + 3 * i;
        for (int k = 0; k < 3; k++)
            contact->moved[3 * i + k] = contact->image[3 * i + k] + contact->softness[i] * force[k] + contact->offset[3 * i + k];
        contact->status[i] = status_of(force, contact->normals + 3 * i, contact->friction[i]);
    }
}

DERMIS_NOINLINE static int32_t sweep(dermis_contact *contact) {
    if (!known(contact)) return DERMIS_NOT_FINITE;
    rows_of c = {contact->single ? contact->compliance : NULL, contact->single ? NULL : contact->compliance, contact->stride, contact->avx2};
    sweep_all(contact, &c);
    assess(contact);
    return DERMIS_DONE;
}

static int sound(const dermis_contact *contact) {
    return contact->count >= 0 && contact->stride >= 3 * contact->count && contact->most >= 0 && contact->tolerance >= 0.0 &&
           (contact->single == 0 || contact->single == 1) && (contact->avx2 == 0 || contact->avx2 == 1);
}

DERMIS_FUNCTION(dermis_sweep, dermis_contact, sound, sweep)
