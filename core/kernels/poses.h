/* Poses of bodies in the frame of the skin, as rows of DERMIS_POSE numbers. For the library's own files only. */
#ifndef DERMIS_POSES_H
#define DERMIS_POSES_H

#include "numbers.h"

/* Turn a vector from the axes of the body to those of the skin, and back. */
static inline void dermis_turned(const double *pose, const double *v, double *out) {
    for (int k = 0; k < 3; k++) out[k] = dermis_dot(pose + 3 * k, v);
}

static inline void dermis_turned_back(const double *pose, const double *v, double *out) {
    for (int k = 0; k < 3; k++) out[k] = pose[k] * v[0] + pose[3 + k] * v[1] + pose[6 + k] * v[2];
}

#endif
