/* Unilateral contact with Coulomb friction on a dense compliance.

   The forces are a fixed point f = P(f - w / r) with Alart and Curnier's projection P. A sweep improves one node after
   the other (Gauss-Seidel); sweeps come in pairs, the second in reverse order. Anderson's method accelerates them
   (Walker and Ni, SIAM J. Numer. Anal. 49, 2011). */
#include "anderson.h"
#include "cone.h"
#include "float_environment.h"
#include "kernels.h"
#include "numbers.h"
#include "rows.h"

/* If the forces hardly change any more but the residual is still too large, the limit of their change is multiplied by
   this factor. */
#define STILLER 0.25

/* A compliance in single or double precision; the other pointer is null. */
typedef struct {
    const float *narrow;
    const double *wide;
    int64_t stride; /* numbers from the start of one row to the start of the next */
    int64_t avx2;   /* 1: use AVX2 */
} rows_of;

static inline double entry(const rows_of *c, int64_t row, int64_t column) {
    int64_t at = row * c->stride + column;
    return c->narrow != NULL ? (double)c->narrow[at] : c->wide[at];
}

/* Add the displacement of all nodes for a force on one node to the image.

   AVX2 is used for floats only: with doubles, memory limits the speed. */
static void move_all(const rows_of *c, int64_t count, int64_t node, const double *force, double *image) {
    int64_t first = 3 * node * c->stride;
    double x = force[0], y = force[1], z = force[2];
    if (c->narrow != NULL && c->avx2) {
        add_rows_avx2(3 * count, c->narrow + first, c->stride, force, image);
    } else if (c->narrow != NULL) {
        add_rows(3 * count, c->narrow + first, c->stride, force, image);
    } else {
        const double *a = c->wide + first, *b = a + c->stride, *d = b + c->stride;
        for (int64_t k = 0; k < 3 * count; k++) image[k] += (x * a[k] + y * b[k]) + z * d[k];
    }
}

/* Compute the image C f from the forces. */
static void move_anew(const dermis_contact *contact, const rows_of *c) {
    int64_t count = contact->count;
    for (int64_t k = 0; k < 3 * count; k++) contact->image[k] = 0.0;
    for (int64_t i = 0; i < count; i++) {
        const double *force = contact->force + 3 * i;
        if (force[0] != 0.0 || force[1] != 0.0 || force[2] != 0.0) move_all(c, count, i, force, contact->image);
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
   and with much friction the forces jump back and forth without end. */
static double visit(const dermis_contact *contact, const rows_of *c, int64_t i) {
    double *force = contact->force + 3 * i, free[3], found[3] = {0.0, 0.0, 0.0}, change[3];
    const double *normal = contact->normals + 3 * i, *image = contact->image + 3 * i, *offset = contact->offset + 3 * i;
    int loaded = force[0] != 0.0 || force[1] != 0.0 || force[2] != 0.0;
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
    double square = dermis_dot(change, change);
    if (square > 0.0) move_all(c, contact->count, i, change, contact->image);
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

/* Sweep all nodes of a contact until the residual is within the tolerance. */
static void sweep_all(dermis_contact *contact, const rows_of *c) {
    int64_t count = contact->count;
    double *work = contact->room, still = contact->tolerance, *before = work + 3 * (DERMIS_KEPT + 1) * 3 * count;
    past last = {3 * count, 0, work, 0.0};
    double nearest = __builtin_inf();
    int waited = 0, alone = 0;
    move_anew(contact, c);
    contact->sweeps = 0;
    contact->residual = residual_of(contact, c);
    /* the initial forces may violate the friction limit: unless their residual is exactly 0, sweep at least once */
    while (contact->residual > (contact->sweeps ? contact->tolerance : 0.0) && contact->sweeps < contact->most) {
        double change = 0.0, size = 0.0;
        for (int64_t k = 0; k < 3 * count; k++) before[k] = contact->force[k];
        for (int64_t k = 0; k < count; k++) visit(contact, c, k);
        for (int64_t k = 0; k < count; k++) change += visit(contact, c, count - 1 - k);
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
                accelerate(contact->force, contact->image, &last, before);
            continue;
        }
        move_anew(contact, c);
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
