/* The displacement of linear tissue for forces on its nodes, by forward and backward substitution with the inverted
   Schur complements of core/skin/rest_factor.py. */
#include "float_environment.h"
#include "kernels.h"

#define LANES 8
#define ROWS 4

typedef float lanes __attribute__((vector_size(4 * LANES), aligned(4), may_alias));

/* Return the sum of the eight lanes. */
static float sum_of(const lanes *v) {
    const float *x = (const float *)v;
    return ((x[0] + x[4]) + (x[1] + x[5])) + ((x[2] + x[6]) + (x[3] + x[7]));
}

/* Compute y = A x for a symmetric matrix A; return the position behind A.

   a: the numbers below the diagonal, in strips of four rows. A strip is a list of groups of eight columns, and a group
   has four rows of eight numbers. diagonal: the diagonal of A. Each number of A is read once, and used for its row and
   for its column. */
static const float *product(const float *a, const float *diagonal, int64_t size, const float *restrict x, float *restrict y) {
    const lanes none = {0.0f};
    for (int64_t k = 0; k < size; k++) y[k] = diagonal[k] * x[k];
    for (int64_t i = 0; i < size; i += ROWS) {
        lanes s0 = none, s1 = none, s2 = none, s3 = none;
        const lanes x0 = none + x[i], x1 = none + x[i + 1], x2 = none + x[i + 2], x3 = none + x[i + 3];
        for (int64_t j = 0; j < i + ROWS - 1; j += LANES, a += ROWS * LANES) {
            const lanes *row = (const lanes *)a, along = *(const lanes *)(x + j), a0 = row[0], a1 = row[1], a2 = row[2], a3 = row[3];
            s0 += a0 * along, s1 += a1 * along, s2 += a2 * along, s3 += a3 * along;
            *(lanes *)(y + j) += (a0 * x0 + a1 * x1) + (a2 * x2 + a3 * x3);
        }
        y[i] += sum_of(&s0), y[i + 1] += sum_of(&s1), y[i + 2] += sum_of(&s2), y[i + 3] += sum_of(&s3);
    }
    return a;
}

/* Return how many numbers the strips of a level with `size` slots have. */
static int64_t numbers_of(int64_t size) {
    int64_t strips = size / ROWS, out = 0;
    for (int64_t s = 0; s < strips; s++) out += (ROWS * s + ROWS - 1 + LANES - 1) / LANES * LANES * ROWS;
    return out;
}

/* Whether all indices and counts of a record are within their arrays. */
static int32_t known(const dermis_rest *rest) {
    int64_t numbers = 0, slots = rest->starts[rest->levels];
    if (rest->starts[0] != 0 || slots < 0 || rest->rows[0] != 0) return 0;
    for (int64_t i = 0; i < rest->levels; i++) {
        int64_t size = rest->starts[i + 1] - rest->starts[i];
        if (size < 0 || size % LANES || rest->starts[i + 1] > slots) return 0;
        numbers += numbers_of(size);
    }
    if (numbers != rest->numbers) return 0;
    for (int64_t k = 0; k < slots; k++)
        if (rest->order[k] < -1 || rest->order[k] >= rest->size || rest->rows[k + 1] < rest->rows[k]) return 0;
    if (rest->rows[slots] != rest->couplings) return 0;
    for (int64_t k = 0; k < rest->couplings; k++)
        if (rest->columns[k] < 0 || rest->columns[k] >= slots) return 0;
    return 1;
}

/* Solve for the displacement. Forces that are not finite are allowed: the displacement is then not finite either. */
DERMIS_NOINLINE static int32_t solve(dermis_rest *rest) {
    if (!known(rest)) return DERMIS_BAD_RECORD;
    const int64_t *starts = rest->starts, slots = starts[rest->levels], last = rest->levels - 1;
    const float *a = rest->inverses;
    float *right = rest->room, *out = right + slots, *spare = out + slots;
    for (int64_t k = 0; k < slots; k++) right[k] = rest->order[k] < 0 ? 0.0f : rest->force[rest->order[k]];
    for (int64_t i = 0; i <= last; i++) {
        a = product(a, rest->diagonals + starts[i], starts[i + 1] - starts[i], right + starts[i], out + starts[i]);
        for (int64_t k = starts[i]; k < starts[i + 1]; k++)
            for (int64_t n = rest->rows[k]; n < rest->rows[k + 1]; n++) right[rest->columns[n]] -= rest->values[n] * out[k];
    }
    for (int64_t i = last; i-- > 0;) {
        int64_t size = starts[i + 1] - starts[i];
        for (int64_t k = starts[i]; k < starts[i + 1]; k++) {
            float sum = 0.0f;
            for (int64_t n = rest->rows[k]; n < rest->rows[k + 1]; n++) sum += rest->values[n] * out[rest->columns[n]];
            right[k] = sum;
        }
        a -= numbers_of(starts[i + 2] - starts[i + 1]);
        product(a - numbers_of(size), rest->diagonals + starts[i], size, right + starts[i], spare);
        for (int64_t k = 0; k < size; k++) out[starts[i] + k] -= spare[k];
    }
    for (int64_t k = 0; k < slots; k++)
        if (rest->order[k] >= 0) rest->moved[rest->order[k]] = out[k];
    return DERMIS_DONE;
}

static int sound(const dermis_rest *rest) {
    return rest->size > 0 && rest->size <= 2147483647 && rest->levels > 0 && rest->levels <= rest->size && rest->couplings >= 0;
}

DERMIS_FUNCTION(dermis_rest_solve, dermis_rest, sound, solve)
