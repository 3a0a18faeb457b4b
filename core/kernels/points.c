/* The contact points on a pad's grid of finest squares, and their neighbours; updated when points are added or
   removed. */
#include "float_environment.h"
#include "kernels.h"

/* Compute the sides of a cell in finest squares, along and around the finger, size (2). */
static void size_of(const dermis_points *of, int64_t cell, int64_t *size) {
    for (int k = 0; k < 2; k++) size[k] = of->side >> of->halved[2 * cell + k];
}

/* Clear the roots and cells of the former points. */
static void forget(const dermis_points *of) {
    for (int64_t i = 0; i < of->before; i++) {
        int64_t root = of->root[of->old_cells[i]];
        of->number[of->old_cells[i]] = of->in_root[root] = -1;
        for (int64_t k = 0; k < of->side * of->side; k++) of->owner[root * of->side * of->side + k] = -1;
    }
}

/* Enter the new points. */
static void mark(const dermis_points *of) {
    for (int64_t i = 0; i < of->count; i++) {
        int64_t cell = of->cells[i], root = of->root[cell], size[2], low[2];
        size_of(of, cell, size);
        for (int k = 0; k < 2; k++) low[k] = of->place[2 * cell + k] * size[k];
        for (int64_t a = low[0]; a < low[0] + size[0]; a++)
            for (int64_t b = low[1]; b < low[1] + size[1]; b++) of->owner[(root * of->side + a) * of->side + b] = i;
        of->in_root[root] = of->number[cell] = i;
    }
}

/* Return the root that contains a square, and make the square's position (2) relative to that root.

   root: root to which the position is relative; the square may be up to one root beside it. */
static int64_t root_at(const dermis_points *of, int64_t root, int64_t *square) {
    int64_t step[2];
    for (int k = 0; k < 2; k++) {
        step[k] = square[k] < 0 ? 0 : square[k] >= of->side ? 2 : 1;
        square[k] += of->side * (1 - step[k]);
    }
    return of->around[(root * 3 + step[0]) * 3 + step[1]];
}

/* Return the point just beyond the middle of a cell's side, -1 for none.

   side: 0 before and 1 behind the cell along the finger, 2 before and 3 behind it around the finger. */
static int64_t beside(const dermis_points *of, int64_t cell, int side) {
    int64_t size[2], square[2];
    size_of(of, cell, size);
    for (int k = 0; k < 2; k++) {
        int64_t low = of->place[2 * cell + k] * size[k];
        square[k] = k != side >> 1 ? low + size[k] / 2 : side & 1 ? low + size[k] : low - 1;
    }
    int64_t root = root_at(of, of->root[cell], square);
    return of->owner[(root * of->side + square[0]) * of->side + square[1]];
}

DERMIS_NOINLINE static int32_t renumber(dermis_points *of) {
    forget(of);
    mark(of);
    for (int64_t i = 0; i < of->count; i++)
        for (int side = 0; side < 4; side++) of->beside[4 * i + side] = beside(of, of->cells[i], side);
    return DERMIS_DONE;
}

static int all_known(const int64_t *cells, int64_t count, int64_t known) {
    for (int64_t i = 0; i < count; i++)
        if (cells[i] < 0 || cells[i] >= known) return 0;
    return 1;
}

static int sound(const dermis_points *of) {
    return of->side >= 1 && of->side <= 128 && of->before >= 0 && of->count >= 0 && all_known(of->old_cells, of->before, of->known) &&
           all_known(of->cells, of->count, of->known);
}

DERMIS_FUNCTION(dermis_number_points, dermis_points, sound, renumber)
