/* The library's interface to Python: records, statuses and functions.

   Python allocates every array and passes one record a call. The library allocates nothing, keeps nothing between calls and
   calls no other library: it needs sqrt, fabs and floor alone, which are instructions of the processors that it is built for.
   core/kernels/records.py mirrors the records; `dermis_layout` lets the loader compare them. */
#ifndef DERMIS_KERNELS_H
#define DERMIS_KERNELS_H

#include <stddef.h>
#include <stdint.h>

/* Raise it when a function changes its meaning and no record changes its layout. */
#define DERMIS_ABI 4

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

/* Doubles of a triangle in a tree; boxes, or elements of tissue, that are looked at at once, and floats of so many boxes. */
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
    int64_t avx2;            /* 1: the processor has AVX2, see `dermis_has_avx2`: the same bytes, sooner */
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

/* A body in the frame of the skin: x in the skin's frame is rotation X + translation. */
typedef struct {
    const dermis_body *body; /* fitted, or null for the half-space below a plane */
    double plane[4];         /* its unit normal, and how far it is along that [m] */
    double rotation[9];      /* rows first */
    double translation[3];   /* [m] */
    double friction;         /* Coulomb's coefficient */
    double softness;         /* compliance of the body's own surface [m/Pa] */
    double side;             /* 1; -1 where an open sheet is touched from behind its faces */
} dermis_posed;

/* A pad's cells, the bodies about it, and which of the cells may touch: a quadtree, see `survey.c`.

   Of every cell are given where it lies in the tree (see core/skin/tiles.py), its centre, normal and sides, and how near it
   counts as touching. Skin has moved at a cell as the points under it have. */
typedef struct {
    int64_t bodies;
    const dermis_posed *posed;   /* (bodies) */
    double limit;                /* distances beyond this are of no interest [m] */
    int64_t roots, levels;       /* cells of level 0, which come first, and levels */
    int64_t squares;             /* the finest squares in a root */
    const int64_t *first;        /* cell of each shape that comes first, -1 without (levels, levels) */
    const int64_t *ways;         /* a way to cut for each way that is wanted, 0 without (levels, levels, 4) */
    const int64_t *root;         /* of every cell (cells) */
    const int64_t *halved;       /* how often its sides are halved (cells, 2) */
    const int64_t *place;        /* in its root (cells, 2) */
    const int16_t *quarters;     /* the squares in the middles of its quarters (cells, 4) */
    const double *positions, *normals; /* outward (cells, 3) [m] */
    const double *sides;         /* (cells, 2, 3) [m] */
    const double *limits;        /* it may touch below so much clearance (cells) [m] */
    const double *longs;         /* its longer side (cells) [m] */
    const int64_t *ways_before;  /* in which way it is cut now, 0 for none (cells) */
    int64_t points;              /* points of the skin that are known now */
    const int64_t *owner;        /* the point over each finest square, -1 without (roots, squares) */
    const int64_t *in_root;      /* the last point in each root, -1 without (roots) */
    const double *raised;        /* how far each point has moved (points, 3) [m] */
    int64_t loaded;              /* roots that carry force */
    const double *load;          /* theirs, over the modulus (loaded, 3) [m^2] */
    const int64_t *rows;         /* which rows of the table are theirs (loaded) */
    int64_t filled;              /* rows of the table */
    const float *table;          /* what a force on a root does to all (filled, 3, roots, 3) [1/m] */
    double common[3];            /* how far all skin moves with the bone [m] */
    double turned, edge, sharp, bent, corners, beyond, beside, merge, odd, level, deep, steep; /* the rule, see point_tree.py */
    int64_t often, coarsest, many;
    int64_t thorough;            /* 1: corners are looked at even where one flat face is all that is near; the same cells */
    int64_t most;                /* room for so many cells; at least 4 a root are enough */
    int64_t *room;               /* to work in (2, most) */
    int64_t finest;              /* in: how often sides were halved at most the last time; out: this time */
    int64_t found, cut, edges;   /* out: cells that may touch, that are cut, and that an edge is near */
    int64_t *leaves;             /* out: cells that may touch (found) */
    double *clearance;           /* out: theirs (found) [m] */
    int64_t *cuts, *cut_ways;    /* out: cells that are cut, and in which way (cut) */
} dermis_survey;

/* The neo-Hookean law on a mesh of tetrahedra; elements stand in blocks of DERMIS_LANES, the last filled up with copies
   of the last element without volume. */
typedef struct {
    int64_t nodes, elements;
    const int32_t *corners; /* (blocks, 4, DERMIS_LANES) */
    const float *slopes;    /* of the shape functions of corners 1 to 3 [1/m] (blocks, 3, 3, DERMIS_LANES) */
    const float *volumes;   /* (blocks, DERMIS_LANES) [m^3] */
    const float *around;    /* volume of the elements around each node (nodes) [m^3] */
    double first, shear;    /* Lame's constants */
    double least;           /* ln J goes on as its parabola below this J */
    const float *moved;     /* displacement (nodes, 3) [m] */
    float *room;            /* to work in: 9 floats an element of the blocks, and 8 a node */
    float *force;           /* out: that hold it (nodes, 3), or null */
    double *stress;         /* out: xx, yy, zz, yz, xz, xy (elements, 6), or null */
    int64_t stored;         /* 1: `energy` is wanted */
    double energy;          /* out */
    double flattest;        /* out: the least J of the elements */
} dermis_law;

/* Linear tissue: blocks of its stiffness, inverted after those before them are eliminated. */
typedef struct {
    int64_t size;           /* of a vector */
    int64_t levels;
    const int64_t *starts;  /* where each level begins, multiples of 8: each is filled up (levels + 1) */
    const int32_t *order;   /* which number of a vector each slot is, -1 for none (slots) */
    int64_t numbers;        /* of the inverses */
    const float *inverses;  /* of each level: below the diagonal, see rest.c */
    const float *diagonals; /* theirs (slots) */
    int64_t couplings;
    const int64_t *rows;    /* where each slot's begin (slots + 1) */
    const int32_t *columns; /* slots of the next level (couplings) */
    const float *values;    /* stiffness between the two (couplings) */
    const float *force;     /* (size) */
    float *moved;           /* out (size) */
    float *room;            /* to work in (3, slots) */
} dermis_rest;
/* Pieces of skin: centres, outward unit normals, two sides and areas. */
typedef struct {
    int64_t count;
    const double *positions, *normals; /* (count, 3) [m] */
    const double *sides;               /* in the tangent plane (count, 2, 3) [m] */
    const double *areas;               /* (count) [m^2] */
} dermis_patches;

/* The displacement of pieces of skin for unit forces on others, see `half_space.c`. */
typedef struct {
    const dermis_patches *field, *source; /* pieces that move, and that carry forces */
    double poisson;
    int64_t single; /* 1: the answer is in floats; 0: in doubles */
    void *out;      /* (field, 3, source, 3) [1/m] at E = 1 */
} dermis_pieces;

/* The points of a contact on a pad's grid of finest squares, see `points.c`. */
typedef struct {
    int64_t known;            /* cells of the pad */
    int64_t side;             /* finest squares along a root */
    const int64_t *root;      /* of every cell (known) */
    const int64_t *halved;    /* how often its sides are halved (known, 2) */
    const int64_t *place;     /* in its root (known, 2) */
    const int64_t *around;    /* the root at each place around a root, the number of roots without (roots, 3, 3) */
    int64_t before;           /* points that there were */
    const int64_t *old_cells; /* theirs (before) */
    int64_t count;            /* points that there are */
    const int64_t *cells;     /* theirs (count) */
    int64_t *owner;           /* in and out: the point over each square, -1 without; the last root is beside the pad (roots + 1, side^2) */
    int64_t *in_root;         /* in and out: the last point in each root, -1 without (roots) */
    int64_t *number;          /* in and out: the point that each cell is, -1 for none (known) */
    int64_t *beside;          /* out: the points before and behind, along the finger and around it, -1 without (count, 4) */
} dermis_points;

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

/* Find the cells of a pad that may touch. */
DERMIS_API int32_t dermis_find_cells(dermis_survey *survey);

/* Evaluate the law at a displacement. */
DERMIS_API int32_t dermis_evaluate_law(dermis_law *law);

/* Displace linear tissue by forces. */
DERMIS_API int32_t dermis_rest_solve(dermis_rest *rest);
/* Fill in the displacement between pieces of skin. */
DERMIS_API int32_t dermis_press_pieces(dermis_pieces *pieces);

/* Go over from points that there were to others. */
DERMIS_API int32_t dermis_number_points(dermis_points *points);

/* Return 1 where this processor and system have AVX2, else 0. */
DERMIS_API int32_t dermis_has_avx2(void);

/* The ABI number, and the size and offsets of each record; the last number is UINT64_MAX. */
DERMIS_API const uint64_t *dermis_layout(void);

/* The names of the records' fields, in that order. */
DERMIS_API const char *dermis_fields(void);

/* The digest of the sources and flags that the library was built from. */
DERMIS_API const char *dermis_sources(void);

#endif
