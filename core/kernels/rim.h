/* The rounded rim of a disc. For the library's own files only. */
#ifndef DERMIS_RIM_H
#define DERMIS_RIM_H

#include "numbers.h"

/* Return how far a disc's rim lies below the plane of its flat face [m]. It falls as a parabola.

   radius, rounding: radii of the flat face and of the rim [m]. reach: distance from the disc's axis [m]. */
static inline double dermis_rim(double radius, double rounding, double reach) {
    double over = dermis_most(reach - radius, 0.0);
    return over * over * (0.5 / rounding);
}

#endif
