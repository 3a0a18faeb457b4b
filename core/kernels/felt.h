/* Changes of contact forces that the images of some points do not contain yet. For the library's own files only. */
#ifndef DERMIS_FELT_H
#define DERMIS_FELT_H

#include "rows.h"

static inline int any(const double *force) { return force[0] != 0.0 || force[1] != 0.0 || force[2] != 0.0; }

/* Changes of the forces that the images of points with a higher number (later) or with a lower one (earlier) do not contain
   yet (count, 3).

   A sweep visits the points in ascending order, the next one in descending order. A change is needed by the points that the
   sweep still visits, and by the others only in the next sweep. So each sweep needs only half of the compliance. */
typedef struct {
    double *later, *earlier;
} felt;

/* Let the points that the sweep still visits move by a change of the force on a point i, and itself. back: 1 in the second
   sweep of a pair. */
static void pass_on(const rows_of *c, int64_t count, int64_t i, const double *change, int back, const felt *lag, double *image) {
    double *send = (back ? lag->earlier : lag->later) + 3 * i;
    if (any(change)) {
        for (int k = 0; k < 3; k++) lag->later[3 * i + k] += change[k], lag->earlier[3 * i + k] += change[k];
        move(c, i, i + 1, i, change, image);
    }
    if (!any(send)) return;
    move(c, back ? 0 : i + 1, back ? i : count, i, send, image);
    for (int k = 0; k < 3; k++) send[k] = 0.0;
}

/* Let all points feel all forces after a pair of sweeps. */
static inline void pass_rest(const rows_of *c, int64_t count, const felt *lag, double *image) {
    for (int64_t i = 0; i < count; i++) {
        const double none[3] = {0.0, 0.0, 0.0};
        pass_on(c, count, i, none, 0, lag, image);
    }
}

#endif
