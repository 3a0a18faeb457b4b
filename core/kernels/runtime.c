/* Layout and digest, which the loader compares, and the functions that replace a C library. */
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
    FIELD(dermis_contact, count) FIELD(dermis_contact, single) FIELD(dermis_contact, stride)                 \
    FIELD(dermis_contact, compliance) FIELD(dermis_contact, offset) FIELD(dermis_contact, normals)           \
    FIELD(dermis_contact, friction) FIELD(dermis_contact, softness) FIELD(dermis_contact, tolerance)         \
    FIELD(dermis_contact, most) FIELD(dermis_contact, force) FIELD(dermis_contact, image)                    \
    FIELD(dermis_contact, given) FIELD(dermis_contact, nodes) FIELD(dermis_contact, room)                    \
    FIELD(dermis_contact, residual) FIELD(dermis_contact, sweeps)                \
    FIELD(dermis_contact, wrong)
#define OFFSET(record, field) offsetof(record, field),
#define NAME(record, field) " " #field

DERMIS_API const uint64_t *dermis_layout(void) {
    static const uint64_t layout[] = {
        DERMIS_ABI,           DERMIS_ROW,    DERMIS_LANES,           DERMIS_BOXES,    DERMIS_KEPT,
        sizeof(dermis_tree),  TREE(OFFSET)   sizeof(dermis_body),    BODY(OFFSET)
        sizeof(dermis_query), QUERY(OFFSET)  sizeof(dermis_contact), CONTACT(OFFSET) UINT64_MAX,
    };
    return layout;
}

DERMIS_API const char *dermis_fields(void) {
    return "tree" TREE(NAME) " body" BODY(NAME) " query" QUERY(NAME) " contact" CONTACT(NAME);
}

DERMIS_API const char *dermis_sources(void) { return DERMIS_SOURCES; }

#if defined(DERMIS_ALONE)
/* Compilers may call these for copies of records; nothing else provides them. */
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
