/* The floating-point environment of the kernels: rounding to nearest, with denormal numbers, and without traps.

   Other libraries in the process may change the environment. Without an environment of the kernels' own, the last bits
   of results would depend on those libraries. */
#ifndef DERMIS_FLOAT_ENVIRONMENT_H
#define DERMIS_FLOAT_ENVIRONMENT_H

#include <stdint.h>

#include "kernels.h"

#if defined(__x86_64__)
typedef uint32_t dermis_environment;
#define DERMIS_OWN_ENVIRONMENT 0x1f80u /* all exceptions masked, round to nearest, denormals as they are */
static inline dermis_environment dermis_control(void) { return __builtin_ia32_stmxcsr(); }
static inline void dermis_set(dermis_environment control) { __builtin_ia32_ldmxcsr(control); }
#elif defined(__aarch64__)
typedef uint64_t dermis_environment;
#define DERMIS_OWN_ENVIRONMENT 0u
static inline dermis_environment dermis_control(void) {
    dermis_environment control;
    __asm__ volatile("mrs %0, fpcr" : "=r"(control));
    return control;
}
static inline void dermis_set(dermis_environment control) { __asm__ volatile("msr fpcr, %0" : : "r"(control) : "memory"); }
#else
#error "the kernels know the floating-point environment of x86-64 and arm64 alone"
#endif

/* Set the kernels' environment; return the one before, for `dermis_leave`. */
static inline dermis_environment dermis_enter(void) {
    dermis_environment before = dermis_control();
    dermis_set(DERMIS_OWN_ENVIRONMENT);
    return before;
}

/* Restore the environment from before `dermis_enter`. */
static inline void dermis_leave(dermis_environment before) { dermis_set(before); }

/* Define a function of the interface. It refuses a record for which `sound` returns 0, and calls `run` in the kernels'
   own environment. */
#define DERMIS_FUNCTION(name, type, sound, run)      \
    DERMIS_API int32_t name(type *record) {          \
        if (!sound(record)) return DERMIS_BAD_RECORD; \
        dermis_environment outside = dermis_enter(); \
        int32_t status = run(record);                \
        dermis_leave(outside);                       \
        return status;                               \
    }

#endif
