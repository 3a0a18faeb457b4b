/* Layout and digest, which the loader compares, and functions that replace those of a C library. */
#include "kernels.h"

#ifndef DERMIS_SOURCES
#error "building.py gives the digest of the sources"
#endif

#define TREE(FIELD)                                                                                          \
    FIELD(dermis_tree, total) FIELD(dermis_tree, count) FIELD(dermis_tree, depth) FIELD(dermis_tree, rows)   \
    FIELD(dermis_tree, bounds) FIELD(dermis_tree, slivers) FIELD(dermis_tree, order)                         \
    FIELD(dermis_tree, packed) FIELD(dermis_tree, boxes) FIELD(dermis_tree, middle) FIELD(dermis_tree, scale) \
    FIELD(dermis_tree, largest) FIELD(dermis_tree, wrong)
#define BODY(FIELD)                                                                                          \
    FIELD(dermis_body, next) FIELD(dermis_body, tree) FIELD(dermis_body, all) FIELD(dermis_body, vertices)   \
    FIELD(dermis_body, closed) FIELD(dermis_body, by_rays) FIELD(dermis_body, outside) FIELD(dermis_body, parts)                        \
    FIELD(dermis_body, slabs) FIELD(dermis_body, weld) FIELD(dermis_body, corners)                           \
    FIELD(dermis_body, across)                                                                               \
    FIELD(dermis_body, edge_kind) FIELD(dermis_body, vertex_kind) FIELD(dermis_body, part)                   \
    FIELD(dermis_body, slab) FIELD(dermis_body, normals)
#define QUERY(FIELD)                                                                                         \
    FIELD(dermis_query, body) FIELD(dermis_query, count) FIELD(dermis_query, limit)                          \
    FIELD(dermis_query, points) FIELD(dermis_query, gap) FIELD(dermis_query, normal)                         \
    FIELD(dermis_query, closest) FIELD(dermis_query, weights) FIELD(dermis_query, triangle)                  \
    FIELD(dermis_query, feature) FIELD(dermis_query, beside) FIELD(dermis_query, wrong)
#define CONTACT(FIELD)                                                                                       \
    FIELD(dermis_contact, count) FIELD(dermis_contact, single) FIELD(dermis_contact, stride) FIELD(dermis_contact, avx2)                 \
    FIELD(dermis_contact, compliance) FIELD(dermis_contact, offset) FIELD(dermis_contact, normals)           \
    FIELD(dermis_contact, friction) FIELD(dermis_contact, softness) FIELD(dermis_contact, tolerance)         \
    FIELD(dermis_contact, most) FIELD(dermis_contact, force) FIELD(dermis_contact, image)                    \
    FIELD(dermis_contact, moved) FIELD(dermis_contact, status) \
    FIELD(dermis_contact, given) FIELD(dermis_contact, nodes) FIELD(dermis_contact, room)                    \
    FIELD(dermis_contact, residual) FIELD(dermis_contact, sweeps) FIELD(dermis_contact, missed) \
    FIELD(dermis_contact, wrong)
#define POSED(FIELD) \
    FIELD(dermis_posed, body) FIELD(dermis_posed, plane) FIELD(dermis_posed, rotation) \
    FIELD(dermis_posed, translation) FIELD(dermis_posed, friction) FIELD(dermis_posed, softness) \
    FIELD(dermis_posed, side)
#define SURVEY(FIELD) \
    FIELD(dermis_survey, bodies) FIELD(dermis_survey, posed) FIELD(dermis_survey, limit) \
    FIELD(dermis_survey, roots) FIELD(dermis_survey, levels) FIELD(dermis_survey, squares) \
    FIELD(dermis_survey, first) FIELD(dermis_survey, ways) FIELD(dermis_survey, root) \
    FIELD(dermis_survey, halved) FIELD(dermis_survey, place) FIELD(dermis_survey, quarters) \
    FIELD(dermis_survey, positions) FIELD(dermis_survey, normals) FIELD(dermis_survey, sides) \
    FIELD(dermis_survey, limits) FIELD(dermis_survey, longs) FIELD(dermis_survey, ways_before) \
    FIELD(dermis_survey, points) FIELD(dermis_survey, owner) FIELD(dermis_survey, in_root) \
    FIELD(dermis_survey, raised) FIELD(dermis_survey, loaded) FIELD(dermis_survey, load) \
    FIELD(dermis_survey, rows) FIELD(dermis_survey, filled) FIELD(dermis_survey, table) FIELD(dermis_survey, common) FIELD(dermis_survey, turned) \
    FIELD(dermis_survey, edge) FIELD(dermis_survey, sharp) FIELD(dermis_survey, bent) FIELD(dermis_survey, corners) \
    FIELD(dermis_survey, beyond) FIELD(dermis_survey, beside) FIELD(dermis_survey, merge) FIELD(dermis_survey, odd) \
    FIELD(dermis_survey, level) FIELD(dermis_survey, deep) FIELD(dermis_survey, steep) \
    FIELD(dermis_survey, often) FIELD(dermis_survey, coarsest) FIELD(dermis_survey, many) FIELD(dermis_survey, thorough) \
    FIELD(dermis_survey, most) FIELD(dermis_survey, room) FIELD(dermis_survey, afar) FIELD(dermis_survey, finest) \
    FIELD(dermis_survey, found) FIELD(dermis_survey, cut) FIELD(dermis_survey, edges) FIELD(dermis_survey, leaves) \
    FIELD(dermis_survey, clearance) FIELD(dermis_survey, cuts) FIELD(dermis_survey, cut_ways)
#define LAW(FIELD) \
    FIELD(dermis_law, nodes) FIELD(dermis_law, elements) FIELD(dermis_law, corners) FIELD(dermis_law, slopes) \
    FIELD(dermis_law, volumes) FIELD(dermis_law, around) FIELD(dermis_law, first) FIELD(dermis_law, shear) \
    FIELD(dermis_law, least) FIELD(dermis_law, moved) FIELD(dermis_law, room) FIELD(dermis_law, force) \
    FIELD(dermis_law, stress) FIELD(dermis_law, stored) FIELD(dermis_law, energy) FIELD(dermis_law, flattest)
#define REST(FIELD) \
    FIELD(dermis_rest, size) FIELD(dermis_rest, levels) FIELD(dermis_rest, starts) FIELD(dermis_rest, order) \
    FIELD(dermis_rest, numbers) FIELD(dermis_rest, inverses) FIELD(dermis_rest, diagonals) \
    FIELD(dermis_rest, couplings) FIELD(dermis_rest, rows) FIELD(dermis_rest, columns) FIELD(dermis_rest, values) \
    FIELD(dermis_rest, force) FIELD(dermis_rest, moved) FIELD(dermis_rest, room)
#define PATCHES(FIELD) \
    FIELD(dermis_patches, count) FIELD(dermis_patches, positions) FIELD(dermis_patches, normals) \
    FIELD(dermis_patches, sides) FIELD(dermis_patches, areas)
#define PIECES(FIELD) \
    FIELD(dermis_pieces, field) FIELD(dermis_pieces, source) FIELD(dermis_pieces, poisson) \
    FIELD(dermis_pieces, single) FIELD(dermis_pieces, out)
#define POINTS(FIELD) \
    FIELD(dermis_points, known) FIELD(dermis_points, side) FIELD(dermis_points, root) FIELD(dermis_points, halved) \
    FIELD(dermis_points, place) FIELD(dermis_points, around) FIELD(dermis_points, before) \
    FIELD(dermis_points, old_cells) FIELD(dermis_points, count) FIELD(dermis_points, cells) \
    FIELD(dermis_points, owner) FIELD(dermis_points, in_root) FIELD(dermis_points, number) FIELD(dermis_points, beside)
#define DRAWN(FIELD) \
    FIELD(dermis_drawn, nodes) FIELD(dermis_drawn, triangles) FIELD(dermis_drawn, points) \
    FIELD(dermis_drawn, corners) FIELD(dermis_drawn, drawn) FIELD(dermis_drawn, entries) \
    FIELD(dermis_drawn, rest) FIELD(dermis_drawn, starts) FIELD(dermis_drawn, columns) \
    FIELD(dermis_drawn, weights) FIELD(dermis_drawn, pad) FIELD(dermis_drawn, pad_positions) \
    FIELD(dermis_drawn, pad_normals) FIELD(dermis_drawn, force) FIELD(dermis_drawn, normal_force) \
    FIELD(dermis_drawn, table) FIELD(dermis_drawn, modulus) FIELD(dermis_drawn, quantity) \
    FIELD(dermis_drawn, exaggeration) FIELD(dermis_drawn, lift) FIELD(dermis_drawn, moved) \
    FIELD(dermis_drawn, values) FIELD(dermis_drawn, sums) FIELD(dermis_drawn, room) \
    FIELD(dermis_drawn, positions) FIELD(dermis_drawn, normals) FIELD(dermis_drawn, shown) \
    FIELD(dermis_drawn, low) FIELD(dermis_drawn, high) FIELD(dermis_drawn, centre) \
    FIELD(dermis_drawn, shear)
#define GAPS(FIELD) \
    FIELD(dermis_gaps, body) FIELD(dermis_gaps, pose) FIELD(dermis_gaps, box) FIELD(dermis_gaps, count) \
    FIELD(dermis_gaps, index) FIELD(dermis_gaps, radius) FIELD(dermis_gaps, side) \
    FIELD(dermis_gaps, friction) FIELD(dermis_gaps, softness) FIELD(dermis_gaps, points) \
    FIELD(dermis_gaps, places) FIELD(dermis_gaps, came) FIELD(dermis_gaps, before) \
    FIELD(dermis_gaps, told) FIELD(dermis_gaps, which) FIELD(dermis_gaps, met) FIELD(dermis_gaps, turned) \
    FIELD(dermis_gaps, wrong)
#define FRICTION(FIELD) \
    FIELD(dermis_friction, count) FIELD(dermis_friction, bodies) FIELD(dermis_friction, poses) \
    FIELD(dermis_friction, owner) FIELD(dermis_friction, material) FIELD(dermis_friction, normal) \
    FIELD(dermis_friction, gap) FIELD(dermis_friction, slip) FIELD(dermis_friction, swept) \
    FIELD(dermis_friction, triangle) FIELD(dermis_friction, corners) FIELD(dermis_friction, sticking) \
    FIELD(dermis_friction, anchors) FIELD(dermis_friction, normals) FIELD(dermis_friction, points) \
    FIELD(dermis_friction, image) FIELD(dermis_friction, radius) FIELD(dermis_friction, force) \
    FIELD(dermis_friction, drift) FIELD(dermis_friction, passed) FIELD(dermis_friction, places) \
    FIELD(dermis_friction, origins) FIELD(dermis_friction, below) FIELD(dermis_friction, faces) \
    FIELD(dermis_friction, facing) FIELD(dermis_friction, gaps) FIELD(dermis_friction, friction) \
    FIELD(dermis_friction, own) FIELD(dermis_friction, soft) FIELD(dermis_friction, loaded) \
    FIELD(dermis_friction, share) FIELD(dermis_friction, offset) FIELD(dermis_friction, sweeping) \
    FIELD(dermis_friction, shifted) FIELD(dermis_friction, entered) FIELD(dermis_friction, nodes) \
    FIELD(dermis_friction, shift) FIELD(dermis_friction, entering) FIELD(dermis_friction, crossing) \
    FIELD(dermis_friction, moved) FIELD(dermis_friction, status) FIELD(dermis_friction, positions) \
    FIELD(dermis_friction, renewed) FIELD(dermis_friction, slides)
#define SUMS(FIELD) \
    FIELD(dermis_sums, count) FIELD(dermis_sums, from_rest) FIELD(dermis_sums, points) FIELD(dermis_sums, force) \
    FIELD(dermis_sums, normals) FIELD(dermis_sums, displacement) FIELD(dermis_sums, image) \
    FIELD(dermis_sums, gaps) FIELD(dermis_sums, status) FIELD(dermis_sums, bone) FIELD(dermis_sums, normal) \
    FIELD(dermis_sums, tangential) FIELD(dermis_sums, depth) FIELD(dermis_sums, slide) \
    FIELD(dermis_sums, sticking) FIELD(dermis_sums, slipping)
#define DISC(FIELD) \
    FIELD(dermis_disc, points) FIELD(dermis_disc, positions) FIELD(dermis_disc, places) \
    FIELD(dermis_disc, anchors) FIELD(dermis_disc, anchored) FIELD(dermis_disc, sticking) \
    FIELD(dermis_disc, radius) FIELD(dermis_disc, rounding) FIELD(dermis_disc, friction) \
    FIELD(dermis_disc, weight) FIELD(dermis_disc, margin) FIELD(dermis_disc, tolerance) \
    FIELD(dermis_disc, most) FIELD(dermis_disc, freedoms) FIELD(dermis_disc, turning) \
    FIELD(dermis_disc, pose) FIELD(dermis_disc, count) FIELD(dermis_disc, near) FIELD(dermis_disc, compliance) \
    FIELD(dermis_disc, less) FIELD(dermis_disc, leading) FIELD(dermis_disc, told) FIELD(dermis_disc, room) \
    FIELD(dermis_disc, indices) FIELD(dermis_disc, gap) FIELD(dermis_disc, strays) FIELD(dermis_disc, touching) \
    FIELD(dermis_disc, answer) FIELD(dermis_disc, moved) FIELD(dermis_disc, offset) FIELD(dermis_disc, status) \
    FIELD(dermis_disc, residual) FIELD(dermis_disc, steps) FIELD(dermis_disc, wrong)
#define SETTLED(FIELD) \
    FIELD(dermis_settled, points) FIELD(dermis_settled, positions) FIELD(dermis_settled, anchors) \
    FIELD(dermis_settled, anchored) FIELD(dermis_settled, compliance) FIELD(dermis_settled, less) \
    FIELD(dermis_settled, pose) FIELD(dermis_settled, count) FIELD(dermis_settled, near) \
    FIELD(dermis_settled, width) FIELD(dermis_settled, answer) FIELD(dermis_settled, status) \
    FIELD(dermis_settled, moved) FIELD(dermis_settled, force) FIELD(dermis_settled, anchor) \
    FIELD(dermis_settled, sticks) FIELD(dermis_settled, wrong)
#define OFFSET(record, field) offsetof(record, field),
#define NAME(record, field) " " #field

DERMIS_API const uint64_t *dermis_layout(void) {
    static const uint64_t layout[] = {
        DERMIS_ABI,           DERMIS_ROW,    DERMIS_LANES,           DERMIS_BOXES,    DERMIS_KEPT,
        sizeof(dermis_tree),  TREE(OFFSET)   sizeof(dermis_body),    BODY(OFFSET)
        sizeof(dermis_query), QUERY(OFFSET)  sizeof(dermis_contact), CONTACT(OFFSET) sizeof(dermis_posed), POSED(OFFSET) sizeof(dermis_survey), SURVEY(OFFSET)
        sizeof(dermis_law),   LAW(OFFSET)    sizeof(dermis_rest),    REST(OFFSET)
        sizeof(dermis_patches), PATCHES(OFFSET) sizeof(dermis_pieces), PIECES(OFFSET) sizeof(dermis_points), POINTS(OFFSET)
        sizeof(dermis_drawn), DRAWN(OFFSET)
        sizeof(dermis_gaps), GAPS(OFFSET) sizeof(dermis_friction), FRICTION(OFFSET) sizeof(dermis_sums), SUMS(OFFSET)
        sizeof(dermis_disc),  DISC(OFFSET)   sizeof(dermis_settled), SETTLED(OFFSET)
        UINT64_MAX,
    };
    return layout;
}

DERMIS_API const char *dermis_fields(void) {
    return "tree" TREE(NAME) " body" BODY(NAME) " query" QUERY(NAME) " contact" CONTACT(NAME) " posed" POSED(NAME)
           " survey" SURVEY(NAME) " law" LAW(NAME) " rest" REST(NAME) " patches" PATCHES(NAME) " pieces" PIECES(NAME)
           " points" POINTS(NAME) " drawn" DRAWN(NAME) " gaps" GAPS(NAME) " friction" FRICTION(NAME) " sums" SUMS(NAME)
           " disc" DISC(NAME) " settled" SETTLED(NAME);
}

#if defined(__x86_64__)
/* Query the processor with the instruction cpuid; `told` becomes the registers a, b, c and d (4). */
static void ask(uint32_t leaf, uint32_t *told) {
    __asm__ volatile("cpuid" : "=a"(told[0]), "=b"(told[1]), "=c"(told[2]), "=d"(told[3]) : "a"(leaf), "c"(0));
}

DERMIS_API int32_t dermis_has_avx2(void) {
    uint32_t told[4], low, high;
    ask(0, told);
    if (told[0] < 7) return 0;
    ask(1, told);
    if ((told[2] >> 27 & 3) != 3) return 0; /* the system saves wide registers, and the processor has AVX */
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    if ((low & 6) != 6) return 0;
    ask(7, told);
    return told[1] >> 5 & 1;
}
#else
DERMIS_API int32_t dermis_has_avx2(void) { return 0; }
#endif

DERMIS_API const char *dermis_sources(void) { return DERMIS_SOURCES; }

#if defined(DERMIS_ALONE)
/* Compilers may insert calls of these functions to copy or clear records, and the library has no C library that
   provides them. */
void *memcpy(void *to, const void *from, size_t count);
void *memset(void *to, int value, size_t count);

void *memcpy(void *to, const void *from, size_t count) {
    volatile unsigned char *target = to;
    const unsigned char *source = from;
    while (count--) *target++ = *source++;
    return to;
}

void *memset(void *to, int value, size_t count) {
    volatile unsigned char *target = to;
    while (count--) *target++ = (unsigned char)value;
    return to;
}

#if defined(_WIN32)
int __stdcall DllMainCRTStartup(void *module, unsigned long reason, void *reserved);

int __stdcall DllMainCRTStartup(void *module, unsigned long reason, void *reserved) {
    (void)module, (void)reason, (void)reserved;
    return 1;
}
#endif
#endif
