/* The processor's abilities, and functions that replace those of a C library. */
#include "kernels.h"

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
