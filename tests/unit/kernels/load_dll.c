/* Hand the arrays of a file to Windows's library of kernels, and write its answers: for a test under wine.

   It is built without a C library, which would take minutes to make, and takes kernels.dll, in.bin and out.bin of its folder. */
#include "kernels.h"

typedef void *handle;
handle __stdcall LoadLibraryA(const char *name);
void *__stdcall GetProcAddress(handle module, const char *name);
handle __stdcall CreateFileA(const char *name, unsigned access, unsigned share, void *, unsigned how, unsigned flags, handle);
int __stdcall ReadFile(handle file, void *to, unsigned count, unsigned *done, void *);
int __stdcall WriteFile(handle file, const void *from, unsigned count, unsigned *done, void *);
void *__stdcall VirtualAlloc(void *, size_t count, unsigned type, unsigned protection);
void __stdcall ExitProcess(unsigned status);
void wWinMainCRTStartup(void);

typedef int32_t (*on_tree)(dermis_tree *);
typedef int32_t (*on_body)(dermis_body *);
typedef int32_t (*on_query)(dermis_query *);

static handle from, to;

static void *taken(size_t count) { return VirtualAlloc(NULL, count + 16, 0x3000, 4); }

static void *read(size_t count) {
    unsigned done = 0;
    void *out = taken(count);
    if (!ReadFile(from, out, (unsigned)count, &done, NULL) || done != count) ExitProcess(4);
    return out;
}

static void write(const void *what, size_t count) {
    unsigned done = 0;
    if (!WriteFile(to, what, (unsigned)count, &done, NULL) || done != count) ExitProcess(5);
}

void wWinMainCRTStartup(void) {
    handle library = LoadLibraryA("kernels.dll");
    if (library == NULL) ExitProcess(2);
    on_tree split = (on_tree)GetProcAddress(library, "dermis_tree_split");
    on_tree fit = (on_tree)GetProcAddress(library, "dermis_tree_fit");
    on_body fit_body = (on_body)GetProcAddress(library, "dermis_body_fit");
    on_body judge = (on_body)GetProcAddress(library, "dermis_body_judge");
    on_query distances = (on_query)GetProcAddress(library, "dermis_distances");
    if (split == NULL || fit == NULL || fit_body == NULL || judge == NULL || distances == NULL) ExitProcess(3);
    from = CreateFileA("in.bin", 0x80000000u, 1, NULL, 3, 0, NULL);
    to = CreateFileA("out.bin", 0x40000000u, 0, NULL, 2, 0, NULL);
    const int64_t *sizes = read(6 * sizeof(int64_t)); /* total, count, depth, boxes, points, vertices */
    size_t total = (size_t)sizes[0], count = (size_t)sizes[1], boxes = (size_t)sizes[3], n = (size_t)sizes[4];
    size_t vertices = (size_t)sizes[5];
    dermis_tree tree = {.total = sizes[0], .count = sizes[1], .depth = sizes[2]};
    tree.rows = read(14 * total * sizeof(double));
    tree.bounds = read(7 * total * sizeof(double));
    tree.order = read(count * sizeof(int64_t));
    tree.packed = taken(count * DERMIS_ROW * sizeof(double));
    tree.boxes = taken(boxes * DERMIS_BOXES * sizeof(float));
    dermis_body body = {.tree = &tree, .all = &tree, .vertices = sizes[5]};
    dermis_query query = {.body = &body, .count = sizes[4]};
    query.limit = *(const double *)read(sizeof(double));
    query.points = read(3 * n * sizeof(double));
    body.corners = read(3 * total * sizeof(int64_t));
    body.across = read(3 * total * sizeof(int64_t));
    body.edge_kind = read(3 * total);
    body.vertex_kind = read(vertices);
    const int64_t *flags = read(3 * sizeof(int64_t)); /* closed, parts, slabs */
    body.closed = flags[0], body.parts = flags[1], body.slabs = flags[2];
    body.part = read((size_t)flags[1] * sizeof(int64_t));
    body.slab = read(5 * (size_t)flags[2] * sizeof(double));
    body.normals = taken(3 * vertices * sizeof(double));
    query.gap = taken(n * sizeof(double));
    query.normal = taken(3 * n * sizeof(double));
    query.closest = taken(3 * n * sizeof(double));
    query.weights = taken(3 * n * sizeof(double));
    query.triangle = taken(n * sizeof(int64_t));
    query.feature = taken(n);
    query.beside = taken(n);
    if (split(&tree) || fit(&tree) || fit_body(&body) || (body.closed && judge(&body)) || distances(&query)) ExitProcess(6);
    char by_rays = (char)body.by_rays;
    write(tree.boxes, boxes * DERMIS_BOXES * sizeof(float));
    write(body.normals, 3 * vertices * sizeof(double));
    write(query.gap, n * sizeof(double));
    write(query.normal, 3 * n * sizeof(double));
    write(query.closest, 3 * n * sizeof(double));
    write(query.weights, 3 * n * sizeof(double));
    write(query.triangle, n * sizeof(int64_t));
    write(query.feature, n);
    write(query.beside, n);
    write(&by_rays, 1);
    ExitProcess(0);
}
