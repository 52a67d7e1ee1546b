/* The lag as an FMU of FMI 3.0. */
#include <stdbool.h>

#include "lag.h"

typedef void (*logger)(void *, int, const char *, const char *);

void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                  bool logging, bool events, bool early, const unsigned *references,
                                  size_t count, void *environment, logger log, void *update)
{
    size_t length = strlen(resources);
    (void)name, (void)references;
    if (visible || !logging || events || early || count || update || resources[length - 1] != '/')
        return NULL;
    if (strcmp(token, "{lag}")) {
        log(environment, 3, "logStatusError", "the token is wrong");
        return NULL;
    }
    struct lag *lag = calloc(1, sizeof *lag);
    lag->environment = environment;
    lag->log = log;
    return begin(lag) ? lag : NULL;
}

int fmi3EnterInitializationMode(void *lag, bool has_tolerance, double tolerance, double t, bool has_end,
                                double end)
{
    (void)tolerance, (void)end;
    initialize(lag, t);
    return has_tolerance || has_end ? 3 : 0;
}

int fmi3ExitInitializationMode(void *made)
{
    struct lag *lag = made;
    lag->memory.is_initialized = 1;
    return 0;
}

int fmi3SetFloat64(void *lag, const unsigned *references, size_t count, const double *values, size_t length)
{
    return length != count || numbers(lag, references, count, NULL, values) ? 3 : 0;
}

int fmi3GetFloat64(void *lag, const unsigned *references, size_t count, double *values, size_t length)
{
    return length != count || numbers(lag, references, count, values, NULL) ? 3 : 0;
}

int fmi3DoStep(void *made, double t, double dt, bool goes_on, bool *event, bool *ends, bool *early, double *last)
{
    struct lag *lag = made;
    (void)goes_on;
    *event = *ends = *early = false;
    *last = t + dt;
#ifdef ENDS
    *ends = true;
#endif
#ifdef EARLY
    *early = true;
    *last = t + dt / 2;
#endif
#ifdef STATUS
    if (lag->memory.values[U] > 1.0) {
        ((logger)lag->log)(lag->environment, STATUS, "logStatusError", "u is too large");
        return STATUS;
    }
#endif
    return advance(lag, t, dt) ? 3 : 0;
}

int fmi3Terminate(void *made)
{
    struct lag *lag = made;
    return lag->memory.is_initialized ? 0 : 3;
}

void fmi3FreeInstance(void *lag)
{
    instances--;
    free(lag);
}

int fmi3GetFMUState(void *made, void **state)
{
    struct lag *lag = made;
    if (!*state)
        *state = malloc(sizeof lag->memory);
    memcpy(*state, &lag->memory, sizeof lag->memory);
    return 0;
}

int fmi3SetFMUState(void *made, void *state)
{
    struct lag *lag = made;
    memcpy(&lag->memory, state, sizeof lag->memory);
    return 0;
}

int fmi3FreeFMUState(void *made, void **state)
{
    (void)made;
    free(*state);
    *state = NULL;
    return 0;
}

int fmi3SerializedFMUStateSize(void *made, void *state, size_t *size)
{
    (void)made, (void)state;
    *size = sizeof(struct memory);
    return 0;
}

int fmi3SerializeFMUState(void *made, void *state, unsigned char *bytes, size_t size)
{
    (void)made;
    memcpy(bytes, state, size);
    return 0;
}

int fmi3DeserializeFMUState(void *made, const unsigned char *bytes, size_t size, void **state)
{
    (void)made;
    if (size != sizeof(struct memory))
        return 3;
    *state = malloc(size);
    memcpy(*state, bytes, size);
    return 0;
}
