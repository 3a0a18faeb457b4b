/* The library's interface to Python: records, statuses and functions.

   Python allocates every array and passes one record to each call. The library allocates nothing and keeps nothing
   between calls. It needs no mathematical library: square root and absolute value are instructions of the processors
   for which it is built.

   `declared` of core/kernels/building.py reads this file, records.py makes the records of Python from it, and the
   compiler checks what was read. The fields of a record are int64_t, double, arrays of these, and pointers. */
#ifndef DERMIS_KERNELS_H
#define DERMIS_KERNELS_H

#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32)
#define DERMIS_API __declspec(dllexport)
#else
#define DERMIS_API __attribute__((visibility("default")))
#endif
#define DERMIS_NOINLINE __attribute__((noinline))

/* Version of the interface. Increase it if the meaning of a function changes while the layouts of all records stay. */
enum { DERMIS_ABI = 4 };

enum {
    DERMIS_DONE = 0,
    DERMIS_BAD_RECORD = 1,   /* a count, a depth or an index has an impossible value */
    DERMIS_NOT_FINITE = 2,   /* a number is not finite, a coefficient is negative, or the square of a triangle's area is
                                zero or not finite; the record's field `wrong`, if there is one, is the index */
    DERMIS_ASKS = 3          /* the caller has to compute something, and to call again with the same record */
};

/* Largest number of earlier pairs of sweeps from which `dermis_sweep` extrapolates. */
enum { DERMIS_KEPT = 3 };

/* Numbers of a point in the blocks of a `dermis_touch`: what a look finds, and the workspace without the compliance.
   SWEEP_ROOM: numbers of a node in the workspace of a `dermis_contact`. */
enum { DERMIS_FOUND = 12, DERMIS_TOUCH_ROOM = 122, DERMIS_SWEEP_ROOM = 57 };

/* ROW: doubles per triangle in a tree. LANES: boxes, or elements of tissue, that are processed at once.
   BOXES: floats for a group of LANES boxes. */
enum { DERMIS_ROW = 16, DERMIS_LANES = 4, DERMIS_BOXES = 64 };

/* Triangles, and a tree of boxes around those that are usable.

   Each slot of the tree holds one triangle. Four slots are a block; the last block may have fewer. Nodes are numbered
   level by level from the root, which is node 0, and the children of node i are the nodes 4 i + 1 to 4 i + 4. There are
   4^depth leaves. Of n blocks, leaf j holds those from j n / 4^depth up to but not including (j + 1) n / 4^depth, both
   rounded down; a leaf may hold none.

   `boxes` is a list of groups of four boxes. First comes a group for each node that is no leaf: the boxes of its
   children. Then comes a group for each block: the boxes of its triangles. Lengths are divided by `scale`, and `middle`
   is the origin. */
typedef struct {
    int64_t total;          /* triangles in the table */
    int64_t count;          /* triangles in the tree, 1 to 2^31 - 1 */
    int64_t depth;          /* levels below the root, 0 to 15 */
    const double *rows;     /* of the table, see core/surface/triangles.py (14, total) */
    const double *bounds;   /* of the table (7, total) */
    const uint8_t *slivers; /* of the table (total); null if no triangle is a sliver */
    int64_t *order;         /* index of the triangle in each slot (count) */
    double *packed;         /* data of the triangle in each slot, see triangle.h (count, DERMIS_ROW); null: there is no
                               tree */
    float *boxes;           /* see above ((4^depth - 1) / 3 + blocks, DERMIS_BOXES) */
    double middle[3];       /* out: median of the triangles' corners along each coordinate axis [m] */
    double scale;           /* out: length over which most triangles are spread [m] */
    double largest;         /* largest absolute coordinate [m]: out. If `packed` is null: in, and an upper bound is
                               enough */
    int64_t wrong;          /* out: index of the triangle that was refused */
} dermis_tree;

/* The triangles of a convex body, whose closest triangle is found by a walk from neighbour to neighbour. */
typedef struct {
    const int64_t *beside; /* slot of the neighbour at each edge of the triangle in each slot, -1 for none (count, 3) */
    double *facing;        /* out: unit normal of the triangle in each slot, and twice its area [m^2] (count, 4) */
    double bulge;          /* out: height of a triangle above the plane of another one near it, at most; infinite if the
                              body is not convex [m] */
} dermis_convex;

/* A body: its triangles, their topology, and the method that determines whether a point is inside. */
typedef struct dermis_body {
    const struct dermis_body *next; /* a solid that overlaps this one: the body is the union of both; null: no further
                                       solid */
    const dermis_tree *tree;    /* triangles that may be closest; if its `packed` is null, every triangle is examined */
    const dermis_tree *all;     /* all triangles of the body, for rays; usually the same tree; null: no rays are cast */
    int64_t vertices;           /* number of vertices */
    int64_t closed;             /* 1: the triangles separate an inside from an outside; 0: they are an open sheet */
    int64_t by_rays;            /* 1: rays determine the side of every point; 0: the closest triangle does if it can */
    int64_t outside;            /* winding number of points outside: 0, or -1 if the triangles are inside out */
    int64_t hollow;             /* in: 1 if the body has several parts; out: 1 also if faces meet in a hollow, see
                                   distance.c */
    int64_t parts;              /* number of connected parts listed in `part` */
    int64_t slabs;              /* number of slabs; the body lies within each of them */
    double weld;                /* largest distance between corners that were merged into one vertex [m] */
    const int64_t *corners;     /* vertices of each triangle; merged vertices have the same index (total, 3) */
    const int64_t *across;      /* neighbouring triangle at each edge, -1 if there is not exactly one (total, 3) */
    const int8_t *edge_kind;    /* DERMIS_REGULAR, DERMIS_BOUNDARY or DERMIS_IRREGULAR (total, 3) */
    const int8_t *vertex_kind;  /* the same for vertices (vertices) */
    const int64_t *part;        /* index of one triangle of each part (parts) */
    const double *slab;         /* unit vector (3), and the body's least and largest coordinate along it [m] (slabs, 5);
                                   the first three are along x, y and z */
    double *normals;            /* pseudonormals of the vertices (vertices, 3); null: they are summed when they are
                                   needed */
    dermis_convex *convex;      /* null: the tree alone finds the closest triangle */
    double low[3], high[3];     /* out: the body's box by the first three slabs, enlarged for rounding; infinite without
                                   them [m] */
} dermis_body;

/* Kinds of edges. REGULAR: two faces that agree about the outside. BOUNDARY: one face. IRREGULAR: all others. A vertex
   is BOUNDARY if it has a BOUNDARY edge. Otherwise it is IRREGULAR if it has an IRREGULAR edge, or if sheets of faces
   meet in this vertex only. Otherwise it is REGULAR. */
enum { DERMIS_REGULAR = 0, DERMIS_BOUNDARY = 1, DERMIS_IRREGULAR = 2 };

/* Points, and their signed distances to a body.

   For a point beyond the limit, the gap is infinite, the closest point NaN, the triangle -1, and all other results are
   0. */
typedef struct {
    const dermis_body *body;
    int64_t count;        /* points */
    double limit;         /* largest distance outside that is measured [m], may be infinite; inside there is no limit */
    const double *points; /* (count, 3) [m] */
    double *gap;          /* out: signed distance, negative inside (count) [m] */
    double *normal;       /* out: unit gradient of the gap (count, 3) */
    double *closest;      /* out: closest point of the body (count, 3) [m] */
    double *weights;      /* out: barycentric weights of the closest point in its triangle (count, 3) */
    int64_t *triangle;    /* out: index of the closest triangle (count) */
    int8_t *feature;      /* out: part of the triangle with the closest point: 0 face, 1 + k edge k (corner k to k + 1),
                             4 + k corner k (count) */
    int8_t *beside;       /* out: 1 if the point lies beyond the rim of an open sheet (count) */
    int64_t wrong;        /* out: index of the point that is not finite, or -1 - index of the triangle that was
                             refused */
} dermis_query;

/* Status of a node. */
enum { DERMIS_STICK = 1, DERMIS_SLIP = 2 };

/* Nodes that may touch, and the contact forces f on them.

   The relative displacements w = C f + softness f + offset and the forces obey Coulomb's law. A node whose normal is
   shorter than 0.7 has no body nearby, and its force is zero. */
typedef struct {
    int64_t count;           /* number of nodes */
    int64_t single;          /* 1: the compliance has floats; 0: it has doubles */
    int64_t stride;          /* numbers from the start of one row of the compliance to the start of the next */
    int64_t avx2;            /* 1: use AVX2, see `dermis_has_avx2`; this is faster and gives the same bytes */
    const void *compliance;  /* C, symmetric positive definite (3 count, stride) [m/N] */
    const double *offset;    /* relative displacement without force (count, 3) [m] */
    const double *normals;   /* unit contact normals, 0 for nodes without a body nearby (count, 3) */
    const double *friction;  /* friction coefficients (count) */
    const double *softness;  /* compliance of the body below each node (count) [m/N] */
    double tolerance;        /* largest residual at which the sweeps stop */
    int64_t most;            /* largest number of sweeps */
    double *force;           /* in: initial guess; out: contact forces f (count, 3) [N] */
    double *image;           /* out: C f (count, 3) [m] */
    double *moved;           /* out: relative displacements w (count, 3) [m] */
    int8_t *status;          /* out: 0 open, DERMIS_STICK or DERMIS_SLIP (count) */
    double *room;            /* workspace (DERMIS_SWEEP_ROOM, count) */
    double residual;         /* out: |f - p| / max(|f|, |p|); infinite if there is no finite result. p is f - w / own,
                                without tension and with the tangential force shortened to the friction limit. own is
                                the mean of a node's three diagonal compliances, softness included */
    int64_t sweeps;          /* out: number of sweeps done */
    int64_t wrong;           /* out: index of the node that was refused */
} dermis_contact;

/* A body in the frame of the skin: its point X is at x = rotation X + translation. */
typedef struct {
    const dermis_body *body; /* checked by `dermis_body_fit`; null: the body is the half-space below a plane */
    double plane[4];         /* unit normal of the plane, and its coordinate along the normal [m] */
    double radius, rounding; /* the plane is a disc about the foot of the body's origin: radii of its flat face and of
                                its rounded rim [m]; rounding 0: the plane is infinite */
    double rotation[9];      /* rotation matrix, row by row */
    double translation[3];   /* [m] */
    double friction;         /* friction coefficient */
    double softness;         /* compliance of the body's own surface [m/Pa] */
    double side;             /* factor on gap and normal: 1, or -1 if the finger is behind the faces of an open sheet */
    double sharpness;        /* share of the largest lift at which points look, see touch.c: largest of its parts */
    const double *shares;    /* the same of each connected part (parts); null: it is the same for all */
    const int64_t *part;     /* connected part of each triangle (total) */
    double tie, turn;        /* faces of two bodies coincide for a point if its gaps to them differ by less than `tie` [m] and
                                their normals turn by less than `turn` [rad] */
    int64_t index;           /* of the body among all bodies */
} dermis_posed;

/* Points of smooth skin, the bodies near them, and contact between both; see `touch.c`.

   The arrays of the points lie one after the other in three blocks, so that a call passes few addresses. The kernel finds
   their places. */
typedef struct {
    int64_t count;           /* number of points */
    int64_t avx2;            /* 1: use AVX2 */
    int64_t looked;          /* 1: `found` and `room` are those of a look before, with the same points and bodies */
    int64_t thorough;        /* 1: all points look from all places, and are visited; this takes longer */
    int64_t stride;          /* numbers from the start of one row of the compliance to the start of the next */
    const float *compliance; /* C (3 count, stride) [m/N]; null: only look */
    int64_t bodies;          /* number of bodies */
    const dermis_posed *posed; /* (bodies) */
    double limit;            /* bodies farther away than this are not found [m] */
    const double *points;    /* undeformed points (count, 3) [m] */
    const double *inward;    /* unit vectors into the finger (count, 3) */
    const double *spread;    /* offsets along both sides at which a point looks (count, 2, 3) [m] */
    double lift;             /* lift of the first look [m] */
    double ratio;            /* lift of the second look over that of the first */
    const double *offset;    /* offset b of the contact problem by the gaps of the look (count, 3) [m]; null: only look */
    const double *shift;     /* displacement that no force causes (count, 3) [m]; null: 0 */
    const double *areas;     /* of the cells (count) [m^2] */
    double tolerance;        /* largest residual */
    int64_t most;            /* largest number of sweeps */
    double *found;           /* block of `where` to `triangle` (DERMIS_FOUND, count) */
    double *out;             /* block of `force` to `status`, as many numbers as they take; null: only look */
    double *room;            /* workspace (DERMIS_TOUCH_ROOM + 4.5 count, count) */
    double *where;           /* displacement at which each point looked last; in: where to look first (count, 3) [m] */
    double *normal;          /* out: normal there (count, 3) */
    double *clearance;       /* out: gap there (count) [m] */
    double *gap;             /* out: the same of undeformed skin, linearised about there (count) [m] */
    double *friction;        /* out: friction coefficient of the body, 0 without (count) */
    double *softness;        /* out: compliance of the surface of the body, 0 without (count) [m/Pa] */
    int64_t *owner;          /* out: `index` of the body, -1 without (count) */
    int64_t *triangle;       /* out: triangle, -1 without (count) */
    double *force;           /* in: start; out: forces (count, 3) [N] */
    double *image;           /* out: C f (count, 3) [m] */
    double *moved;           /* out: relative displacement (count, 3) [m] */
    int8_t *status;          /* out (count) */
    double *drag;            /* in the workspace: slip without displacement (count, 3) [m] */
    int64_t *body;           /* in the workspace: place of the body in `posed` (count) */
    int64_t *slots;          /* in the workspace: hints (count, 10) */
    double residual;         /* out */
    int64_t sweeps;          /* out */
    int64_t looks;           /* out: looks beside the first */
} dermis_touch;

/* The cells of a pad at rest, the bodies near it, and the search for cells that may touch; see `survey.c`.

   Cells are the tiles of core/skin/tiles.py. */
typedef struct {
    int64_t bodies;              /* number of bodies */
    const dermis_posed *posed;   /* (bodies) */
    double limit;                /* bodies farther away than this are not found [m] */
    int64_t roots, levels;       /* number of roots, which are the cells of level 0 and come first; number of levels */
    const int64_t *first;        /* first cell with given numbers of halvings of its two sides, -1 if none (levels,
                                    levels) */
    const int64_t *ways;         /* direction in which a cell can be divided in place of the wanted one, by the numbers
                                    of halvings of its two sides and the wanted direction; 0 if none (levels, levels,
                                    4) */
    const int64_t *root;         /* root that contains each cell (cells) */
    const int64_t *halved;       /* number of halvings of each side (cells, 2) */
    const int64_t *place;        /* position in the root, in cells of the same size (cells, 2) */
    const double *positions, *normals; /* centres [m] and outward unit normals (cells, 3) */
    const double *sides;         /* side vectors (cells, 2, 3) [m] */
    const double *limits;        /* a cell may touch if its gap is below this (cells) [m] */
    const double *longs;         /* longer side (cells) [m] */
    double turned, edge, bent, corners, beyond, beside, odd, above, deep, steep; /* see point_tree.py */
    double drag[3];              /* mean displacement of the skin that carries force [m]; 0 if it does not matter */
    double round;                /* sharpness of bodies without edges */
    int64_t coarsest, many;      /* see point_tree.py */
    int64_t thorough;            /* 1: test points are evaluated even if one flat face is all that is near; the
                                    resulting cells are the same */
    int64_t most;                /* capacity of `leaves` and `clearance`; 4 per root are enough if `coarsest` is at most 1 */
    int64_t finest;              /* largest number of times that a side may be halved; out: what was possible */
    int64_t found;               /* out: number of cells that may touch */
    int64_t *leaves;             /* out: cells that may touch (found) */
    double *clearance;           /* out: gaps of these cells (found) [m] */
} dermis_survey;

/* The neo-Hookean law on a mesh of tetrahedra.

   Each block has DERMIS_LANES elements. Copies of the last element fill the last block; their volume is 0. */
typedef struct {
    int64_t nodes, elements; /* number of nodes, and of elements without the copies */
    const int32_t *corners; /* nodes of each element (blocks, 4, DERMIS_LANES) */
    const float *slopes;    /* gradients of the shape functions of corners 1 to 3 [1/m] (blocks, 3, 3, DERMIS_LANES) */
    const float *volumes;   /* volume of each element (blocks, DERMIS_LANES) [m^3] */
    const float *around;    /* volume of the elements around each node (nodes) [m^3] */
    double first, shear;    /* Lame's constants lambda and mu [Pa] */
    double least;           /* below this J, ln J is continued by its second-order expansion */
    const float *moved;     /* displacement (nodes, 3) [m] */
    float *room;            /* workspace: 9 floats per element, copies included, and 8 per node */
    float *force;           /* out: forces that hold the displacement (nodes, 3) [N]; null: not computed */
    double *stress;         /* out: Cauchy stress xx, yy, zz, yz, xz, xy (elements, 6) [Pa]; null: not computed */
    int64_t stored;         /* 1: compute the whole of `energy` */
    double energy;          /* out: strain energy [J]; without `stored`, only its sum over the nodes */
    double flattest;        /* out: the least J of the elements */
} dermis_law;

/* Linear tissue: its stiffness matrix in levels, with the inverted Schur complement of each; see
   core/skin/rest_factor.py.

   Each level is padded to a multiple of 8 slots. */
typedef struct {
    int64_t size;           /* length of a vector of forces or displacements */
    int64_t levels;         /* number of levels */
    const int64_t *starts;  /* first slot of each level, and the number of all slots (levels + 1) */
    const int32_t *order;   /* index in a vector for each slot, -1 for padding (slots) */
    int64_t numbers;        /* length of `inverses` */
    const float *inverses;  /* numbers below the diagonal of each level's inverse, see rest.c */
    const float *diagonals; /* diagonals of the inverses (slots) */
    int64_t couplings;      /* number of couplings, which are stiffnesses between a slot and one of the next level */
    const int64_t *rows;    /* first coupling of each slot, and the number of couplings (slots + 1) */
    const int32_t *columns; /* slot of the next level for each coupling (couplings) */
    const float *values;    /* stiffness for each coupling (couplings) */
    const float *force;     /* forces (size) */
    float *moved;           /* out: displacement (size) */
    float *room;            /* workspace (3, slots) */
} dermis_rest;
/* Pieces of skin. */
typedef struct {
    int64_t count;                     /* number of pieces */
    const double *positions, *normals; /* centres [m] and outward unit normals (count, 3) */
    const double *sides;               /* side vectors in the tangent plane (count, 2, 3) [m] */
    const double *areas;               /* (count) [m^2] */
} dermis_patches;

/* The displacement of pieces of skin for unit forces on other pieces, see `half_space.c`. */
typedef struct {
    const dermis_patches *field, *source; /* pieces whose displacement is computed, and pieces that carry forces */
    double poisson;                       /* Poisson's ratio */
    double *out;                          /* displacement for E = 1 (field, 3, source, 3) [1/m] */
} dermis_pieces;

/* A touched skin that is drawn, see `drawn.c`. The nodes are those of the tissue's mesh on its surface. */
typedef struct {
    int64_t nodes, triangles;  /* number of nodes, and of triangles between them */
    const double *points;      /* nodes at rest (nodes, 3) [m] */
    const int32_t *corners;    /* nodes of each triangle (triangles, 3) */
    int64_t drawn, entries;    /* number of drawn vertices, and of entries of the matrix from nodes to these */
    const double *rest;        /* drawn vertices without deformation (drawn, 3) [m] */
    const int32_t *starts;     /* first entry of each drawn vertex, and the number of entries (drawn + 1) */
    const int32_t *columns;    /* node of each entry (entries) */
    const double *weights;     /* value of each entry (entries) */
    int64_t pad;               /* number of nodes that may touch */
    const double *pad_positions, *pad_normals; /* positions [m] and outward unit normals of these (pad, 3) */
    const double *force;       /* forces on these (pad, 3) [N] */
    double normal_force;       /* total normal force [N] */
    const float *table;        /* displacement [m] and stress [Pa] of the nodes for unit forces on the pad and E = 1 Pa
                                  (pad, 3, nodes, 9); null: `moved` and `values` are given */
    double modulus;            /* Young's modulus E [Pa] */
    int64_t quantity;          /* with a table: what `values` become, 0 to 5 the stress xx, yy, zz, yz, xz, xy, 6 the
                                  von Mises stress, 7 the length of the displacement; -1: `values` are given */
    double exaggeration;       /* factor on the displacement */
    double lift;               /* displacement of the bone along Z [m] */
    double *moved;             /* displacement of the nodes (nodes, 3) [m]; out with a table, else in */
    double *values;            /* values at the nodes (nodes); see `quantity` */
    float *sums;               /* workspace (nodes, 9); null without a table */
    double *room;              /* workspace (nodes, 8) */
    double *positions;         /* out: drawn vertices (drawn, 3) [m] */
    double *normals;           /* out: their unit normals (drawn, 3) */
    double *shown;             /* out: their values (drawn) */
    double low, high;          /* out: least and greatest value at the nodes */
    double centre[2];          /* out: centre of pressure in X and Y [m] */
    double shear[2];           /* out: force in X and Y divided by the normal force */
} dermis_drawn;

/* Numbers of a pose: rotation (3, 3); translation (3) [m]; linear map from the body's first scale and shear to the
   present ones (3, 3), and its inverse (3, 3); 1 for a body that is out of reach, else 0; 1 for a body whose anchors are
   on triangles that may change, so that the caller sets them, else 0. */
enum { DERMIS_POSE = 32 };

/* Friction history of a skin's nodes, and the frame that continues it; see `friction.c`. */
typedef struct {
    int64_t count, bodies;   /* number of nodes, and of bodies */
    const double *poses;     /* (bodies, DERMIS_POSE) */
    int64_t *owner;          /* history: body of each anchor, -1 for none (count) */
    double *material;        /* anchors in the bodies' own spaces at their first scale (count, 3) [m] */
    double *normal;          /* normals of the bodies, in their axes (count, 3) */
    double *gap;             /* gaps above the anchors (count) [m] */
    double *slip, *swept;    /* slip in the last frame, and what it would have been had the skin not moved (count, 3) [m] */
    int64_t *triangle;       /* triangles of the anchors (count) */
    int64_t *corners;        /* vertices of these, -1 on rigid bodies (count, 3) */
    uint8_t *sticking;       /* 1 for nodes that stuck (count) */
    double *anchors, *normals; /* positions of the anchors, NaN without, and the normals, on the bodies as they are in the
                                  frame (count, 3) [m] */
    const double *points;    /* undeformed nodes (count, 3) [m] */
    const double *image;     /* positions of the deformed nodes; for `dermis_foresee` their displacement (count, 3) [m] */
    double radius;           /* sticking nodes do not move with a body that moves farther than this [m] */
    const double *force;     /* forces on the nodes (count, 3) [N]; null for `dermis_expect` if the skin does not drift */
    double drift[3], passed[3]; /* movement of the loaded skin, and of what is below it if the skin had not moved [m] */
    double *places;          /* out of `dermis_expect`: expected places (count, 3) [m] */
    const int64_t *below, *faces; /* closest body, -1 for none, and its triangle (count) */
    const double *facing;    /* normals of the gaps (count, 3) */
    const double *gaps;      /* gaps of the undeformed nodes (count) [m] */
    const double *friction;  /* coefficients (count) */
    const double *own, *soft; /* compliance of each node to its own force, and of the body below it (count) [m/N] */
    const uint8_t *loaded;   /* 1 for nodes with a force at the begin of the frame (count) */
    double share;            /* share of the shifts that is applied */
    double *offset;          /* relative displacement without force (count, 3) [m] */
    double *sweeping;        /* out of `dermis_foresee`: `swept` of this frame (count, 3) [m] */
    int64_t shifted, entered; /* nodes whose slip is shifted, and nodes that came into contact */
    int64_t *nodes;          /* the former (shifted) */
    double *shift;           /* shifts of their slip (shifted, 3) [m] */
    const int64_t *entering; /* the latter (entered) */
    const double *crossing;  /* shifts of these (entered, 3) [m] */
    const double *moved;     /* relative displacement of the nodes; for `dermis_drift` their movement (count, 3) [m] */
    const int8_t *status;    /* 0 open, DERMIS_STICK or DERMIS_SLIP (count) */
    double *positions;       /* out of `dermis_keep`: positions on the bodies' surfaces (count, 3) [m] */
    uint8_t *renewed;        /* out: 1 for nodes whose anchors moved there (count) */
    int64_t slides;          /* out: 1 if the frame is not at rest */
} dermis_friction;

/* One frame of contact, and its sums; see `sums.c`. */
typedef struct {
    int64_t count;           /* number of nodes */
    int64_t from_rest;       /* 1: the frame has no history */
    const double *points;    /* undeformed nodes (count, 3) [m] */
    const double *force, *normals; /* forces [N] and contact normals (count, 3) */
    const double *displacement; /* relative displacement of the nodes (count, 3) [m] */
    const double *image;     /* displacement of the nodes (count, 3) [m] */
    const double *gaps;      /* gaps of the undeformed nodes (count) [m]; null: nothing is near */
    const int8_t *status;    /* 0 open, DERMIS_STICK or DERMIS_SLIP (count) */
    double bone[3];          /* a point inside the finger [m] */
    double normal, tangential; /* out: sum of the normal forces, and size of the sum of the tangential ones [N] */
    double depth, slide;     /* out: penetration, and tangential displacement of the loaded skin [m] */
    double resultant[3];     /* out: sum of the forces [N] */
    double size, mean[3];    /* out: sum of the sizes of the forces [N], and mean displacement of the nodes weighted with
                                these sizes, 0 without force [m] */
    int64_t sticking, slipping; /* out: numbers of nodes */
} dermis_sums;

/* A rigid disc that presses on points of the skin, see `disc.c`.

   The candidates are those points that may carry force. The forces f on them and the relative displacements
   w = C f + offset - less obey Coulomb's law with the disc's normal. */
typedef struct {
    int64_t points;          /* number of points */
    const double *positions; /* undeformed points in the finger's frame (points, 3) [m] */
    const double *places;    /* points after the last step (points, 3) [m] */
    const double *anchors;   /* anchors in the disc's plane (points, 2) [m] */
    const uint8_t *anchored; /* 1 if the point has an anchor, else 0 (points) */
    const uint8_t *sticking; /* 1 if the point stuck in the last step, else 0 (points) */
    double radius, rounding; /* radii of the disc's flat face and of its rounded rim [m] */
    double friction;         /* friction coefficient */
    double weight;           /* weight of displacements against forces in the projection [N/m] */
    double margin;           /* all points with gaps below this must be candidates [m] */
    double tolerance;        /* largest residual at which Newton's method stops */
    int64_t most;            /* largest number of Newton steps */
    int64_t freedoms;        /* number n of values in the disc's configuration */
    int64_t turning;         /* number of these, from the first on, that can turn the disc */
    const double *pose;      /* rotation from the disc's frame to the finger's (3, 3), centre (3) [m], rotation vector per
                                unit of each value (n, 3), derivative of the centre (3, n), and the values minus those
                                of `told` (n) */
    int64_t count;           /* number of candidates */
    const int64_t *near;     /* their indices among the points (count) */
    const double *compliance; /* C between candidates, symmetric positive definite (3 count, 3 count) [m/N] */
    const double *less;      /* displacement of linear skin minus that of this skin (points, 3) [m]; null: the skin is
                                linear */
    int64_t leading;         /* n, or 0: `told` has no derivative */
    const double *told;      /* forces to start from, each followed by its derivative (count, 3, 1 + leading) */
    double *room;            /* workspace (60 + 3 n + 18 count, count) */
    int64_t *indices;        /* workspace (8, count) */
    double *gap;             /* out: gap of every undeformed point (points) [m] */
    int64_t strays;          /* out: number of points with gaps below `margin` that are no candidates; if it is not 0,
                                only `gap` is computed */
    int64_t touching;        /* out: 1 if a candidate has a gap below 0, else 0: all forces are then 0 */
    double *answer;          /* out: forces, each followed by its derivative (count, 3, 1 + n) [N] */
    double *moved;           /* out: w (count, 3); without touch, the offset [m] */
    double *offset;          /* out: relative displacement without force and without `less` (count, 3) [m] */
    int8_t *status;          /* out: 0 open, 1 sticking, 2 slipping (count) */
    double residual;         /* out: |f - P(f - weight w)|, divided by the larger of |f| and |P(f - weight w)|, with
                                Coulomb's projection P; infinite if there is no finite result */
    int64_t steps;           /* out: number of Newton steps done */
    int64_t wrong;           /* out: index of the point that was refused */
} dermis_disc;

/* A step of a disc that ended, and the state of friction after it; see `disc.c`. */
typedef struct {
    int64_t points;           /* number of points */
    const double *positions;  /* undeformed points in the finger's frame (points, 3) [m] */
    const double *anchors;    /* anchors before the step, in the disc's plane (points, 2) [m] */
    const uint8_t *anchored;  /* 1 if the point had an anchor, else 0 (points) */
    const double *compliance; /* C between all points, symmetric (3 points, 3 points) [m/N] */
    const double *less;       /* displacement of linear skin minus that of this skin (points, 3) [m]; null: the skin is
                                 linear */
    const double *pose;       /* rotation from the disc's frame to the finger's (3, 3), and centre (3) [m] */
    int64_t count;            /* number of candidates */
    const int64_t *near;      /* their indices among the points (count) */
    int64_t width;            /* numbers from one component of a force to the next */
    const double *answer;     /* forces on the candidates (count, 3, width) [N] */
    const int8_t *status;     /* 0 open, 1 sticking, 2 slipping (count) */
    double *moved;            /* out: displacement of the points (points, 3) [m] */
    double *force;            /* out: forces on the points (points, 3) [N] */
    double *anchor;           /* out: anchors (points, 2) [m] */
    uint8_t *sticks;          /* out: 1 if the point sticks, else 0 (points) */
    int64_t wrong;            /* out: index of the point that was refused */
} dermis_settled;

/* A thimble: a disc on three legs, see core/devices/linkage.py and thimble.py. */
typedef struct {
    double platform_radius, base_radius, crank, rod; /* [m] */
    double servo_zero;       /* angle of a servo at neutral [rad] */
    double bend, side;       /* 1 or -1, see core/devices/linkage.py */
    double least;            /* least singularity margin */
    double mount[12];        /* pose of the base in the finger's frame: rotation (3, 3), origin (3) [m] */
} dermis_thimble;

/* Why a search ended. OUTSIDE: it did not begin, since its start is outside the limits. See
   core/matching/minimum.py for all others. */
enum {
    DERMIS_LIMIT = 0,
    DERMIS_OPTIMAL = 1,
    DERMIS_GAIN = 2,
    DERMIS_FORESEEN = 3,
    DERMIS_STALLED = 4,
    DERMIS_STEP = 5,
    DERMIS_EXACT = 6,
    DERMIS_OUTSIDE = 7
};

/* A search for the pose of a thimble's disc whose stimulus is nearest to a target, see `search.c`.

   A configuration has three values: pitch, roll [rad] and distance [m]. `values` are a stimulus, and its derivative
   with respect to each value of the configuration. */
typedef struct {
    const dermis_thimble *thimble;
    dermis_disc *disc;       /* contact that gives the stimulus, see `dermis_press_disc`; null: the caller gives it */
    int64_t size;            /* number k of components of a stimulus */
    const double *observation; /* stimulus for unit forces on the points of the disc's contact (points, 3, k) */
    double optimal, small_step, exact, small_gain, hardly, later, least_reach, nearly, shortest, longest, armijo, damping;
                             /* see core/matching/minimum.py */
    int64_t most_steps, most_evaluations;
    const double *target;    /* (k) */
    double low[3], high[3];  /* least and greatest angles of the servos from neutral [rad] */
    const double *before;    /* target of an earlier search that ended at `x` (k); null: there was none */
    const double *slope;     /* derivative of the stimulus there (3, k) */
    int64_t follows;         /* 1: another search will start from the result */
    double foreseen;         /* a step that promises a smaller share of the cost is taken without an evaluation */
    double on_limit;         /* a start may be beyond a limit by this much [rad] */
    int64_t bounded;         /* in: 1 to minimise within the linearised limits from the first step on; out: 1 if a limit
                                was met */
    int64_t phase;           /* 0 at the first call; the search itself goes on to 1 and 2 */
    int64_t held;            /* out: 1 if `answer`, `moved`, `status` and `pose` are those of `disc` at `at` */
    int64_t own;             /* out: 1 if `at` is also `x` */
    double x[3];             /* in: start, or where an earlier search ended; out: result */
    double at[3];            /* configuration to which `told` of the disc belongs; out: at which it last touched */
    double trial[3];         /* out, when asked: the configuration whose `trial_values` the caller has to compute */
    double *values;          /* out: at `x` (4, k) */
    double *trial_values;    /* in, when asked: at `trial` (4, k) */
    double *answer, *moved;  /* out: as in `dermis_disc` */
    int8_t *status;          /* out: as in `dermis_disc` */
    double pose[33];         /* out: as in `dermis_disc` */
    double room[7];          /* out: distance from each limit at `x`, see core/devices/thimble.py */
    double trial_room[7];
    double slopes[21];       /* out of a bounded search: derivatives of `room` with respect to pitch, roll, and distance over
                                the platform's radius (7, 3) */
    double trial_slopes[21];
    int64_t actives;         /* out: number of limits that hold the search back */
    int64_t active[3];       /* out: indices of these */
    double multipliers[3];   /* out: their multipliers */
    double angles[3];        /* out: of the servos at `x`, from neutral [rad] */
    double trial_angles[3];
    double reach;            /* share of a full step that minimises the cost, as the last step tells; in: of an earlier search */
    double start_cost, cost, kkt; /* out, see core/matching/minimum.py */
    int64_t iterations, evaluations; /* out: numbers of steps and of evaluations */
    int64_t why;             /* out: why the search ended */
    double gram[16], way[3], length, descent, share, goal; /* of the step that is tried */
} dermis_search;

/* Rows of the compliance between cells of a pad, see `half_space.c`. */
typedef struct {
    const dermis_patches *cells;  /* all cells of the pad */
    int64_t rows, columns;        /* number of cells whose displacement is computed, and of cells that carry forces */
    const int64_t *field;         /* the former (rows) */
    const int64_t *source;        /* the latter (columns) */
    double poisson;               /* Poisson's ratio */
    const float *smooth;          /* compliance for E = 1 minus that of a half-space; the components are those of the
                                     displacement and of the force (rows, 3, 3, columns) [1/m] */
    double factor;                /* 1 / E [1/Pa] */
    double spring[9];             /* compliance of the bone's support (3, 3) [m/N] */
    int64_t avx2;                 /* 1: use AVX2 */
    int64_t stride;               /* numbers from the start of one row of `out` to the start of the next */
    float *out;                   /* compliance (rows, 3, stride) [m/N] */
    int64_t mirrored;             /* number of columns whose compliance is written to `mirror` as well */
    float *mirror;                /* their compliance with rows and columns exchanged (mirrored, 3, stride) [m/N] */
} dermis_cells;

/* Points that take the places of others in the compliance between points, see `points.c`. */
typedef struct {
    int64_t count, moved;    /* number of points afterwards, and of those that move */
    const int64_t *places;   /* new indices of those that move, ascending and below `count` (moved) */
    const int64_t *former;   /* their former indices, from `count` on (moved) */
    const float *given;      /* compliance before, of all former points (former points, 3, width) [m/N] */
    int64_t width;           /* numbers from the start of one of its rows to the start of the next */
    float *out;              /* compliance afterwards, which may be the same array (count, 3, stride) [m/N] */
    int64_t stride;          /* numbers from the start of one of its rows to the start of the next */
} dermis_moves;

/* Cells that replace removed ones, with the forces that they inherit; see `points.c`. */
typedef struct {
    int64_t tiles, levels;   /* number of cells of the pad, and of levels */
    const int64_t *root;     /* root that contains each cell (tiles) */
    const int64_t *halved;   /* number of halvings of each side (tiles, 2) */
    const int64_t *place;    /* position in the root, in cells of the same size (tiles, 2) */
    int64_t leaving, entering, former; /* number of removed cells, of added cells, and of former points */
    const int64_t *left;     /* removed cells (leaving) */
    const int64_t *sources;  /* indices of their points (leaving) */
    const int64_t *entered;  /* added cells (entering) */
    const double *force;     /* forces on the former points (former, 3) [N] */
    double *inherited;       /* out: forces on the added cells (entering, 3) [N] */
    int64_t *main;           /* out: former point of largest load that each added cell replaces, -1 for none (entering) */
    double *load;            /* out: square of its force (entering) [N^2] */
} dermis_heirs;

/* State of points that changes its order, as arrays one after the other; see `points.c`. */
typedef struct {
    int64_t count, before;   /* number of points afterwards and before */
    int64_t arrays;          /* number of arrays */
    const int64_t *widths;   /* bytes of a point in each array (arrays) */
    const int64_t *blank;    /* byte that fills the state of a point without a former one (arrays) */
    const int64_t *former;   /* former index of each point, -1 for none (count) */
    const uint8_t *given;    /* arrays before (before, widths) */
    uint8_t *out;            /* out: arrays afterwards (count, widths) */
} dermis_states;

/* Nodes that come into contact in a frame, see `friction.c`. */
typedef struct {
    int64_t count;           /* number of nodes */
    const int8_t *status;    /* in the solution: 0 open, DERMIS_STICK or DERMIS_SLIP (count) */
    const uint8_t *loaded;   /* 1 for nodes with a force at the begin of the frame (count) */
    const int64_t *owner, *below; /* body below each node in the last frame and in this one, -1 for none (count) */
    const double *friction;  /* coefficients (count) */
    const double *normals;   /* of the gaps (count, 3) */
    const double *moved;     /* relative displacement in the solution (count, 3) [m] */
    const double *force;     /* (count, 3) [N] */
    const double *gap;       /* gap in the last frame (count) [m] */
    const double *soft;      /* compliance of the body below (count) [m/N] */
    const float *compliance; /* between nodes (count, 3, stride) [m/N] */
    int64_t stride;          /* numbers from the start of one of its rows to the start of the next */
    int64_t *entering;       /* out: nodes that come into contact (entered) */
    double *crossing;        /* out: shifts of their slip (entered, 3) [m] */
    int64_t entered;         /* out: number of these nodes */
} dermis_arrivals;

/* Sort the triangles of a tree, `order`, into slots, so that neighbours share leaves. */
DERMIS_API int32_t dermis_tree_split(dermis_tree *tree);

/* Compute `packed`, `boxes` and the numbers about them of a tree whose triangles are sorted. */
DERMIS_API int32_t dermis_tree_fit(dermis_tree *tree);

/* Check the indices of a body, and compute `normals` unless it is null. */
DERMIS_API int32_t dermis_body_fit(dermis_body *body);

/* Compute `facing` and `bulge` of `convex` of a body that `dermis_body_fit` has checked, from `beside`. */
DERMIS_API int32_t dermis_body_bulge(dermis_body *body);

/* Set `by_rays` of a closed body that `dermis_body_fit` has checked.

   It becomes 1 if triangles intersect each other or lie back to back, or if a part is inside the solid of another
   part. */
DERMIS_API int32_t dermis_body_judge(dermis_body *body);

/* Measure the signed distances of points to a body that `dermis_body_fit` has checked. */
DERMIS_API int32_t dermis_distances(dermis_query *query);

/* Look at bodies, or compute the contact forces of points of smooth skin. */
DERMIS_API int32_t dermis_touch_points(dermis_touch *touch);

/* Compute the contact forces from an initial guess. */
DERMIS_API int32_t dermis_sweep(dermis_contact *contact);

/* Find the cells of a pad that may touch. */
DERMIS_API int32_t dermis_find_cells(dermis_survey *survey);

/* Evaluate the neo-Hookean law at a displacement. */
DERMIS_API int32_t dermis_evaluate_law(dermis_law *law);

/* Compute the displacement of linear tissue under forces. */
DERMIS_API int32_t dermis_rest_solve(dermis_rest *rest);

/* Compute the displacement of pieces of skin for unit forces on other pieces. */
DERMIS_API int32_t dermis_press_pieces(dermis_pieces *pieces);

/* Compute the drawing of a touched skin. */
DERMIS_API int32_t dermis_draw_skin(dermis_drawn *drawn);

/* Compute the anchors in a frame, and the places where the nodes are expected. */
DERMIS_API int32_t dermis_expect(dermis_friction *friction);

/* Compute the relative displacement without force, from the anchors and the gaps. */
DERMIS_API int32_t dermis_offset(dermis_friction *friction);

/* Shift the slip of nodes whose slip is expected to change its direction. */
DERMIS_API int32_t dermis_foresee(dermis_friction *friction);

/* Update the history to the end of a frame. */
DERMIS_API int32_t dermis_keep(dermis_friction *friction);

/* Compute the drift of the skin in a frame. */
DERMIS_API int32_t dermis_drift(dermis_friction *friction);

/* Sum up a frame of contact. */
DERMIS_API int32_t dermis_sum(dermis_sums *sums);

/* Press a disc on the skin at one pose. */
DERMIS_API int32_t dermis_press_disc(dermis_disc *disc);

/* Renew the state of friction after a step of a disc: a sticking point keeps its anchor, any other point gets a new one
   at its own place. */
DERMIS_API int32_t dermis_settle_disc(dermis_settled *step);

/* Search for a pose, until the search ends or the caller has to compute a stimulus. */
DERMIS_API int32_t dermis_descend(dermis_search *search);

/* Compute rows of the compliance between cells of a pad. */
DERMIS_API int32_t dermis_compliance_rows(dermis_cells *cells);

/* Move points in the compliance between points. */
DERMIS_API int32_t dermis_move_points(dermis_moves *moves);

/* Distribute the forces of removed cells to those that replace them. */
DERMIS_API int32_t dermis_succeed(dermis_heirs *heirs);

/* Copy the state of points in another order. */
DERMIS_API int32_t dermis_rearrange(dermis_states *states);

/* Shift the slip of nodes that came into contact. */
DERMIS_API int32_t dermis_arrive(dermis_arrivals *arrivals);

/* Return 1 if this processor and its operating system support AVX2, else 0. */
DERMIS_API int32_t dermis_has_avx2(void);

/* Return the digest of the constants and of the records' layouts. */
DERMIS_API const char *dermis_layout(void);

/* Return the digest of the sources and flags from which the library was built. */
DERMIS_API const char *dermis_sources(void);

#endif
