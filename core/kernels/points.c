/* Removal of contact points from the compliance between them; core/contact/solver/point_matrix.py describes it. */
#include "float_environment.h"
#include "kernels.h"

/* Copy the three numbers of each moved point within a row. */
static void fill(const dermis_moves *of, const float *from, float *row) {
    for (int64_t j = 0; j < of->moved; j++) __builtin_memcpy(row + 3 * of->places[j], from + 3 * of->former[j], 3 * sizeof(float));
}

/* The last points take the places of those that were removed. */
DERMIS_NOINLINE static int32_t move(dermis_moves *of) {
    int64_t next = 0;
    for (int64_t i = 0; i < of->count; i++) {
        int taken = next < of->moved && of->places[next] == i;
        int64_t was = taken ? of->former[next++] : i;
        for (int64_t row = 3 * i, old = 3 * was; row < 3 * i + 3; row++, old++) {
            const float *from = of->from + old * of->width;
            float *to = of->to + row * of->stride;
            if (to != from) __builtin_memcpy(to, from, 3 * of->count * sizeof(float));
            fill(of, from, to);
        }
    }
    return DERMIS_DONE;
}

static int sound(const dermis_moves *of) {
    if (of->count < 0 || of->moved < 0 || of->moved > of->count || of->width < 3 * of->count || of->stride < 3 * of->count) return 0;
    for (int64_t j = 0; j < of->moved; j++) {
        if (of->places[j] < 0 || of->places[j] >= of->count || (j > 0 && of->places[j] <= of->places[j - 1])) return 0;
        if (of->former[j] < of->count || of->former[j] >= of->width / 3) return 0;
    }
    return 1;
}

DERMIS_FUNCTION(dermis_move_points, dermis_moves, sound, move)
