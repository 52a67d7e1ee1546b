/* A lag of first order, T y' = k u - y, with u constant within a step: what both versions make an FMU of.
 *
 * Names that are defined when it is compiled make it do what an FMU should not. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* References of the variables. */
enum { U = 1, Y = 2, T = 3, K = 4, TIME = 5, START = 6, COUNT };

/* What it remembers, and may be copied. */
struct memory {
    double values[COUNT];
    int is_initialized;
};

struct lag {
    struct memory memory;
    void *environment;
    const void *callbacks;
    void *log;
};

static int instances;

#ifdef NEEDS_ANOTHER
extern int other_function;
int *needed = &other_function;
#endif

static int begin(struct lag *lag)
{
#ifdef EXITS
    exit(3);
#endif
#ifdef SINGLE
    if (instances > 0)
        abort();
#endif
    instances++;
    lag->memory.values[T] = 1.0;
    lag->memory.values[K] = 1.0;
    return 1;
}

/* 0 if it went well. */
static int numbers(struct lag *lag, const unsigned references[], size_t count, double *got, const double *set)
{
    for (size_t k = 0; k < count; k++) {
        if (references[k] == 0 || references[k] >= COUNT)
            return 1;
        double *value = &lag->memory.values[references[k]];
        /* Parameters are fixed once it is initialized. */
        if (set && (references[k] == T || references[k] == K) && lag->memory.is_initialized)
            return 1;
        if (set)
            *value = set[k];
        else
            got[k] = *value;
    }
    return 0;
}

static void initialize(struct lag *lag, double t)
{
    lag->memory.values[TIME] = t;
    lag->memory.values[START] = t;
}

/* 0 if it went well. */
static int advance(struct lag *lag, double t, double dt)
{
    double *v = lag->memory.values;
    /* What is printed must not come among the messages. */
    static int has_printed;
    if (!has_printed++)
        puts("a lag steps");
#ifdef CRASHES
    *(volatile int *)0 = 1;
#endif
    if (!lag->memory.is_initialized || fabs(t - v[TIME]) > 1e-9)
        return 1;
    v[Y] = v[K] * v[U] + (v[Y] - v[K] * v[U]) * exp(-dt / v[T]);
    v[TIME] = t + dt;
    return 0;
}
