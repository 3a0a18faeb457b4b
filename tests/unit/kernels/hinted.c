/* Distances with hints, point by point, as the library's own files ask for them: for a test. */
#include "distance.h"
#include "float_environment.h"

/* slots: in, a hint for each point; out, the slot of each answer. */
DERMIS_API int32_t hinted(dermis_query *query, int64_t *slots);

DERMIS_API int32_t hinted(dermis_query *query, int64_t *slots) {
    dermis_environment outside = dermis_enter();
    for (int64_t i = 0; i < query->count; i++) {
        dermis_distance found;
        dermis_signed_distance(query->body, query->points + 3 * i, query->limit, slots[i], &found);
        slots[i] = found.slot;
        query->gap[i] = found.gap, query->triangle[i] = found.triangle;
        for (int k = 0; k < 3; k++) query->normal[3 * i + k] = found.normal[k];
    }
    dermis_leave(outside);
    return DERMIS_DONE;
}
