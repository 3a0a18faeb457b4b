/* Bodies in the frame of the skin. For the library's own files only. */
#ifndef DERMIS_POSED_H
#define DERMIS_POSED_H

#include "kernels.h"

/* The body that is closest to a point of the skin. */
typedef struct {
    double gap;       /* signed distance; the limit if no body is near [m] */
    double normal[3]; /* unit gradient of the gap; 0 if no body is near */
    int64_t body;     /* index of the body; -1 if no body is near */
    int64_t triangle; /* its closest triangle, 0 for a plane; -1 if no body is near */
    int64_t slot;     /* see `dermis_distance`; in: that of `body` for a point nearby, or -1; it affects only the run
                         time */
} dermis_sight;

/* Find the body that is closest to a point x of the skin [m].

   The far side of a thin body is ignored, even if the skin is pressed in so far that this side is closer. If faces of
   several bodies coincide, the first of these bodies is found.

   limit: largest distance outside a body [m]. behind: how far behind a soft open sheet a point is found, if this is
   more than the limit [m]. inward: unit vector into the finger at x (3). sight: in, a hint, see `slot`; out, the result. */
void dermis_look(const dermis_posed *posed, int64_t bodies, double limit, double behind, const double *x, const double *inward, dermis_sight *sight);

/* Round the kink of the distance where a second face is about as close as the closest one.

   Outside of a body, its distance has kinks where faces meet in a hollow, and between two bodies. A second face reduces
   the gap by up to a quarter of the width, where both are equally close. Faces below the plane through the closest point
   have no influence, so nothing changes at convex edges.

   x: a point of the skin [m]. width: largest difference of the two distances for which the second has an influence [m].
   sight: result of `dermis_look` at x; out: the gap, and its gradient, which is no unit vector. */
void dermis_round(const dermis_posed *posed, int64_t bodies, const double *x, double width, dermis_sight *sight);

/* Whether one flat face of a closed body is all that is within a radius [m] of a point x of the skin [m].

   sight: result of `dermis_look` at x. It is also 0 if this cannot be determined. */
int dermis_sees_plane(const dermis_posed *posed, int64_t bodies, const double *x, double radius, const dermis_sight *sight);

/* Return the share of the largest lift that the part of a body with a triangle needs. */
static inline double dermis_share_of(const dermis_posed *posed, int64_t triangle) {
    return posed->shares == NULL ? posed->sharpness : posed->shares[posed->part[triangle]];
}

/* Whether a triangle of a part that needs more than a share of the largest lift is within a radius [m] of a point x of the skin [m]. */
int dermis_sharp_near(const dermis_posed *posed, double share, const double *x, double radius);

/* `dermis_sound_posed`: whether the counts in the records of bodies have possible values.
   `dermis_known_posed`: whether their numbers are finite, and friction and softness not negative. */
int dermis_sound_posed(const dermis_posed *posed, int64_t bodies);
int dermis_known_posed(const dermis_posed *posed, int64_t bodies);

#endif
