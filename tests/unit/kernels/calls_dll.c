/* Call the functions of kernels.dll for a test under wine: requests come in by standard input, answers leave by standard output.

   It knows no record. A request has four numbers (length of the function's name, bytes of the arena, pointers, where the record
   lies), the name, the places of the pointers and the arena, in which a pointer is the place that it points to. An answer has the
   status and the arena. It is built without a C library, which would take minutes to make. */
#include <stddef.h>
#include <stdint.h>

typedef void *handle;
handle __stdcall LoadLibraryA(const char *name);
void *__stdcall GetProcAddress(handle module, const char *name);
handle __stdcall GetStdHandle(unsigned which);
int __stdcall ReadFile(handle file, void *to, unsigned count, unsigned *done, void *);
int __stdcall WriteFile(handle file, const void *from, unsigned count, unsigned *done, void *);
void *__stdcall VirtualAlloc(void *, size_t count, unsigned type, unsigned protection);
int __stdcall VirtualFree(void *, size_t count, unsigned type);
void __stdcall ExitProcess(unsigned status);
void wWinMainCRTStartup(void);

typedef int32_t (*on_record)(void *);

static handle from, to;

/* Read so many bytes; end well where a request would begin and there is none. */
static void *read(size_t count, int first) {
    char *out = VirtualAlloc(NULL, count + 16, 0x3000, 4);
    if (out == NULL) ExitProcess(4);
    for (size_t at = 0; at < count;) {
        unsigned done = 0;
        if (!ReadFile(from, out + at, (unsigned)(count - at), &done, NULL) || done == 0) ExitProcess(first && at == 0 ? 0 : 5);
        at += done;
    }
    return out;
}

static void write(const char *what, size_t count) {
    for (size_t at = 0; at < count;) {
        unsigned done = 0;
        if (!WriteFile(to, what + at, (unsigned)(count - at), &done, NULL)) ExitProcess(6);
        at += done;
    }
}

void wWinMainCRTStartup(void) {
    handle library = LoadLibraryA("kernels.dll");
    if (library == NULL) ExitProcess(2);
    from = GetStdHandle((unsigned)-10);
    to = GetStdHandle((unsigned)-11);
    for (;;) {
        int64_t *sizes = read(4 * sizeof(int64_t), 1);
        char *name = read((size_t)sizes[0], 0); /* zeros follow it */
        int64_t *pointers = read((size_t)sizes[2] * sizeof(int64_t), 0);
        char *arena = read((size_t)sizes[1], 0);
        on_record call = (on_record)GetProcAddress(library, name);
        if (call == NULL) ExitProcess(3);
        for (int64_t i = 0; i < sizes[2]; i++) *(uint64_t *)(arena + pointers[i]) += (uint64_t)(uintptr_t)arena;
        int64_t status = call(arena + sizes[3]);
        write((const char *)&status, sizeof status);
        write(arena, (size_t)sizes[1]);
        VirtualFree(sizes, 0, 0x8000);
        VirtualFree(name, 0, 0x8000);
        VirtualFree(pointers, 0, 0x8000);
        VirtualFree(arena, 0, 0x8000);
    }
}
