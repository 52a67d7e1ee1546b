/* The lag as an FMU of FMI 2.0. */
#include "lag.h"

typedef void (*logger)(void *, const char *, int, const char *, const char *, ...);

struct callbacks {
    logger logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
};

void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                      const struct callbacks *callbacks, int visible, int logging)
{
    if (type != 1 || visible || !logging || strncmp(resources, "file:///", 8))
        return NULL;
    if (strcmp(guid, "{lag}")) {
        callbacks->logger(NULL, name, 3, "logStatusError", "the token is wrong: %s %g", guid, 1.0);
        return NULL;
    }
    struct lag *lag = callbacks->allocate(1, sizeof *lag);
    lag->callbacks = callbacks;
    return begin(lag) ? lag : NULL;
}

int fmi2SetupExperiment(void *lag, int has_tolerance, double tolerance, double t, int has_end, double end)
{
    (void)tolerance, (void)end;
    initialize(lag, t);
    return has_tolerance || has_end ? 3 : 0;
}

int fmi2EnterInitializationMode(void *lag)
{
    (void)lag;
    return 0;
}

int fmi2ExitInitializationMode(void *made)
{
    struct lag *lag = made;
    lag->memory.is_initialized = 1;
    return 0;
}

int fmi2SetReal(void *lag, const unsigned *references, size_t count, const double *values)
{
    return numbers(lag, references, count, NULL, values) ? 3 : 0;
}

int fmi2GetReal(void *lag, const unsigned *references, size_t count, double *values)
{
    return numbers(lag, references, count, values, NULL) ? 3 : 0;
}

#ifndef LACKS_STEP
int fmi2DoStep(void *made, double t, double dt, int goes_on)
{
    struct lag *lag = made;
    (void)goes_on;
#ifdef STATUS
    const struct callbacks *callbacks = lag->callbacks;
    if (lag->memory.values[U] > 1.0) {
        callbacks->logger(NULL, "lag", STATUS, "logStatusError", "u is too large", 1, 2.0);
        callbacks->logger(NULL, "lag", 0, "logAll", "all is well");
        return STATUS;
    }
#endif
    return advance(lag, t, dt) ? 3 : 0;
}
#endif

int fmi2Terminate(void *made)
{
    struct lag *lag = made;
    return lag->memory.is_initialized ? 0 : 3;
}

void fmi2FreeInstance(void *made)
{
    struct lag *lag = made;
    const struct callbacks *callbacks = lag->callbacks;
    instances--;
    callbacks->release(lag);
}

int fmi2GetFMUstate(void *made, void **state)
{
    struct lag *lag = made;
    if (!*state)
        *state = malloc(sizeof lag->memory);
    memcpy(*state, &lag->memory, sizeof lag->memory);
    return 0;
}

int fmi2SetFMUstate(void *made, void *state)
{
    struct lag *lag = made;
    memcpy(&lag->memory, state, sizeof lag->memory);
    return 0;
}

int fmi2FreeFMUstate(void *made, void **state)
{
    (void)made;
    free(*state);
    *state = NULL;
    return 0;
}

int fmi2SerializedFMUstateSize(void *made, void *state, size_t *size)
{
    (void)made, (void)state;
    *size = sizeof(struct memory);
    return 0;
}

int fmi2SerializeFMUstate(void *made, void *state, unsigned char *bytes, size_t size)
{
    (void)made;
    memcpy(bytes, state, size);
    return 0;
}

int fmi2DeSerializeFMUstate(void *made, const unsigned char *bytes, size_t size, void **state)
{
    (void)made;
    if (size != sizeof(struct memory))
        return 3;
    *state = malloc(size);
    memcpy(*state, bytes, size);
    return 0;
}
