/* The drawing of a touched skin: its deformed surface, refined, with normals and the values that become colours. */
#include "float_environment.h"
#include "kernels.h"
#include "numbers.h"

/* Numbers of a node that are refined: displacement, normal, value, and one that is not used. */
#define NUMBERS 8
/* Numbers of a node in the table: displacement, and the six components of stress. */
#define COLUMNS 9
#define TINY 1e-30

typedef double lanes __attribute__((vector_size(8 * NUMBERS), aligned(8), may_alias));

/* Whether all indices of a record are within their arrays. */
static int32_t known(const dermis_drawn *of) {
    for (int64_t i = 0; i < 3 * of->triangles; i++)
        if (of->corners[i] < 0 || of->corners[i] >= of->nodes) return 0;
    if (of->starts[0] != 0 || of->starts[of->drawn] != of->entries) return 0;
    for (int64_t i = 0; i < of->drawn; i++)
        if (of->starts[i + 1] < of->starts[i] || of->starts[i + 1] > of->entries) return 0;
    const int32_t nodes = (int32_t)of->nodes;
    int32_t beyond = 0;
    for (int64_t i = 0; i < of->entries; i++) beyond |= (of->columns[i] < 0) | (of->columns[i] >= nodes);
    return !beyond;
}

/* Compute displacement and stress of the nodes by the table, for forces that are divided by their largest component.

   Return this component; it is 0 without any force. */
static double look_up(const dermis_drawn *of) {
    double scale = 0.0;
    float *restrict sums = of->sums;
    const int64_t count = COLUMNS * of->nodes;
    for (int64_t k = 0; k < 3 * of->pad; k++) scale = dermis_most(scale, dermis_abs(of->force[k]));
    for (int64_t k = 0; k < count; k++) sums[k] = 0.0f;
    if (!(scale > 0.0)) return 0.0;
    for (int64_t i = 0; i < of->pad; i++) {
        const double *force = of->force + 3 * i;
        if (force[0] == 0.0 && force[1] == 0.0 && force[2] == 0.0) continue;
        const float x = (float)(force[0] / scale), y = (float)(force[1] / scale), z = (float)(force[2] / scale);
        const float *restrict by_x = of->table + 3 * i * count, *restrict by_y = by_x + count, *restrict by_z = by_y + count;
        for (int64_t k = 0; k < count; k++) sums[k] += (x * by_x[k] + y * by_y[k]) + z * by_z[k];
    }
    return scale;
}

/* Return the von Mises stress of stresses xx, yy, zz, yz, xz, xy (6) [Pa]. */
static double von_mises(const double *s) {
    double a = s[0] - s[1], b = s[1] - s[2], c = s[2] - s[0];
    return dermis_root(0.5 * (a * a + b * b + c * c) + 3.0 * (s[3] * s[3] + s[4] * s[4] + s[5] * s[5]));
}

/* Return a quantity, see `dermis_drawn`, of a displacement (3) [m] and a stress (6) [Pa]. */
static double quantity_of(int64_t quantity, const double *moved, const double *stress) {
    if (quantity < 6) return stress[quantity];
    return quantity == 6 ? von_mises(stress) : dermis_root(dermis_dot(moved, moved));
}

/* Compute the displacement of the nodes by the table, and their values unless these are given. */
static void fill(const dermis_drawn *of) {
    const double scale = look_up(of), moves = scale / of->modulus;
    for (int64_t i = 0; i < of->nodes; i++) {
        const float *sums = of->sums + COLUMNS * i;
        double *moved = of->moved + 3 * i, stress[6];
        for (int k = 0; k < 3; k++) moved[k] = moves * (double)sums[k];
        for (int k = 0; k < 6; k++) stress[k] = scale * (double)sums[3 + k];
        if (of->quantity >= 0) of->values[i] = quantity_of(of->quantity, moved, stress);
    }
}

/* Divide a vector (3) by its length. */
static void make_unit(double *v) {
    double inverse = 1.0 / dermis_most(dermis_root(dermis_dot(v, v)), TINY);
    for (int k = 0; k < 3; k++) v[k] *= inverse;
}

/* Compute the numbers of each node that are refined, and the least and greatest value. */
static void collect(dermis_drawn *of) {
    double *room = of->room;
    of->low = of->high = of->values[0];
    for (int64_t i = 0; i < of->nodes; i++) {
        double *own = room + NUMBERS * i;
        for (int k = 0; k < 3; k++) own[k] = of->exaggeration * of->moved[3 * i + k], own[3 + k] = 0.0;
        own[6] = of->values[i], own[7] = 0.0;
        of->low = dermis_least(of->low, own[6]), of->high = dermis_most(of->high, own[6]);
    }
    for (int64_t t = 0; t < of->triangles; t++) {
        const int32_t *corners = of->corners + 3 * t;
        double at[3][3], cross[3];
        for (int c = 0; c < 3; c++)
            for (int k = 0; k < 3; k++) at[c][k] = of->points[3 * corners[c] + k] + room[NUMBERS * corners[c] + k];
        for (int c = 1; c < 3; c++)
            for (int k = 0; k < 3; k++) at[c][k] -= at[0][k];
        dermis_cross(at[1], at[2], cross);
        for (int c = 0; c < 3; c++)
            for (int k = 0; k < 3; k++) room[NUMBERS * corners[c] + 3 + k] += cross[k];
    }
    for (int64_t i = 0; i < of->nodes; i++) make_unit(room + NUMBERS * i + 3);
}

/* Compute the drawn vertices. A value stays within those of the nodes, since a cubic may overshoot. */
static void refine(const dermis_drawn *of) {
    for (int64_t i = 0; i < of->drawn; i++) {
        lanes sum = {0.0};
        for (int64_t n = of->starts[i]; n < of->starts[i + 1]; n++)
            sum += of->weights[n] * *(const lanes *)(of->room + NUMBERS * of->columns[n]);
        double *position = of->positions + 3 * i, *normal = of->normals + 3 * i;
        for (int k = 0; k < 3; k++) position[k] = of->rest[3 * i + k] + sum[k], normal[k] = sum[3 + k];
        position[2] += of->lift;
        of->shown[i] = dermis_least(dermis_most(sum[6], of->low), of->high);
    }
    for (int64_t i = 0; i < of->drawn; i++) make_unit(of->normals + 3 * i); /* a loop of its own is much faster */
}

/* Compute the centre of pressure, and the shear. */
static void balance(dermis_drawn *of) {
    double pushed = 0.0, total[3] = {0.0, 0.0, 0.0}, centre[2] = {0.0, 0.0};
    for (int64_t i = 0; i < of->pad; i++) {
        const double *force = of->force + 3 * i;
        double push = dermis_most(-dermis_dot(force, of->pad_normals + 3 * i), 0.0);
        for (int k = 0; k < 3; k++) total[k] += force[k];
        for (int k = 0; k < 2; k++) centre[k] += push * of->pad_positions[3 * i + k];
        pushed += push;
    }
    for (int k = 0; k < 2; k++) {
        of->centre[k] = centre[k] / dermis_most(pushed, TINY);
        of->shear[k] = total[k] / dermis_most(of->normal_force, 1e-12);
    }
}

DERMIS_NOINLINE static int32_t draw(dermis_drawn *of) {
    if (!known(of)) return DERMIS_BAD_RECORD;
    if (of->table) fill(of);
    collect(of);
    refine(of);
    balance(of);
    return DERMIS_DONE;
}

static int sound(const dermis_drawn *of) {
    return of->nodes > 0 && of->nodes <= 2147483647 && of->drawn >= 0 && of->triangles >= 0 && of->entries >= 0 && of->pad >= 0 &&
           of->quantity >= -1 && of->quantity <= 7;
}

DERMIS_FUNCTION(dermis_draw_skin, dermis_drawn, sound, draw)
