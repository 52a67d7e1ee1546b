/* SPDX-License-Identifier: MIT OR Apache-2.0
 *
 * The C interface of Appell's plug-ins, version 1.
 *
 * A controller is a shared library with the functions below. Compile it with
 *
 *   cc -shared -fPIC -O2 -ffp-contract=off -o mine.so mine.c -lm
 *
 * or, without the C library, as a module of WebAssembly, which has the same functions:
 *
 *   clang --target=wasm32 -mbulk-memory -nostdlib -Wl,--no-entry,--export-dynamic -O2 -ffp-contract=off \
 *     -o mine.wasm mine.c
 *
 * Units are SI, frames those of REP-103. A member is one life of the controller: of one robot, in one
 * trial. Its memory belongs into it, and nowhere else: then worlds can be saved and go on, and repetitions
 * have the same bits. A member is used by one thread at a time, but not always by the same.
 */
#ifndef APPELL_PLUGIN_H
#define APPELL_PLUGIN_H

#include <stddef.h>
#include <stdint.h>

#define APPELL_ABI 1

#if defined(_WIN32)
#define APPELL_EXPORT __declspec(dllexport)
#else
#define APPELL_EXPORT __attribute__((visibility("default")))
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* APPELL_ABI. */
APPELL_EXPORT uint32_t appell_abi(void);

/* What it is, as JSON that lasts: protocol (1), name, version, about; inputs (name, unit); outputs (name,
 * unit, min, max); parameters (name, unit, default, min, max, about). */
APPELL_EXPORT const char *appell_describe(void);

/* A new member, or NULL. Parameters are in the order of the description; the context (arena, task, path,
 * platform) is JSON, for those who read it. Both last as long as the call. */
APPELL_EXPORT void *appell_create(const double *parameters, const char *context);

/* Ends a member. */
APPELL_EXPORT void appell_destroy(void *member);

/* A step of dt, s, from t, s: reads all inputs and writes all outputs, in the order of the description.
 * Not 0 if it failed. */
APPELL_EXPORT int32_t appell_step(void *member, double t, double dt, const double *inputs, double *outputs);

/* The functions below may be left out. */

/* Why the last call failed, in words that last until the next; of no member where none was made. */
APPELL_EXPORT const char *appell_reason(void *member);

/* How many bytes a member remembers; writes them if there is room for all. */
APPELL_EXPORT size_t appell_save(void *member, uint8_t *bytes, size_t room);

/* Gives a member the memory of another. Not 0 if it does not fit. */
APPELL_EXPORT int32_t appell_restore(void *member, const uint8_t *bytes, size_t length);

/* Before the first step of a member that takes over from another controller: what that one wrote last to
 * the outputs. Not 0 if it cannot. */
APPELL_EXPORT int32_t appell_take_over(void *member, const double *outputs);

/* Steps several members at once, each at its own time: inputs and outputs stand one after the other. The
 * same as one by one. The place of the first that failed, counted from 1, or 0. Of modules only. */
APPELL_EXPORT int32_t appell_step_many(int32_t count, void *const *members, const double *t, double dt,
                                       const double *inputs, double *outputs);

#if defined(__wasm__)
/* A place for what Appell writes and reads, which is its own until it asks again. It asks for more than there was
 * only: then memory grows. */
__attribute__((weak)) APPELL_EXPORT void *appell_room(size_t size)
{
    static __attribute__((aligned(16))) unsigned char room[8192];
    if (size <= sizeof room) return room;
    const size_t page = __builtin_wasm_memory_grow(0, size / 65536 + 1);
    return page == (size_t)-1 ? NULL : (void *)(page * 65536);
}

/* Appell gives modules these, with the same bits on every machine. */
#define APPELL_MATH(name) __attribute__((import_module("env"), import_name(#name))) double appell_##name
APPELL_MATH(sin)(double);
APPELL_MATH(cos)(double);
APPELL_MATH(tan)(double);
APPELL_MATH(asin)(double);
APPELL_MATH(acos)(double);
APPELL_MATH(atan)(double);
APPELL_MATH(atan2)(double, double);
APPELL_MATH(exp)(double);
APPELL_MATH(log)(double);
APPELL_MATH(pow)(double, double);
APPELL_MATH(hypot)(double, double);
APPELL_MATH(fmod)(double, double);
APPELL_MATH(remainder)(double, double);
#undef APPELL_MATH
#define sin appell_sin
#define cos appell_cos
#define tan appell_tan
#define asin appell_asin
#define acos appell_acos
#define atan appell_atan
#define atan2 appell_atan2
#define exp appell_exp
#define log appell_log
#define pow appell_pow
#define hypot appell_hypot
#define fmod appell_fmod
#define remainder appell_remainder
static inline double fabs(double x) { return __builtin_fabs(x); }
static inline double sqrt(double x) { return __builtin_sqrt(x); }
static inline double floor(double x) { return __builtin_floor(x); }
static inline double fmin(double a, double b) { return a != a || b < a ? b : a; }
static inline double fmax(double a, double b) { return a != a || b > a ? b : a; }
#else
#include <math.h>
#endif

#ifdef __cplusplus
}
#endif

#endif
