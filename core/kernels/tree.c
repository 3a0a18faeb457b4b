/* A tree of boxes around triangles.

   Skin lies close to the surfaces that it presses on. There, boxes along the coordinate axes would seem nearly as close
   as the closest triangles, so a search could leave few out. Therefore each box has axes of its own: the first is the
   mean normal of its triangles, and the box is only as thick along it as they bulge. */
#include "boxes.h"
#include "float_environment.h"
#include "kernels.h"
#include "numbers.h"
#include "triangle.h"

/* Boxes are enlarged by this share of the largest coordinate for rounding, whose error is 16 times smaller. */
#define ROUNDING (64.0 * DBL_EPSILON)
/* Largest number of triangles from which the tree's middle and scale are taken. */
#define SOME 32
/* A component that is shorter than this share of its vector is a rounding error. */
#define NOTHING 1e-6

/* The position of a triangle. */
typedef struct {
    double centre[3];
    int64_t triangle;
} place;

static inline int before(const place *a, const place *b, int axis) {
    if (a->centre[axis] != b->centre[axis]) return a->centre[axis] < b->centre[axis];
    return a->triangle < b->triangle;
}

/* Divide places[low .. high - 1] in two: the places with the smallest coordinates along an axis are put before index
   `middle`, all others at this index and after it.

   Equal coordinates are ordered by the triangles' numbers, so the two sets do not depend on the initial order. */
static void part(place *places, int64_t low, int64_t high, int64_t middle, int axis) {
    uint64_t chance = 0x9e3779b97f4a7c15u;
    for (high--; low < high;) {
        chance = chance * 6364136223846793005u + 1442695040888963407u;
        place pivot = places[low + (int64_t)((chance >> 33) % (uint64_t)(high - low + 1))];
        int64_t i = low, j = high;
        while (i <= j) {
            while (before(&places[i], &pivot, axis)) i++;
            while (before(&pivot, &places[j], axis)) j--;
            if (i <= j) {
                place swapped = places[i];
                places[i++] = places[j];
                places[j--] = swapped;
            }
        }
        if (middle <= j)
            high = j;
        else if (middle >= i)
            low = i;
        else
            return;
    }
}

/* Return the axis along which the centres of places[low .. high - 1] extend farthest. */
static int longest(const place *places, int64_t low, int64_t high) {
    double least[3], most[3];
    for (int k = 0; k < 3; k++) least[k] = most[k] = places[low].centre[k];
    for (int64_t i = low + 1; i < high; i++)
        for (int k = 0; k < 3; k++) {
            least[k] = dermis_least(least[k], places[i].centre[k]);
            most[k] = dermis_most(most[k], places[i].centre[k]);
        }
    int axis = 0;
    for (int k = 1; k < 3; k++)
        if (most[k] - least[k] > most[axis] - least[axis]) axis = k;
    return axis;
}

static inline int64_t blocks_of(const dermis_tree *tree) { return (tree->count + DERMIS_LANES - 1) / DERMIS_LANES; }

static int sound(const dermis_tree *tree) {
    return tree->count >= 1 && tree->count <= tree->total && tree->total <= INT32_MAX && tree->depth >= 0 && tree->depth <= 15;
}

DERMIS_NOINLINE static int32_t split(dermis_tree *tree) {
    int64_t count = tree->count, total = tree->total, blocks = blocks_of(tree);
    place *places = (place *)tree->packed; /* used as workspace: `fit` fills it later */
    for (int64_t i = 0; i < count; i++) {
        int64_t triangle = tree->order[i];
        if (triangle < 0 || triangle >= total) return DERMIS_BAD_RECORD;
        for (int k = 0; k < 3; k++) {
            places[i].centre[k] = tree->bounds[k * total + triangle];
            if (!dermis_finite(places[i].centre[k])) {
                tree->wrong = triangle;
                return DERMIS_NOT_FINITE;
            }
        }
        places[i].triangle = triangle;
    }
    int levels = 0; /* number of halvings after which each part is one block */
    while (blocks > (int64_t)1 << levels) levels++;
    for (int level = 0; level < levels; level++)
        for (int64_t j = 0; j < (int64_t)1 << level; j++) {
            int64_t low = DERMIS_LANES * (j * blocks >> level), high = DERMIS_LANES * ((j + 1) * blocks >> level);
            int64_t middle = DERMIS_LANES * ((2 * j + 1) * blocks >> (level + 1));
            if (high > count) high = count;
            if (low < middle && middle < high) part(places, low, high, middle, longest(places, low, high));
        }
    for (int64_t low = 0; low < count; low += DERMIS_LANES) /* sort each block by number */
        for (int64_t i = low; i < low + DERMIS_LANES && i < count; i++) {
            int64_t at = i, triangle = places[i].triangle;
            for (; at > low && tree->order[at - 1] > triangle; at--) tree->order[at] = tree->order[at - 1];
            tree->order[at] = triangle;
        }
    return DERMIS_DONE;
}

/* A box in double precision: its centre [m], its unit axes, half its size along each axis [m], and `facing`: twice the
   length of the sum of its triangles' area vectors [m^2]. */
typedef struct {
    double middle[3], axis[3][3], half[3], facing;
} box;

/* Compute the box around points with given axes; keep it if it is the first, or has a smaller face than the box in
   `out`.

   facing: the first axis. towards: the second axis is the part of this vector that is normal to the first. If there is
   no such part, nothing is done. */
static void boxed(box *out, double (*points)[3], int count, const double *facing, const double *towards, int first) {
    double axis[3][3], middle[3], half[3];
    double off = dermis_dot(towards, facing);
    for (int k = 0; k < 3; k++) axis[0][k] = facing[k], axis[1][k] = towards[k] - off * facing[k];
    double length = dermis_root(dermis_dot(axis[1], axis[1]));
    if (!(length > NOTHING * dermis_root(dermis_dot(towards, towards)))) return;
    for (int k = 0; k < 3; k++) axis[1][k] /= length;
    dermis_cross(axis[0], axis[1], axis[2]);
    for (int i = 0; i < 3; i++) {
        double low = dermis_dot(points[0], axis[i]), high = low;
        for (int j = 1; j < count; j++) {
            double along = dermis_dot(points[j], axis[i]);
            low = dermis_least(low, along), high = dermis_most(high, along);
        }
        middle[i] = (low + high) / 2.0, half[i] = (high - low) / 2.0;
    }
    if (!first && !(half[1] * half[2] < out->half[1] * out->half[2])) return;
    for (int k = 0; k < 3; k++) {
        out->middle[k] = middle[0] * axis[0][k] + middle[1] * axis[1][k] + middle[2] * axis[2][k];
        out->half[k] = half[k];
        for (int i = 0; i < 3; i++) out->axis[i][k] = axis[i][k];
    }
}

/* Compute a box around points, whose first axis is along `facing`, the area vector of their triangles.

   Two directions are tried for the second axis: a coordinate axis along which the points extend far, and the direction
   to the point that is farthest from their middle, measured across the first axis. `points` are changed. */
static void bound(box *out, double (*points)[3], int count, const double *facing) {
    double middle[3], size[3], unit[3], far[3] = {0.0, 0.0, 0.0}, farthest = 0.0;
    for (int k = 0; k < 3; k++) {
        double low = points[0][k], high = low;
        for (int j = 1; j < count; j++) low = dermis_least(low, points[j][k]), high = dermis_most(high, points[j][k]);
        middle[k] = (low + high) / 2.0, size[k] = high - low;
    }
    out->facing = dermis_root(dermis_dot(facing, facing));
    for (int k = 0; k < 3; k++) unit[k] = out->facing > 0.0 ? facing[k] / out->facing : k == 0;
    for (int j = 0; j < count; j++) { /* relative to the middle, so that no digits cancel */
        double square = 0.0, off;
        for (int k = 0; k < 3; k++) points[j][k] -= middle[k];
        off = dermis_dot(points[j], unit);
        for (int k = 0; k < 3; k++) square += (points[j][k] - off * unit[k]) * (points[j][k] - off * unit[k]);
        if (square > farthest) {
            farthest = square;
            for (int k = 0; k < 3; k++) far[k] = points[j][k];
        }
    }
    int axis = size[1] > size[0] ? 1 : 0;
    if (size[2] > size[axis]) axis = 2;
    if (dermis_abs(unit[axis]) > 0.9) axis = size[(axis + 1) % 3] > size[(axis + 2) % 3] ? (axis + 1) % 3 : (axis + 2) % 3;
    double world[3] = {axis == 0, axis == 1, axis == 2};
    boxed(out, points, count, unit, world, 1);
    boxed(out, points, count, unit, far, 0);
    for (int k = 0; k < 3; k++) out->middle[k] += middle[k];
}

/* Compute the flat box around a triangle, with its second axis along the longest edge. */
static void bound_triangle(box *out, const double *row) {
    double edge[3][3], normal[3];
    int longest = 0;
    for (int k = 0; k < 3; k++) edge[0][k] = row[AB + k], edge[1][k] = row[AC + k], edge[2][k] = row[AC + k] - row[AB + k];
    for (int i = 1; i < 3; i++)
        if (row[AB_AB + i] > row[AB_AB + longest]) longest = i;
    dermis_cross(row + AB, row + AC, normal);
    out->facing = dermis_root(dermis_dot(normal, normal));
    double length = dermis_root(dermis_dot(edge[longest], edge[longest]));
    for (int k = 0; k < 3; k++) out->axis[0][k] = normal[k] / out->facing, out->axis[1][k] = edge[longest][k] / length;
    dermis_cross(out->axis[0], out->axis[1], out->axis[2]);
    for (int k = 0; k < 3; k++) out->middle[k] = row[k];
    for (int i = 0; i < 3; i++) { /* the coordinates are relative to corner a, where they are 0 */
        double b = dermis_dot(row + AB, out->axis[i]), c = dermis_dot(row + AC, out->axis[i]);
        double low = dermis_least(0.0, dermis_least(b, c)), high = dermis_most(0.0, dermis_most(b, c));
        out->half[i] = (high - low) / 2.0;
        for (int k = 0; k < 3; k++) out->middle[k] += (low + high) / 2.0 * out->axis[i][k];
    }
}

/* Fill in the corners of triangles, and twice the sum of their area vectors [m^2]; return the number of corners. */
static int corners_of(const double *row, int64_t count, double (*points)[3], double *facing) {
    for (int k = 0; k < 3; k++) facing[k] = 0.0;
    for (int64_t i = 0; i < count; i++, row += DERMIS_ROW) {
        double normal[3];
        dermis_cross(row + AB, row + AC, normal);
        for (int k = 0; k < 3; k++) {
            points[3 * i][k] = row[k], points[3 * i + 1][k] = row[k] + row[AB + k], points[3 * i + 2][k] = row[k] + row[AC + k];
            facing[k] += normal[k];
        }
    }
    return (int)(3 * count);
}

/* Fill in the corners of boxes, and twice the sum of their triangles' area vectors [m^2]; return the number of
   corners. */
static int corners_of_boxes(const box *boxes, int count, double (*points)[3], double *facing) {
    int n = 0;
    for (int k = 0; k < 3; k++) facing[k] = 0.0;
    for (int i = 0; i < count; i++) {
        const box *b = &boxes[i];
        if (b->half[0] < 0.0) continue; /* an empty box */
        for (int j = 0; j < 8; j++, n++)
            for (int k = 0; k < 3; k++)
                points[n][k] = b->middle[k] + (j & 1 ? 1.0 : -1.0) * b->half[0] * b->axis[0][k] +
                               (j & 2 ? 1.0 : -1.0) * b->half[1] * b->axis[1][k] +
                               (j & 4 ? 1.0 : -1.0) * b->half[2] * b->axis[2][k];
        for (int k = 0; k < 3; k++) facing[k] += b->facing * b->axis[0][k];
    }
    return n;
}

/* The empty box: its half sizes are negative. */
static const box NONE = {{0.0, 0.0, 0.0}, {{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}}, {-1.0, -1.0, -1.0}, 0.0};

/* Store a box in single precision, as number `lane` of a group of boxes.

   A box far from the tree's middle, or large, is enlarged by the rounding error of its own numbers.

   give: enlargement of the box on each side [m]. */
static void store(const dermis_tree *tree, const box *b, float *boxes, int lane, double give) {
    int none = b->half[0] < 0.0;
    double farthest = tree->scale;
    for (int k = 0; k < 3; k++) farthest = dermis_most(farthest, dermis_most(dermis_abs(b->middle[k] - tree->middle[k]), b->half[k]));
    float rounded = ROUNDED * (float)(farthest / tree->scale);
    for (int k = 0; k < 3; k++) {
        boxes[DERMIS_LANES * k + lane] = (float)((b->middle[k] - tree->middle[k]) / tree->scale);
        for (int i = 0; i < 3; i++) boxes[DERMIS_LANES * (AXES + 3 * i + k) + lane] = (float)b->axis[i][k];
        boxes[DERMIS_LANES * (HALF + k) + lane] = none ? -NOWHERE : (float)((b->half[k] + give) / tree->scale) + rounded;
    }
    if (none) boxes[lane] = 0.0f;
    boxes[DERMIS_LANES * 15 + lane] = 0.0f;
}

/* Compute and store the boxes of a node's children, recursively, or of a leaf's triangles; return the node's own box.

   level: of the node. j: its number among the nodes of this level. */
static box bounded(const dermis_tree *tree, int64_t node, int level, int64_t j, double give) {
    double points[8 * DERMIS_LANES][3], facing[3];
    int64_t blocks = blocks_of(tree), inner = (((int64_t)1 << 2 * tree->depth) - 1) / 3;
    box own = NONE, children[DERMIS_LANES];
    if (level < tree->depth) {
        for (int k = 0; k < DERMIS_LANES; k++) {
            children[k] = bounded(tree, 4 * node + 1 + k, level + 1, 4 * j + k, give);
            store(tree, &children[k], tree->boxes + node * DERMIS_BOXES, k, give);
        }
        int count = corners_of_boxes(children, DERMIS_LANES, points, facing);
        if (count) bound(&own, points, count, facing);
        return own;
    }
    int64_t low = j * blocks >> 2 * level, high = (j + 1) * blocks >> 2 * level;
    int held = 0;
    box of_blocks[DERMIS_LANES];
    for (int64_t b = low; b < high; b++) {
        const double *row = tree->packed + b * DERMIS_LANES * DERMIS_ROW;
        int64_t count = tree->count - b * DERMIS_LANES;
        if (count > DERMIS_LANES) count = DERMIS_LANES;
        for (int k = 0; k < DERMIS_LANES; k++) {
            box one = NONE;
            if (k < count) bound_triangle(&one, row + k * DERMIS_ROW);
            store(tree, &one, tree->boxes + (inner + b) * DERMIS_BOXES, k, give);
        }
        int corners = corners_of(row, count, points, facing);
        bound(&of_blocks[held++], points, corners, facing);
    }
    if (held == 1) return of_blocks[0];
    int corners = corners_of_boxes(of_blocks, held, points, facing);
    if (corners) bound(&own, points, corners, facing);
    return own;
}

/* Insert a number into a sorted list of others. */
static void insert(double *values, int count, double value) {
    for (; count > 0 && values[count - 1] > value; count--) values[count] = values[count - 1];
    values[count] = value;
}

/* Set the tree's middle and scale to those of most of its triangles, by medians: a vertex that lies far apart must not
   blur the boxes of all others, whose rounding errors go with the scale.

   size: of the box around all triangles [m]. */
static void centre(dermis_tree *tree, double size) {
    int64_t step = (tree->count + SOME - 1) / SOME;
    double values[SOME], spread = 0.0;
    for (int k = 0; k < 3; k++) {
        int count = 0;
        for (int64_t i = 0; i < tree->count; i += step) insert(values, count++, tree->packed[i * DERMIS_ROW + k]);
        tree->middle[k] = values[count / 2], count = 0;
        for (int64_t i = 0; i < tree->count; i += step)
            insert(values, count++, dermis_abs(tree->packed[i * DERMIS_ROW + k] - tree->middle[k]));
        spread = dermis_most(spread, values[count / 2]);
    }
    tree->scale = 4.0 * spread; /* the length over which triangles are spread evenly */
    if (!(tree->scale * FARTHEST > size)) tree->scale = size;
}

DERMIS_NOINLINE static int32_t fit(dermis_tree *tree) {
    int64_t count = tree->count, total = tree->total;
    double low[3] = {DBL_MAX, DBL_MAX, DBL_MAX}, high[3] = {-DBL_MAX, -DBL_MAX, -DBL_MAX}, largest = 0.0, size = 0.0;
    if (blocks_of(tree) >> 2 * tree->depth > 2) return DERMIS_BAD_RECORD;
    for (int64_t i = 0; i < count; i++) {
        int64_t triangle = tree->order[i];
        double *row = tree->packed + i * DERMIS_ROW;
        if (triangle < 0 || triangle >= total) return DERMIS_BAD_RECORD;
        dermis_gather(tree, triangle, row);
        int known = row[INVERSE] > 0.0;
        for (int k = 0; k < SLIVER; k++) known = known && dermis_finite(row[k]);
        if (!known) {
            tree->wrong = triangle;
            return DERMIS_NOT_FINITE;
        }
        for (int k = 0; k < 3; k++) {
            double b = row[k] + row[AB + k], c = row[k] + row[AC + k];
            low[k] = dermis_least(low[k], dermis_least(row[k], dermis_least(b, c)));
            high[k] = dermis_most(high[k], dermis_most(row[k], dermis_most(b, c)));
        }
    }
    for (int k = 0; k < 3; k++) {
        size = dermis_most(size, high[k] - low[k]);
        largest = dermis_most(largest, dermis_most(dermis_abs(low[k]), dermis_abs(high[k])));
    }
    tree->largest = largest;
    centre(tree, size);
    bounded(tree, 0, 0, 0, ROUNDING * largest);
    return DERMIS_DONE;
}

DERMIS_FUNCTION(dermis_tree_split, dermis_tree, sound, split)
DERMIS_FUNCTION(dermis_tree_fit, dermis_tree, sound, fit)
