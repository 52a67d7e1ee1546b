/* A controller to start from: drives to the beacon of the task and stops beside it.
 *
 *   cc -shared -fPIC -O2 -ffp-contract=off -o NAME.so NAME.c -lm
 */
#include "appell_plugin.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* What it reads: signals of the robot with their units, and the place of the task's beacon. What it writes,
 * and within which limits: more is a fault. Numbers that a scenario, --set and a batch can change. */
static const char DESCRIPTION[] =
    "{\"protocol\": 1, \"name\": \"NAME\", \"about\": \"Turns to the beacon and drives to it.\","
    " \"inputs\": [{\"name\": \"pose.x\", \"unit\": \"m\"}, {\"name\": \"pose.y\", \"unit\": \"m\"},"
    "  {\"name\": \"pose.yaw\", \"unit\": \"rad\"},"
    "  {\"name\": \"task.beacon.x\", \"unit\": \"m\"}, {\"name\": \"task.beacon.y\", \"unit\": \"m\"}],"
    " \"outputs\": [{\"name\": \"command.forward\", \"unit\": \"m/s\", \"min\": -1, \"max\": 1},"
    "  {\"name\": \"command.yaw_rate\", \"unit\": \"rad/s\", \"min\": -2, \"max\": 2},"
    "  {\"name\": \"controller.distance\", \"unit\": \"m\"}],"
    " \"parameters\": [{\"name\": \"speed\", \"unit\": \"m/s\", \"default\": 0.6, \"min\": 0, \"max\": 1},"
    "  {\"name\": \"gain\", \"unit\": \"1/s\", \"default\": 2, \"min\": 0, \"max\": 10},"
    "  {\"name\": \"stop\", \"unit\": \"m\", \"default\": 0.4, \"min\": 0, \"max\": 5,"
    "   \"about\": \"distance from the beacon\"}]}";

enum { X, Y, YAW, BEACON_X, BEACON_Y };
enum { FORWARD, YAW_RATE, DISTANCE };
enum { SPEED, GAIN, STOP, PARAMETERS };

typedef struct {
    double parameters[PARAMETERS];
    double speed; /* all that it remembers */
} Member;

uint32_t appell_abi(void) { return APPELL_ABI; }

const char *appell_describe(void) { return DESCRIPTION; }

void *appell_create(const double *parameters, const char *context)
{
    (void)context;
    Member *member = calloc(1, sizeof *member);
    if (member) memcpy(member->parameters, parameters, sizeof member->parameters);
    return member;
}

void appell_destroy(void *member) { free(member); }

static double clamp(double value, double least, double most)
{
    return fmin(fmax(value, least), most);
}

int32_t appell_step(void *member, double t, double dt, const double *inputs, double *outputs)
{
    (void)t;
    Member *self = member;
    const double *parameters = self->parameters;
    const double dx = inputs[BEACON_X] - inputs[X], dy = inputs[BEACON_Y] - inputs[Y];
    const double left = sqrt(dx * dx + dy * dy) - parameters[STOP];
    const double bearing = remainder(atan2(dy, dx) - inputs[YAW], 2.0 * acos(-1.0));

    /* Speed up gently; brake so as to stop in time. */
    const double brakes = left > 0.0 ? sqrt(2.0 * 0.3 * left) : 0.0;
    const double wanted = fabs(bearing) < 0.5 ? fmin(parameters[SPEED], brakes) : 0.0;
    self->speed += clamp(wanted - self->speed, -0.6 * dt, 0.6 * dt);
    outputs[FORWARD] = self->speed;
    outputs[YAW_RATE] = left > 0.02 ? clamp(parameters[GAIN] * bearing, -1.2, 1.2) : 0.0;
    outputs[DISTANCE] = left;
    return 0;
}

size_t appell_save(void *member, uint8_t *bytes, size_t room)
{
    const Member *self = member;
    if (room >= sizeof self->speed) memcpy(bytes, &self->speed, sizeof self->speed);
    return sizeof self->speed;
}

int32_t appell_restore(void *member, const uint8_t *bytes, size_t length)
{
    Member *self = member;
    if (length != sizeof self->speed) return 1;
    memcpy(&self->speed, bytes, length);
    return 0;
}

int32_t appell_take_over(void *member, const double *outputs)
{
    ((Member *)member)->speed = outputs[FORWARD];
    return 0;
}
