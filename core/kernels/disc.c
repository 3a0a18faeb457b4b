/* Contact of a rigid disc with points of the skin, by a semi-smooth Newton method; see core/devices/disc.py.

   All points have the disc's normal, so a Newton step solves A f = -D b with A = (I - D) / weight + D C. Here D is the
   derivative of Coulomb's projection. The transpose of A is factorised: triangular solves then run along rows. After a
   step, the state of friction is renewed. */
#include "float_environment.h"
#include "kernels.h"
#include "numbers.h"
#include "rim.h"

enum { OPEN, STICK, SLIP };

/* Number of doubles that are processed at once. */
#define WIDTH 4

/* Number of pivots for which the rest of a matrix is read and written once. */
#define PANEL 8

/* Shortest tangential part that is divided by [N]. */
#define SHORTEST 1e-300

/* The pose of the disc, see `dermis_disc.pose`. */
typedef struct {
    const double *rotation, *centre, *spin, *shift, *ahead;
    double normal[3];
} placement;

/* A point in the disc's frame: undeformed, and its place in the disc's plane for the gap at the rim [m]. */
typedef struct {
    double local[3], across[2], reach;
} sight;

/* The linear system of a Newton step, factorised. */
typedef struct {
    int64_t active;   /* number of touching points; 0: there is no system */
    int64_t slips;    /* number of slipping points among them */
    int64_t *points;  /* their indices among the candidates (active) */
    int64_t *pivots;  /* row that was swapped with each row (3 active) */
    double *law;      /* D of each touching point (active, 3, 3) */
    double *matrix;   /* factors of the transpose of A (3 active, 3 active + WIDTH - 1) */
} system_of;

/* Parts of the workspace; see `dermis_disc.room`. */
typedef struct {
    double *free;                     /* offset without forces, with the correction (count, 3) */
    double *force, *moved;            /* of the present step (count, 3) */
    double *tangent, *length, *press, *share; /* of the projection: (count, 3) and (count) */
    double *change;                   /* derivative of the offset (freedoms, count, 3) */
    double *right;                    /* right-hand sides (3 count) */
    double *turned, *image;           /* (count, 3) */
    system_of now, best;
} rooms;

typedef double lanes __attribute__((vector_size(8 * WIDTH), aligned(8), may_alias));

static inline void subtract(int64_t count, double factor, const double *restrict from, double *restrict to) {
    for (int64_t k = 0; k < count; k++) to[k] -= factor * from[k];
}

static inline void add_three(int64_t count, const double *f, const double *restrict a, double *restrict to) {
    const double *restrict b = a + count, *restrict d = b + count;
    double x = f[0], y = f[1], z = f[2];
    for (int64_t k = 0; k < count; k++) to[k] += (x * a[k] + y * b[k]) + z * d[k];
}

/* Numbers from the start of one row of a system's matrix to the start of the next. After each row, WIDTH - 1 zeros
   follow, so that `factorise` needs no shorter registers at the end of a row. */
static inline int64_t stride_of(int64_t size) { return size + WIDTH - 1; }

/* Subtract multiples of `many` rows from another row, one after the other, from a column on. */
static inline void reduce(int64_t many, int64_t groups, int64_t stride, const double *factor, const double *rows, double *row) {
    for (int64_t g = 0; g < groups; g++) {
        lanes sum = ((lanes *)row)[g];
        for (int64_t p = 0; p < many; p++) sum -= factor[p] * ((const lanes *)(rows + p * stride))[g];
        ((lanes *)row)[g] = sum;
    }
}

/* Factorise a matrix by rows with partial pivoting; return 0 if it is singular.

   PANEL columns are factorised first, and then subtracted from all columns to their right, so that these are read and
   written once for PANEL pivots. */
static int factorise(int64_t size, double *matrix, int64_t *pivots) {
    int64_t stride = stride_of(size);
    for (int64_t first = 0; first < size; first += PANEL) {
        int64_t end = first + PANEL < size ? first + PANEL : size, groups = (size - end + WIDTH - 1) / WIDTH;
        for (int64_t k = first; k < end; k++) {
            double *row = matrix + k * stride, largest = 0.0;
            int64_t at = k;
            for (int64_t i = k; i < size; i++) {
                double here = dermis_abs(matrix[i * stride + k]);
                if (here > largest) largest = here, at = i;
            }
            if (!(largest > 0.0)) return 0;
            pivots[k] = at;
            for (int64_t j = 0; j < size && at != k; j++) {
                double kept = row[j];
                row[j] = matrix[at * stride + j], matrix[at * stride + j] = kept;
            }
            for (int64_t i = k + 1; i < size; i++) {
                double *other = matrix + i * stride, factor = other[k] / row[k];
                other[k] = factor;
                for (int64_t j = k + 1; j < end; j++) other[j] -= factor * row[j];
            }
        }
        for (int64_t i = first + 1; i < end; i++)
            reduce(i - first, groups, stride, matrix + i * stride + first, matrix + first * stride + end, matrix + i * stride + end);
        for (int64_t i = end; i < size; i++)
            reduce(PANEL, groups, stride, matrix + i * stride + first, matrix + first * stride + end, matrix + i * stride + end);
    }
    return 1;
}

/* Solve A x = b for the factors of the transpose of A; x replaces b. */
static void solve(const system_of *own, double *x) {
    int64_t size = 3 * own->active, stride = stride_of(size);
    const double *matrix = own->matrix;
    for (int64_t k = 0; k < size; k++) {
        const double *row = matrix + k * stride;
        x[k] /= row[k];
        subtract(size - k - 1, x[k], row + k + 1, x + k + 1);
    }
    for (int64_t k = size - 1; k > 0; k--) subtract(k, x[k], matrix + k * stride, x);
    for (int64_t k = size - 1; k >= 0; k--) {
        double kept = x[k];
        x[k] = x[own->pivots[k]], x[own->pivots[k]] = kept;
    }
}

/* Compute the displacement of the candidates for forces on them (count, 3). */
static void move(const dermis_disc *disc, const double *force, double *image) {
    int64_t side = 3 * disc->count;
    for (int64_t k = 0; k < side; k++) image[k] = 0.0;
    for (int64_t i = 0; i < disc->count; i++) {
        const double *f = force + 3 * i, *rows = disc->compliance + 3 * i * side;
        if (f[0] == 0.0 && f[1] == 0.0 && f[2] == 0.0) continue;
        add_three(side, f, rows, image);
    }
}

/* Return the gap of a point [m]. For the gap at the rim, a sticking point is at its anchor. */
static double see(const dermis_disc *disc, const placement *pose, int64_t point, sight *out) {
    const double *turn = pose->rotation, *at = disc->positions + 3 * point, *place = disc->places + 3 * point;
    double from[3], now[3];
    for (int k = 0; k < 3; k++) from[k] = at[k] - pose->centre[k], now[k] = place[k] - pose->centre[k];
    for (int k = 0; k < 3; k++) out->local[k] = from[0] * turn[k] + from[1] * turn[3 + k] + from[2] * turn[6 + k];
    for (int k = 0; k < 2; k++)
        out->across[k] = disc->sticking[point] ? disc->anchors[2 * point + k] : now[0] * turn[k] + now[1] * turn[3 + k] + now[2] * turn[6 + k];
    out->reach = dermis_root(out->across[0] * out->across[0] + out->across[1] * out->across[1]);
    return dermis_rim(disc->radius, disc->rounding, out->reach) - out->local[2];
}

/* Compute the movement of the disc's material at a place of the finger's frame, per unit of a freedom (3). */
static void carry(const dermis_disc *disc, const placement *pose, int64_t freedom, const double *place, double *out) {
    double from[3];
    for (int k = 0; k < 3; k++) from[k] = place[k] - pose->centre[k];
    dermis_cross(pose->spin + 3 * freedom, from, out);
    for (int k = 0; k < 3; k++) out[k] += pose->shift[disc->freedoms * k + freedom];
}

/* Compute the offset of a candidate and its derivative, without the part that turns the offset with the disc. */
static void offset_of(const dermis_disc *disc, const placement *pose, const rooms *room, int64_t i) {
    const double *turn = pose->rotation;
    int64_t point = disc->near[i];
    double outwards[3], own[3], past[3];
    sight seen;
    double gap = see(disc, pose, point, &seen);
    int slides = seen.reach > disc->radius && !disc->sticking[point];
    for (int k = 0; k < 2; k++) own[k] = disc->anchored[point] ? seen.local[k] - disc->anchors[2 * point + k] : 0.0;
    own[2] = -gap;
    for (int k = 0; k < 3; k++) disc->offset[3 * i + k] = turn[3 * k] * own[0] + turn[3 * k + 1] * own[1] + turn[3 * k + 2] * own[2];
    for (int k = 0; k < 3; k++) room->free[3 * i + k] = disc->offset[3 * i + k] - (disc->less != NULL ? disc->less[3 * point + k] : 0.0);
    if (slides) { /* beyond the flat face, the gap changes along the rounded rim */
        double steep = (seen.reach - disc->radius) / (disc->rounding * seen.reach);
        for (int k = 0; k < 3; k++) outwards[k] = steep * (seen.across[0] * turn[3 * k] + seen.across[1] * turn[3 * k + 1]);
    }
    for (int64_t j = 0; j < disc->freedoms; j++) {
        double *change = room->change + 3 * (j * disc->count + i), along;
        carry(disc, pose, j, disc->positions + 3 * point, own);
        for (int k = 0; k < 3; k++) change[k] = -own[k];
        if (!disc->anchored[point]) { /* a point without an anchor has no tangential displacement */
            along = turn[2] * change[0] + turn[5] * change[1] + turn[8] * change[2];
            for (int k = 0; k < 3; k++) change[k] = turn[3 * k + 2] * along;
        }
        if (slides) {
            carry(disc, pose, j, disc->places + 3 * point, past);
            along = dermis_dot(outwards, past);
            for (int k = 0; k < 3; k++) change[k] += turn[3 * k + 2] * along;
        }
    }
}

/* Compute displacements, and the parts of Coulomb's projection of f - weight w, for the present forces. */
static void project(const dermis_disc *disc, const placement *pose, const rooms *room) {
    move(disc, room->force, room->moved);
    for (int64_t i = 0; i < disc->count; i++) {
        double v[3], along, *tangent = room->tangent + 3 * i, *moved = room->moved + 3 * i;
        for (int k = 0; k < 3; k++) moved[k] += room->free[3 * i + k], v[k] = room->force[3 * i + k] - disc->weight * moved[k];
        along = dermis_dot(v, pose->normal);
        for (int k = 0; k < 3; k++) tangent[k] = v[k] - along * pose->normal[k];
        room->press[i] = along;
        room->length[i] = dermis_most(dermis_root(dermis_dot(tangent, tangent)), SHORTEST);
        room->share[i] = dermis_least(disc->friction * dermis_most(along, 0.0) / room->length[i], 1.0);
    }
}

/* Return the residual of the present forces; see `dermis_disc.residual`. */
static double residual_of(const dermis_disc *disc, const placement *pose, const rooms *room) {
    double miss = 0.0, wanted = 0.0, size = 0.0;
    for (int64_t i = 0; i < disc->count; i++) {
        double press = dermis_most(room->press[i], 0.0);
        for (int64_t k = 3 * i; k < 3 * i + 3; k++) {
            double w = room->tangent[k] * room->share[i] + press * pose->normal[k - 3 * i], f = room->force[k];
            wanted += w * w, size += f * f, miss += (w - f) * (w - f);
        }
    }
    if (!dermis_finite(miss + wanted + size)) return __builtin_inf();
    size = dermis_most(size, wanted);
    return size > 0.0 ? dermis_root(miss / size) : 0.0;
}

/* Put the derivative of the projection at a touching point into `law` (3, 3). */
static void slope_of(const dermis_disc *disc, const double *normal, const rooms *room, int64_t i, double *law) {
    double share = room->share[i];
    for (int a = 0; a < 3; a++) {
        double direction = room->tangent[3 * i + a] / room->length[i];
        for (int b = 0; b < 3; b++) {
            double nn = normal[a] * normal[b], other = room->tangent[3 * i + b] / room->length[i];
            double unit = a == b ? 1.0 : 0.0;
            law[3 * a + b] = share < 1.0 ? direction * (disc->friction * normal[b] - share * other) + (nn + share * (unit - nn)) : unit;
        }
    }
}

/* Replace a vector of a touching point by D times the vector. */
static void lawful(const double *law, double *x) {
    double own[3];
    for (int k = 0; k < 3; k++) own[k] = dermis_dot(law + 3 * k, x);
    for (int k = 0; k < 3; k++) x[k] = own[k];
}

/* Set up and factorise the system of the points that the projection pushes; return 0 if it is singular. */
static int set_up(const dermis_disc *disc, const placement *pose, const rooms *room, system_of *now) {
    int64_t side = 3 * disc->count, size;
    now->active = now->slips = 0;
    for (int64_t i = 0; i < disc->count; i++) {
        if (!(room->press[i] > 0.0)) continue;
        slope_of(disc, pose->normal, room, i, now->law + 9 * now->active);
        now->slips += room->share[i] < 1.0;
        now->points[now->active++] = i;
    }
    size = 3 * now->active;
    for (int64_t j = 0; j < size; j++) {
        const double *row = disc->compliance + (3 * now->points[j / 3] + j % 3) * side;
        double *out = now->matrix + j * stride_of(size);
        for (int64_t k = size; k < stride_of(size); k++) out[k] = 0.0;
        for (int64_t i = 0; i < now->active; i++) {
            const double *own = row + 3 * now->points[i], *law = now->law + 9 * i;
            if (room->share[now->points[i]] < 1.0)
                for (int k = 0; k < 3; k++) out[3 * i + k] = dermis_dot(law + 3 * k, own);
            else
                for (int k = 0; k < 3; k++) out[3 * i + k] = own[k];
        }
        if (room->share[now->points[j / 3]] < 1.0)
            for (int k = 0; k < 3; k++)
                out[j / 3 * 3 + k] += ((k == j % 3 ? 1.0 : 0.0) - now->law[9 * (j / 3) + 3 * k + j % 3]) / disc->weight;
    }
    return factorise(size, now->matrix, now->pivots);
}

/* Keep the present forces as the best so far. */
static void keep(dermis_disc *disc, rooms *room, double residual) {
    system_of spare = room->best;
    int64_t width = 1 + disc->freedoms;
    disc->residual = residual;
    for (int64_t k = 0; k < 3 * disc->count; k++) disc->answer[width * k] = room->force[k], disc->moved[k] = room->moved[k];
    for (int64_t i = 0; i < disc->count; i++) disc->status[i] = !(room->press[i] > 0.0) ? OPEN : room->share[i] < 1.0 ? SLIP : STICK;
    room->best = room->now, room->now = spare;
}

/* Compute the derivative of the best forces: Omega f + h with A h = -D (C Omega f - Omega C f + db'). */
static void derive(const dermis_disc *disc, const placement *pose, const rooms *room) {
    const system_of *own = &room->best;
    int64_t width = 1 + disc->freedoms;
    for (int64_t j = 0; j < disc->freedoms && own->active; j++) {
        const double *spin = pose->spin + 3 * j;
        int turns = j < disc->turning, turned = turns && own->slips; /* if no point slips, terms with Omega f cancel */
        if (turned) {
            for (int64_t i = 0; i < disc->count; i++) {
                double force[3];
                for (int k = 0; k < 3; k++) force[k] = disc->answer[width * (3 * i + k)];
                dermis_cross(spin, force, room->turned + 3 * i);
            }
            move(disc, room->turned, room->image);
        }
        for (int64_t a = 0; a < own->active; a++) {
            int64_t i = own->points[a];
            double by[3], swept[3] = {0.0, 0.0, 0.0}, *right = room->right + 3 * a;
            for (int k = 0; k < 3; k++) by[k] = disc->moved[3 * i + k] - disc->offset[3 * i + k];
            if (turns) dermis_cross(spin, by, swept);
            for (int k = 0; k < 3; k++) right[k] = swept[k] - room->change[3 * (j * disc->count + i) + k] - (turned ? room->image[3 * i + k] : 0.0);
            lawful(own->law + 9 * a, right);
        }
        solve(own, room->right);
        for (int64_t a = 0; a < own->active; a++)
            for (int k = 0; k < 3; k++) {
                int64_t at = 3 * own->points[a] + k;
                disc->answer[width * at + 1 + j] = room->right[3 * a + k] + (turned ? room->turned[at] : 0.0);
            }
    }
}

/* Find forces by Newton's method, from the guess in `force`. */
static void iterate(dermis_disc *disc, const placement *pose, rooms *room) {
    double residual = __builtin_inf();
    for (disc->steps = 0;;) {
        project(disc, pose, room);
        if (disc->steps) { /* the guess itself is not a result */
            residual = residual_of(disc, pose, room);
            if (residual < disc->residual) keep(disc, room, residual);
            if (disc->steps >= disc->most || residual <= disc->tolerance) break;
        }
        system_of *now = &room->now;
        disc->steps++;
        int whole = set_up(disc, pose, room, now);
        for (int64_t k = 0; k < 3 * disc->count; k++) room->force[k] = 0.0;
        if (!whole) break;
        for (int64_t a = 0; a < now->active; a++) {
            for (int k = 0; k < 3; k++) room->right[3 * a + k] = -room->free[3 * now->points[a] + k];
            lawful(now->law + 9 * a, room->right + 3 * a);
        }
        solve(now, room->right);
        for (int64_t k = 0; k < 3 * now->active; k++) room->force[3 * now->points[k / 3] + k % 3] = room->right[k];
    }
}

/* Divide the workspace. */
static rooms divided(const dermis_disc *disc) {
    int64_t n = disc->count;
    double *at = disc->room;
    int64_t *whole = disc->indices;
    rooms out;
    double **parts[] = {&out.free, &out.force, &out.moved, &out.tangent, &out.right, &out.turned, &out.image};
    for (int k = 0; k < 7; k++) *parts[k] = at, at += 3 * n;
    out.length = at, out.press = at + n, out.share = at + 2 * n, at += 3 * n;
    out.change = at, at += 3 * n * disc->freedoms;
    system_of *both[] = {&out.now, &out.best};
    for (int k = 0; k < 2; k++) {
        both[k]->law = at, both[k]->matrix = at + 9 * n, at += 9 * n + 3 * n * stride_of(3 * n);
        both[k]->points = whole, both[k]->pivots = whole + n, whole += 4 * n;
        both[k]->active = both[k]->slips = 0;
    }
    return out;
}

/* Return whether the numbers of candidate i are finite. */
static int known(const dermis_disc *disc, const rooms *room, int64_t i) {
    double sum = 0.0; /* of absolute values: it is finite if all are, unless they overflow */
    for (int k = 0; k < 3; k++) {
        sum += dermis_abs(disc->offset[3 * i + k]) + dermis_abs(room->free[3 * i + k]) + dermis_abs(room->force[3 * i + k]);
        for (int64_t j = 0; j < disc->freedoms; j++) sum += dermis_abs(room->change[3 * (j * disc->count + i) + k]);
    }
    return dermis_finite(sum);
}

DERMIS_NOINLINE static int32_t press(dermis_disc *disc) {
    const double *p = disc->pose;
    int64_t free = disc->freedoms, width = 1 + free, close = 0;
    placement pose = {p, p + 9, p + 12, p + 12 + 3 * free, p + 12 + 6 * free, {-p[2], -p[5], -p[8]}};
    sight seen;
    for (int64_t i = 0; i < disc->points; i++) {
        disc->wrong = i;
        disc->gap[i] = see(disc, &pose, i, &seen);
        if (!dermis_finite(disc->gap[i] + seen.reach)) return DERMIS_NOT_FINITE;
        close += disc->gap[i] < disc->margin;
    }
    disc->touching = 0;
    for (int64_t i = 0; i < disc->count; i++) {
        if (disc->near[i] < 0 || disc->near[i] >= disc->points) return DERMIS_BAD_RECORD;
        close -= disc->gap[disc->near[i]] < disc->margin, disc->touching |= disc->gap[disc->near[i]] < 0.0;
    }
    disc->strays = close;
    if (close) return DERMIS_DONE;
    rooms room = divided(disc);
    disc->residual = __builtin_inf(), disc->steps = 0;
    for (int64_t i = 0; i < disc->count; i++) {
        offset_of(disc, &pose, &room, i);
        for (int64_t k = 3 * i; k < 3 * i + 3; k++) {
            const double *told = disc->told + k * (1 + disc->leading);
            double sum = told[0];
            for (int64_t j = 0; j < disc->leading; j++) sum += told[1 + j] * pose.ahead[j];
            room.force[k] = disc->touching ? sum : 0.0;
            for (int64_t j = 0; j < width; j++) disc->answer[k * width + j] = j ? 0.0 : room.force[k];
            disc->moved[k] = disc->touching ? room.free[k] : disc->offset[k];
        }
        disc->status[i] = OPEN;
        disc->wrong = disc->near[i];
        if (!known(disc, &room, i)) return DERMIS_NOT_FINITE;
    }
    if (!disc->touching) {
        disc->residual = 0.0;
        return DERMIS_DONE;
    }
    iterate(disc, &pose, &room);
    derive(disc, &pose, &room);
    return DERMIS_DONE;
}

static int sound(const dermis_disc *disc) {
    return disc->points >= 0 && disc->count >= 0 && disc->count <= disc->points && disc->freedoms >= 1 && disc->turning >= 0 && disc->turning <= disc->freedoms &&
           (disc->leading == 0 || disc->leading == disc->freedoms) && disc->most >= 1 && disc->tolerance >= 0.0 &&
           disc->radius >= 0.0 && disc->rounding > 0.0 && disc->friction >= 0.0 && dermis_finite(disc->friction) && disc->weight > 0.0 && dermis_finite(disc->weight);
}

DERMIS_FUNCTION(dermis_press_disc, dermis_disc, sound, press)

static int settles(const dermis_settled *step) { return step->points >= 0 && step->count >= 0 && step->count <= step->points && step->width >= 1; }

DERMIS_NOINLINE static int32_t settle(dermis_settled *step) {
    const double *turn = step->pose, *centre = step->pose + 9;
    int64_t side = 3 * step->points;
    int loaded = 0;
    for (int64_t k = 0; k < side; k++) step->moved[k] = step->force[k] = 0.0;
    for (int64_t i = 0; i < step->points; i++) step->sticks[i] = 0;
    for (int64_t i = 0; i < step->count; i++) {
        int64_t point = step->near[i];
        if (point < 0 || point >= step->points) return DERMIS_BAD_RECORD;
        double *force = step->force + 3 * point;
        for (int k = 0; k < 3; k++) force[k] = step->answer[(3 * i + k) * step->width];
        step->sticks[point] = step->status[i] == STICK;
        if (step->status[i] == OPEN) continue;
        loaded = 1;
        add_three(side, force, step->compliance + 3 * point * side, step->moved);
    }
    for (int64_t i = 0; i < step->points; i++) {
        double *moved = step->moved + 3 * i, *anchor = step->anchor + 2 * i, now[3];
        for (int k = 0; k < 3; k++) {
            if (loaded && step->less != NULL) moved[k] -= step->less[3 * i + k];
            now[k] = step->positions[3 * i + k] - centre[k] + moved[k];
        }
        for (int k = 0; k < 2; k++) {
            anchor[k] = turn[k] * now[0] + turn[3 + k] * now[1] + turn[6 + k] * now[2];
            if (!dermis_finite(anchor[k])) {
                step->wrong = i;
                return DERMIS_NOT_FINITE;
            }
            if (step->sticks[i] && step->anchored[i]) anchor[k] = step->anchors[2 * i + k];
        }
    }
    return DERMIS_DONE;
}

DERMIS_FUNCTION(dermis_settle_disc, dermis_settled, settles, settle)
