/* Changes of the set of contact points: the compliance between them, and their state. core/contact/solver/point_matrix.py
   and succession.py describe them. */
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
            const float *from = of->given + old * of->width;
            float *to = of->out + row * of->stride;
            if (to != from) __builtin_memcpy(to, from, (size_t)(3 * of->count) * sizeof(float));
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

/* Return the share of a tile's area that another tile covers. */
static double covered(const dermis_heirs *of, int64_t tile, int64_t other) {
    double share = 1.0;
    if (of->root[tile] != of->root[other]) return 0.0;
    for (int k = 0; k < 2; k++) {
        int64_t size = ((int64_t)1 << of->levels) >> of->halved[2 * tile + k], side = ((int64_t)1 << of->levels) >> of->halved[2 * other + k];
        int64_t start = of->place[2 * tile + k] * size, begin = of->place[2 * other + k] * side;
        int64_t end = start + size < begin + side ? start + size : begin + side, both = end - (start > begin ? start : begin);
        if (both <= 0) return 0.0;
        share *= (double)both / (double)size;
    }
    return share;
}

/* Distribute the forces of removed cells to the cells that they overlap, and find the cell of largest load below each. */
DERMIS_NOINLINE static int32_t succeed(dermis_heirs *of) {
    for (int64_t j = 0; j < of->entering; j++) {
        of->main[j] = -1, of->load[j] = 0.0;
        for (int k = 0; k < 3; k++) of->inherited[3 * j + k] = 0.0;
    }
    for (int64_t i = 0; i < of->leaving; i++) {
        const double *force = of->force + 3 * of->sources[i];
        double total = 0.0, load = force[0] * force[0] + force[1] * force[1] + force[2] * force[2];
        for (int64_t j = 0; j < of->entering; j++) total += covered(of, of->left[i], of->entered[j]);
        if (!(total > 0.0)) continue;
        for (int64_t j = 0; j < of->entering; j++) {
            double share = covered(of, of->left[i], of->entered[j]) / total;
            if (share == 0.0) continue;
            for (int k = 0; k < 3; k++) of->inherited[3 * j + k] += share * force[k];
            if (of->main[j] < 0 || load > of->load[j]) of->main[j] = of->sources[i], of->load[j] = load;
        }
    }
    return DERMIS_DONE;
}

static int tiles(const dermis_heirs *of, const int64_t *cells, int64_t count) {
    for (int64_t k = 0; k < count; k++)
        if (cells[k] < 0 || cells[k] >= of->tiles) return 0;
    return 1;
}

static int sound_heirs(const dermis_heirs *of) {
    if (of->levels < 0 || of->levels > 31 || of->leaving < 0 || of->entering < 0 || of->former < 0) return 0;
    for (int64_t i = 0; i < of->leaving; i++)
        if (of->sources[i] < 0 || of->sources[i] >= of->former) return 0;
    return tiles(of, of->left, of->leaving) && tiles(of, of->entered, of->entering);
}

DERMIS_FUNCTION(dermis_succeed, dermis_heirs, sound_heirs, succeed)

/* Copy the state of points to their new places, array after array; other points get the blank state. */
DERMIS_NOINLINE static int32_t rearrange(dermis_states *of) {
    const uint8_t *from = of->given;
    uint8_t *to = of->out;
    for (int64_t k = 0; k < of->arrays; k++) {
        int64_t width = of->widths[k];
        for (int64_t i = 0, run; i < of->count; i += run, to += run * width) {
            int64_t was = of->former[i];
            for (run = 1; was >= 0 && i + run < of->count && of->former[i + run] == was + run;) run++; /* most stay in order */
            if (was < 0)
                __builtin_memset(to, (int)of->blank[k], (size_t)width);
            else
                __builtin_memcpy(to, from + width * was, (size_t)(run * width));
        }
        from += width * of->before;
    }
    return DERMIS_DONE;
}

static int sound_states(const dermis_states *of) {
    if (of->count < 0 || of->before < 0 || of->arrays < 0) return 0;
    for (int64_t k = 0; k < of->arrays; k++)
        if (of->widths[k] < 0) return 0;
    for (int64_t i = 0; i < of->count; i++)
        if (of->former[i] >= of->before) return 0;
    return 1;
}

DERMIS_FUNCTION(dermis_rearrange, dermis_states, sound_states, rearrange)
