/* SPDX-License-Identifier: MIT OR Apache-2.0
 *
 * The C interface of Appell's plug-ins, version 1.
 *
 * A controller is a shared library with the functions below. Compile it with
 *
 *   cc -shared -fPIC -O2 -ffp-contract=off -o mine.so mine.c -lm
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

#ifdef __cplusplus
}
#endif

#endif
