/* The library's interface to Python: records, statuses and functions.

   Python allocates every array and passes one record a call. The library allocates nothing, keeps nothing between calls and
   calls no other library: it needs sqrt, fabs and floor alone, which are instructions of the processors that it is built for.
   core/kernels/records.py mirrors the records; `dermis_layout` lets the loader compare them. */
#ifndef DERMIS_KERNELS_H
#define DERMIS_KERNELS_H

#include <stddef.h>
#include <stdint.h>

/* Raise it when a function changes its meaning and no record changes its layout. */
#define DERMIS_ABI 1

#if defined(_WIN32)
#define DERMIS_API __declspec(dllexport)
#else
#define DERMIS_API __attribute__((visibility("default")))
#endif
#define DERMIS_NOINLINE __attribute__((noinline))

enum {
    DERMIS_DONE = 0,
    DERMIS_BAD_RECORD = 1,   /* a count or a depth that no tree has */
    DERMIS_NOT_FINITE = 2    /* a number, or an area's square, that is not finite; `wrong` of the record says at which index */
};

/* Doubles of a triangle in a tree; boxes that are looked at at once, and floats of so many. */
enum { DERMIS_ROW = 16, DERMIS_LANES = 4, DERMIS_BOXES = 64 };

/* Triangles, and a tree of boxes over those that are usable.

   Triangles stand in slots, four to a block; the last block may be short. A node has four children, and node i those of the
   numbers 4 i + 1 to 4 i + 4, level by level. Leaf j of 4^depth holds the blocks j blocks / 4^depth to
   (j + 1) blocks / 4^depth, rounded down; it may hold none. The boxes of the children of every node that is no leaf come
   first, then those of the triangles of every block; they are in units of `scale` about `middle`. */
typedef struct {
    int64_t total;          /* triangles of the table */
    int64_t count;          /* triangles in the tree, 1 to 2^31 - 1 */
    int64_t depth;          /* levels below the root, 0 to 15 */
    const double *rows;     /* of the table: (14, total), see core/surface/triangles.py */
    const double *bounds;   /* of the table: (7, total) */
    const uint8_t *slivers; /* (total), or null where there are none */
    int64_t *order;         /* the triangle in each slot (count) */
    double *packed;         /* the rows of each slot's triangle (count, DERMIS_ROW) */
    float *boxes;           /* ((4^depth - 1) / 3 + blocks, DERMIS_BOXES) */
    double middle[3];       /* out [m] */
    double scale;           /* out [m] */
    int64_t wrong;          /* out: the triangle that is not finite */
} dermis_tree;

/* Points, and the closest triangle of each of them. */
typedef struct {
    const dermis_tree *tree;
    int64_t count;        /* points */
    double limit;         /* largest distance of interest [m], may be infinite */
    const double *points; /* (count, 3) [m] */
    const int64_t *hints; /* a triangle that is likely near each point, -1 for none (count); or null */
    int64_t *triangle;    /* out: the closest, -1 beyond the limit (count) */
    double *weights;      /* out: of its corners at the closest point (count, 3) */
    double *closest;      /* out: the closest point (count, 3) [m] */
    double *square;       /* out: squared distance (count) [m^2] */
    int8_t *feature;      /* out: 0 within the face, 1 + k on edge k (k to k + 1), 4 + k on corner k (count) */
    int64_t wrong;        /* out: the point that is not finite, or -1 - the triangle */
} dermis_query;

/* Put the triangles `order` into the order of a tree's slots, so that neighbours share leaves. */
DERMIS_API int32_t dermis_tree_split(dermis_tree *tree);

/* Fill `packed` and `nodes` for triangles in the order of a tree's slots. */
DERMIS_API int32_t dermis_tree_fit(dermis_tree *tree);

/* Find the closest triangle of each point, by the tree. */
DERMIS_API int32_t dermis_closest(dermis_query *query);

/* The same without a tree, by looking at every triangle of `order`: for a few points. */
DERMIS_API int32_t dermis_closest_of_all(dermis_query *query);

/* The ABI number, and the size and offsets of each record; the last number is UINT64_MAX. */
DERMIS_API const uint64_t *dermis_layout(void);

/* The names of the records' fields, in that order. */
DERMIS_API const char *dermis_fields(void);

/* The digest of the sources and flags that the library was built from. */
DERMIS_API const char *dermis_sources(void);

#endif
