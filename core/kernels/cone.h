/* Coulomb's cone of friction. For the library's own files only. */
#ifndef DERMIS_CONE_H
#define DERMIS_CONE_H

#include "kernels.h"
#include "numbers.h"

/* A force counts as on the surface of its cone above this share of the friction limit. */
#define ON_CONE (1.0 - 1e-9)

/* Return the factor that shortens a tangential force to the friction limit [N]. */
static inline double shortening(const double *side, double most) {
    double length = dermis_root(dermis_dot(side, side));
    return length > most ? most / length : 1.0;
}

/* Alart and Curnier's projection: set tension to zero, and shorten the tangential force to the friction limit. */
static inline void project(double *force, const double *normal, double friction) {
    double along = dermis_dot(force, normal), press = dermis_most(along, 0.0);
    for (int k = 0; k < 3; k++) force[k] -= along * normal[k];
    double share = shortening(force, friction * press);
    for (int k = 0; k < 3; k++) force[k] = press * normal[k] + share * force[k];
}

/* Return the status of a point under its force: 0 open, DERMIS_STICK, or DERMIS_SLIP on the surface of its cone. */
static inline int8_t status_of(const double *force, const double *normal, double friction) {
    double press = dermis_dot(force, normal), side[3];
    for (int k = 0; k < 3; k++) side[k] = force[k] - press * normal[k];
    int on_cone = dermis_root(dermis_dot(side, side)) >= friction * press * ON_CONE;
    return (int8_t)(press > 0.0 ? (on_cone ? DERMIS_SLIP : DERMIS_STICK) : 0);
}

#endif
