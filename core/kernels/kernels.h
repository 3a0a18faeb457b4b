/* The library's interface to Python: records, statuses and functions.

   Python allocates every array and passes one record a call. The library allocates nothing, keeps nothing between calls and
   calls no other library: it needs sqrt, fabs and floor alone, which are instructions of the processors that it is built for.
   core/kernels/records.py mirrors the records; `dermis_layout` lets the loader compare them. */
#ifndef DERMIS_KERNELS_H
#define DERMIS_KERNELS_H

#include <stddef.h>
#include <stdint.h>

/* Raise it when a function changes its meaning and no record changes its layout. */
#define DERMIS_ABI 2

#if defined(_WIN32)
#define DERMIS_API __declspec(dllexport)
#else
#define DERMIS_API __attribute__((visibility("default")))
#endif
#define DERMIS_NOINLINE __attribute__((noinline))

enum {
    DERMIS_DONE = 0,
    DERMIS_BAD_RECORD = 1,   /* a count, a depth or an index that none can be */
    DERMIS_NOT_FINITE = 2    /* a number, or an area's square, that is not finite; `wrong` of the record says at which index */
};

/* Pairs of sweeps that are remembered. */
enum { DERMIS_KEPT = 3 };

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
    double largest;         /* out, or in without `packed`: the largest amount of a coordinate [m] */
    int64_t wrong;          /* out: the triangle that is not finite */
} dermis_tree;

/* A body: its triangles, how they hang together, and how the side of a point is told. */
typedef struct dermis_body {
    const struct dermis_body *next; /* another solid that runs through this one: both are the body; null for no more */
    const dermis_tree *tree;    /* the triangles that may be closest; without `packed`, each of them is looked at */
    const dermis_tree *all;     /* all triangles of the body, for rays, as a rule the same; null where none are cast */
    int64_t vertices;           /* how many there are */
    int64_t closed;             /* 1 where the triangles have an inside and an outside, 0 for an open sheet */
    int64_t by_rays;            /* 1 where rays tell the side of every point, 0 where the closest triangle does */
    int64_t outside;            /* how often the triangles wind round a point outside: 0, or -1 where they are inside out */
    int64_t parts;              /* parts that do not hang together */
    int64_t slabs;              /* slabs that the body lies within */
    double weld;                /* corners that are one vertex may lie so far apart [m] */
    const int64_t *corners;     /* vertices of each triangle; those at one place have one number (total, 3) */
    const int64_t *across;      /* the triangle across each edge, -1 where there is not exactly one (total, 3) */
    const int8_t *edge_kind;    /* DERMIS_REGULAR and so on (total, 3) */
    const int8_t *vertex_kind;  /* the same of vertices (vertices) */
    const int64_t *part;        /* a triangle of each part (parts) */
    const double *slab;         /* a direction, and how far the body reaches along it, down and up [m] (slabs, 5) */
    double *normals;            /* pseudonormals of the vertices (vertices, 3); null: they are summed when they are asked for */
} dermis_body;

/* Kinds of edges and vertices: two faces that agree about the outside; one face; anything else. */
enum { DERMIS_REGULAR = 0, DERMIS_BOUNDARY = 1, DERMIS_IRREGULAR = 2 };

/* Points, and their signed distances to a body. Beyond the limit gap is infinite, the closest point NaN, the rest 0. */
typedef struct {
    const dermis_body *body;
    int64_t count;        /* points */
    double limit;         /* largest distance of interest outside [m], may be infinite; points inside are always answered */
    const double *points; /* (count, 3) [m] */
    double *gap;          /* out: signed distance, negative inside (count) [m] */
    double *normal;       /* out: unit gradient of the gap (count, 3) */
    double *closest;      /* out: the closest point (count, 3) [m] */
    double *weights;      /* out: of the triangle's corners at the closest point (count, 3) */
    int64_t *triangle;    /* out: the closest, -1 beyond the limit (count) */
    int8_t *feature;      /* out: 0 within the face, 1 + k on edge k (k to k + 1), 4 + k on corner k (count) */
    int8_t *beside;       /* out: 1 where the point has passed beside the rim of an open sheet (count) */
    int64_t wrong;        /* out: the point that is not finite, or -1 - the triangle */
} dermis_query;

/* Nodes that may touch, and the forces on them: w = C f + softness f + offset obeys Coulomb's law with f.

   Where a normal is shorter than 0.7, nothing is near and no force acts. */
typedef struct {
    int64_t count;           /* nodes */
    int64_t single;          /* 1: the compliance is of floats; 0: of doubles */
    int64_t stride;          /* numbers from one row of the compliance to the next */
    const void *compliance;  /* C, symmetric positive definite (3 count, stride) [m/N] */
    const double *offset;    /* (count, 3) [m] */
    const double *normals;   /* of length 1, or 0 where nothing is near (count, 3) */
    const double *friction;  /* coefficients (count) */
    const double *softness;  /* compliance of what lies below each node (count) [m/N] */
    double tolerance;        /* of the residual */
    int64_t most;            /* sweeps */
    double *force;           /* in: to start from; out (count, 3) [N] */
    double *image;           /* out: C f (count, 3) [m] */
    int64_t given;           /* nodes that are swept: those that may come to carry force, and all that do at the start */
    const int64_t *nodes;    /* which these are (given); not read where all are */
    double *room;            /* to work in: 9 DERMIS_KEPT + 12 doubles a given node, and unless all are, 14 more and C among them */
    double residual;         /* out: |f - P(f - w / own)| / |f|, own the mean compliance of a node to its own force */
    int64_t sweeps;          /* out */
    int64_t wrong;           /* out: the node that is not finite */
} dermis_contact;

/* Put the triangles `order` into the order of a tree's slots, so that neighbours share leaves. */
DERMIS_API int32_t dermis_tree_split(dermis_tree *tree);

/* Fill `packed` and `boxes` for triangles in the order of a tree's slots. */
DERMIS_API int32_t dermis_tree_fit(dermis_tree *tree);

/* Check the indices of a body, and fill `normals` where there is room for them. */
DERMIS_API int32_t dermis_body_fit(dermis_body *body);

/* Set `by_rays` of a closed body that was fitted: whether its triangles run through each other, lie back to back, or one
   part of them lies within another. */
DERMIS_API int32_t dermis_body_judge(dermis_body *body);

/* Measure the signed distances of points to a body that was fitted. */
DERMIS_API int32_t dermis_distances(dermis_query *query);

/* Find the forces of contact from those to start from. */
DERMIS_API int32_t dermis_sweep(dermis_contact *contact);

/* The ABI number, and the size and offsets of each record; the last number is UINT64_MAX. */
DERMIS_API const uint64_t *dermis_layout(void);

/* The names of the records' fields, in that order. */
DERMIS_API const char *dermis_fields(void);

/* The digest of the sources and flags that the library was built from. */
DERMIS_API const char *dermis_sources(void);

#endif
