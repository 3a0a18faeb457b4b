/* Bodies in the frame of the skin: for the library's own files. */
#ifndef DERMIS_POSED_H
#define DERMIS_POSED_H

#include "kernels.h"

/* What a point of the skin sees: the closest body. */
typedef struct {
    double gap;       /* signed distance; the limit where nothing is near [m] */
    double normal[3]; /* unit gradient of the gap; 0 where nothing is near */
    int64_t body;     /* -1 where nothing is near */
    int64_t triangle; /* of that body, -1 where nothing is near, 0 of a plane */
    int64_t slot;     /* in: of an answer nearby by `body`, or -1; it changes the time alone. out: of this one */
} dermis_sight;

/* Look for the body that is closest to a point of the skin at x; inward is a unit vector into the finger there.

   The far side of something thinner than the skin is pressed in by is not seen. */
void dermis_look(const dermis_posed *posed, int64_t bodies, double limit, const double *x, const double *inward, dermis_sight *sight);

/* Whether all that is within a radius [m] of a point of the skin at x is one face of a closed body: the one that is seen. */
int dermis_sees_plane(const dermis_posed *posed, int64_t bodies, const double *x, double radius, const dermis_sight *sight);

/* Whether the records of bodies can be such, and whether their numbers are finite. */
int dermis_sound_posed(const dermis_posed *posed, int64_t bodies);
int dermis_known_posed(const dermis_posed *posed, int64_t bodies);

#endif
