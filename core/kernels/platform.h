/* Kinematics of a thimble's platform. For the library's own files only. */
#ifndef DERMIS_PLATFORM_H
#define DERMIS_PLATFORM_H

#include "kernels.h"

/* Number of values in a configuration; it is the number of legs, too. */
#define THREE 3

/* Number of limits: greatest and least angle of each servo, and the margin; and the index of the margin. */
#define LIMITS 7
#define MARGIN 6

/* Compute the angles of the servos from neutral at a configuration, and the singularity margin; return 0 if a leg cannot
   reach.

   slopes: out: derivatives of the distances from the limits with respect to pitch, roll, and distance over the platform's
   radius (7, 3); null: they are not computed. */
int dermis_close_legs(const dermis_thimble *of, const double *x, double *angles, double *margin, double *slopes);

/* Compute the disc's pose at a configuration with its derivatives, as in `dermis_disc` but for the last three numbers. */
void dermis_place_disc(const dermis_thimble *of, const double *x, double *pose);

#endif
