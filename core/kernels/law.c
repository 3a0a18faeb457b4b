/* Forces, stress and energy of neo-Hookean tissue on a mesh of tetrahedra, in single precision; see
   core/skin/mesh_law.py.

   The strain energy is W = sum_e V_e mu/2 (I1 - 3 - 2 ln J_e) + sum_a V_a lambda/2 (ln J_a)^2, where J_a is the volume
   average of J around node a, and V_a a quarter of the volume around it. With the gradient H of the displacement, F = 1
   + H. In J - 1 = tr H + ... no large numbers cancel, so small strains are accurate. */
#include "float_environment.h"
#include "kernels.h"
#include "numbers.h"

#define WIDE DERMIS_LANES
#define LN_2 0.693147180559945309417

/* One number for each of four elements, or x, y, z and a fourth number of one node. */
typedef float lanes __attribute__((vector_size(4 * WIDE), aligned(4), may_alias));
typedef int32_t bits __attribute__((vector_size(4 * WIDE), aligned(4), may_alias));

static const int next[3][2] = {{1, 2}, {2, 0}, {0, 1}};
static const lanes none = {0.0f};

/* Strains of a block of elements: H and its cofactor, trace = tr H, more = J - 1 - tr H, and J. */
typedef struct {
    lanes h[9], cofactor[9], trace, more, j;
} strains;

/* Return `yes` in lanes whose bits are set, and `no` in the others. */
static lanes chosen(bits which, lanes yes, lanes no) { return (lanes)(((bits)yes & which) | ((bits)no & ~which)); }

/* Return ln(1 + x) for x > -1, with a relative error of up to 1e-14: eight terms of the series of artanh are enough,
   since 1 + x is scaled to the range from 0.7 to 1.42. */
static double logarithm(double x) {
    static const double series[8] = {2.0, 2.0 / 3, 2.0 / 5, 2.0 / 7, 2.0 / 9, 2.0 / 11, 2.0 / 13, 2.0 / 15};
    double s, q, q2, twos = 0.0;
    if (!dermis_finite(x)) return x;
    if (dermis_abs(x) <= 0.29) {
        s = x / (2.0 + x);
    } else {
        union {
            double value;
            uint64_t bits;
        } y = {1.0 + x};
        twos = (double)((int64_t)(y.bits >> 52) - 1023);
        y.bits = (y.bits & 0xfffffffffffffu) | 0x3ff0000000000000u;
        if (y.value > 1.41421356) y.value *= 0.5, twos += 1.0;
        s = (y.value - 1.0) / (y.value + 1.0);
    }
    q = s * s, q2 = q * q;
    return twos * LN_2 + s * (((series[0] + q * series[1]) + q2 * (series[2] + q * series[3])) +
                              q2 * q2 * ((series[4] + q * series[5]) + q2 * (series[6] + q * series[7])));
}

/* Return ln J from J - 1; below `least`, the second-order expansion of ln J. */
static double log_of(const dermis_law *law, double widening) {
    double least = law->least, below = 1.0 + widening - least;
    if (!(below < 0.0)) return logarithm(widening);
    below /= least;
    return logarithm(least - 1.0) + below - 0.5 * below * below;
}

/* Return the derivative of `log_of` by J. */
static double slope_of(const dermis_law *law, double widening) {
    double least = law->least, j = 1.0 + widening;
    return j < least ? (2.0 - j / least) / least : 1.0 / j;
}

static int64_t blocks_of(const dermis_law *law) { return (law->elements + WIDE - 1) / WIDE; }

/* The workspace has H of the blocks, then displacement and pressure of each node, then the force on each node. */
static lanes *kept_of(const dermis_law *law, int64_t block) { return (lanes *)law->room + 9 * block; }
static lanes *nodes_of(const dermis_law *law) { return (lanes *)kept_of(law, blocks_of(law)); }

/* Transpose: from x, y, z and the fourth number of four nodes to the four x, the four y and so on, or back. */
static void turn(const lanes *from, lanes *to) {
    lanes a = __builtin_shufflevector(from[0], from[1], 0, 4, 1, 5), b = __builtin_shufflevector(from[2], from[3], 0, 4, 1, 5);
    lanes c = __builtin_shufflevector(from[0], from[1], 2, 6, 3, 7), d = __builtin_shufflevector(from[2], from[3], 2, 6, 3, 7);
    to[0] = __builtin_shufflevector(a, b, 0, 1, 4, 5), to[1] = __builtin_shufflevector(a, b, 2, 3, 6, 7);
    to[2] = __builtin_shufflevector(c, d, 0, 1, 4, 5), to[3] = __builtin_shufflevector(c, d, 2, 3, 6, 7);
}

/* Compute the displacement gradients H of a block. */
static void gradients(const dermis_law *law, int64_t block, lanes *h) {
    const int32_t *corner = law->corners + 4 * WIDE * block;
    const lanes *slope = (const lanes *)law->slopes + 9 * block;
    const lanes *node = nodes_of(law);
    lanes away[9];
    for (int k = 0; k < 3; k++) {
        const int32_t *other = corner + (k + 1) * WIDE;
        lanes from[WIDE], to[WIDE];
        for (int l = 0; l < WIDE; l++) from[l] = node[other[l]] - node[corner[l]];
        turn(from, to);
        for (int i = 0; i < 3; i++) away[3 * k + i] = to[i];
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            h[3 * i + j] = (away[i] * slope[j] + away[3 + i] * slope[3 + j]) + away[6 + i] * slope[6 + j];
}

/* Compute the other strains from H. */
static void strain(strains *s) {
    const lanes *h = s->h;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            s->cofactor[3 * i + j] = h[3 * next[i][0] + next[j][0]] * h[3 * next[i][1] + next[j][1]] -
                                     h[3 * next[i][0] + next[j][1]] * h[3 * next[i][1] + next[j][0]];
    s->trace = (h[0] + h[4]) + h[8];
    s->more = ((s->cofactor[0] + s->cofactor[4]) + s->cofactor[8]) +
              ((h[0] * s->cofactor[0] + h[1] * s->cofactor[1]) + h[2] * s->cofactor[2]);
    s->j = 1.0f + (s->trace + s->more);
}

/* Read H of a block from the workspace, and compute the other strains from it. */
static void recall(const dermis_law *law, int64_t block, strains *s) {
    const lanes *kept = kept_of(law, block);
    for (int k = 0; k < 9; k++) s->h[k] = kept[k];
    strain(s);
}

/* Return the mean pressure of the corners of each element in a block. */
static lanes mean_of(const dermis_law *law, int64_t block) {
    const int32_t *corner = law->corners + 4 * WIDE * block;
    const lanes *node = nodes_of(law);
    lanes out;
    for (int l = 0; l < WIDE; l++)
        out[l] = (node[corner[l]][3] + node[corner[WIDE + l]][3]) + (node[corner[2 * WIDE + l]][3] + node[corner[3 * WIDE + l]][3]);
    return 0.25f * out;
}

/* Store H of all elements; compute the pressure lambda ln J / J of the nodes, their energy, and the least J of the
   elements. */
static void measure(dermis_law *law) {
    lanes *node = nodes_of(law);
    lanes least = none + __builtin_inff();
    double energy = 0.0;
    for (int64_t a = 0; a < law->nodes; a++)
        node[a] = (lanes){law->moved[3 * a], law->moved[3 * a + 1], law->moved[3 * a + 2], 0.0f};
    for (int64_t block = 0; block < blocks_of(law); block++) {
        const int32_t *corner = law->corners + 4 * WIDE * block;
        lanes *kept = kept_of(law, block), share;
        strains s;
        gradients(law, block, s.h);
        strain(&s);
        for (int k = 0; k < 9; k++) kept[k] = s.h[k];
        share = ((const lanes *)law->volumes)[block] * (s.trace + s.more);
        least = chosen(s.j < least, s.j, least);
        for (int k = 0; k < 4 * WIDE; k++) node[corner[k]][3] += share[k % WIDE];
    }
    for (int64_t a = 0; a < law->nodes; a++) {
        double around = (double)law->around[a], widening = (double)node[a][3] / around, log = log_of(law, widening);
        energy += 0.125 * law->first * around * (log * log); /* V_a is a quarter of `around` */
        node[a][3] = (float)(law->first * log * slope_of(law, widening));
    }
    law->energy = energy, law->flattest = __builtin_inf();
    for (int l = 0; l < WIDE; l++) law->flattest = dermis_least((double)least[l], law->flattest);
}

/* Sum the forces of the first Piola-Kirchhoff stress P = mu F + (p - mu / J) cof F.

   Here p is the mean pressure of the corners, and cof F = (1 + tr H) 1 - H' + cof H; H' is H transposed. */
static void push(const dermis_law *law) {
    lanes *sum = nodes_of(law) + law->nodes;
    const float shear = (float)law->shear, least = (float)law->least;
    for (int64_t a = 0; a < law->nodes; a++) sum[a] = (lanes){0.0f};
    for (int64_t block = 0; block < blocks_of(law); block++) {
        const int32_t *corner = law->corners + 4 * WIDE * block;
        const lanes *slope = (const lanes *)law->slopes + 9 * block, volume = ((const lanes *)law->volumes)[block];
        lanes mean = mean_of(law, block), piola[9], base[4] = {none, none, none, none};
        strains s;
        recall(law, block, &s);
        bits flat = s.j < least;
        lanes below = chosen(flat, (s.j - least) / least, none), own = shear * ((1.0f - below) / chosen(flat, none + least, s.j));
        lanes less = mean - own, whole = 1.0f + s.trace;
        /* mu (1 - (1 + tr H) / J) is computed as mu (J - 1 - tr H) / J, which keeps small strains accurate; below
           `least` the two differ, since the expansion replaces 1 / J */
        lanes along = chosen(flat, shear + less * whole, mean * whole + own * s.more);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                lanes p = (s.cofactor[3 * i + j] - s.h[3 * j + i]) * less + s.h[3 * i + j] * shear;
                piola[3 * i + j] = volume * (p + (i == j ? along : none));
            }
        for (int k = 3; k >= 0; k--) {
            lanes force[4] = {base[0], base[1], base[2], none}, of[4];
            for (int i = 0; i < 3 && k > 0; i++) {
                const lanes *g = slope + 3 * (k - 1);
                force[i] = (piola[3 * i] * g[0] + piola[3 * i + 1] * g[1]) + piola[3 * i + 2] * g[2];
                base[i] -= force[i];
            }
            turn(force, of);
            for (int l = 0; l < WIDE; l++) sum[corner[k * WIDE + l]] += of[l];
        }
    }
    for (int64_t a = 0; a < law->nodes; a++)
        for (int i = 0; i < 3; i++) law->force[3 * a + i] = sum[a][i];
}

/* Compute the Cauchy stress mu (b - 1) / J + p of the elements, with b - 1 = H + H' + H H'. */
static void press(const dermis_law *law) {
    static const int pairs[6][2] = {{0, 0}, {1, 1}, {2, 2}, {1, 2}, {0, 2}, {0, 1}};
    const float shear = (float)law->shear, least = (float)law->least;
    for (int64_t block = 0, first = 0; first < law->elements; block++, first += WIDE) {
        strains s;
        recall(law, block, &s);
        lanes own = shear / chosen(s.j < least, none + least, s.j), mean = mean_of(law, block), out[6];
        for (int c = 0; c < 6; c++) {
            int i = pairs[c][0], j = pairs[c][1];
            lanes b = s.h[3 * i + j] + s.h[3 * j + i];
            for (int k = 0; k < 3; k++) b += s.h[3 * i + k] * s.h[3 * j + k];
            out[c] = b * own + (i == j ? mean : none);
        }
        for (int l = 0; l < WIDE && first + l < law->elements; l++)
            for (int c = 0; c < 6; c++) law->stress[6 * (first + l) + c] = out[c][l];
    }
}

/* Add the first sum of the energy, over the elements. In I1 - 3 - 2 ln J = 2 (J - 1 - ln J) + H:H - 2 (J - 1 - tr H),
   each term is of second order in H, so no large numbers cancel. */
static void store(dermis_law *law) {
    double sum = 0.0;
    for (int64_t block = 0, first = 0; first < law->elements; block++, first += WIDE) {
        strains s;
        recall(law, block, &s);
        for (int l = 0; l < WIDE && first + l < law->elements; l++) {
            double widening = (double)(s.trace[l] + s.more[l]), square = 0.0;
            for (int k = 0; k < 9; k++) square += (double)s.h[k][l] * (double)s.h[k][l];
            sum += (double)law->volumes[WIDE * block + l] * ((widening - log_of(law, widening)) + (0.5 * square - (double)s.more[l]));
        }
    }
    law->energy += law->shear * sum;
}

/* Evaluate the law. A displacement that is not finite is allowed: the results are then not finite either. */
DERMIS_NOINLINE static int32_t evaluate(dermis_law *law) {
    int64_t corners = 4 * WIDE * blocks_of(law);
    int beyond = 0;
    for (int64_t k = 0; k < corners; k++) beyond |= (uint32_t)law->corners[k] >= (uint32_t)law->nodes;
    if (beyond) return DERMIS_BAD_RECORD;
    measure(law);
    if (law->force != NULL) push(law);
    if (law->stress != NULL) press(law);
    if (law->stored) store(law);
    return DERMIS_DONE;
}

static int sound(const dermis_law *law) {
    return law->nodes > 0 && law->nodes <= 2147483647 && law->elements > 0 && law->elements <= 2147483647 &&
           (law->stored == 0 || law->stored == 1) && law->least > 0.0 && law->least < 1.0;
}

DERMIS_FUNCTION(dermis_evaluate_law, dermis_law, sound, evaluate)
