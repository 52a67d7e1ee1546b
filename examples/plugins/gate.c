/* Gate: drives between the beacons b1 and b2, from the side on which it finds itself, and stops beyond them.
 *
 *   cc -shared -fPIC -O2 -ffp-contract=off -I ../../sdk/c -o gate.so gate.c -lm
 *   appell run gate.toml
 *
 * It steers for a point of the gate's axis that moves ahead of it (line of sight), so that it comes upon the
 * axis well before the gate.
 */
#include "appell_plugin.h"

#include <stdlib.h>
#include <string.h>

static const char DESCRIPTION[] =
    "{\"protocol\": 1, \"name\": \"gate\", \"version\": \"1.0\","
    " \"about\": \"Drives through the gate of b1 and b2 along its axis, and stops beyond it.\","
    " \"inputs\": [{\"name\": \"pose.x\", \"unit\": \"m\"}, {\"name\": \"pose.y\", \"unit\": \"m\"},"
    "  {\"name\": \"pose.yaw\", \"unit\": \"rad\"},"
    "  {\"name\": \"beacon.b1.x\", \"unit\": \"m\"}, {\"name\": \"beacon.b1.y\", \"unit\": \"m\"},"
    "  {\"name\": \"beacon.b2.x\", \"unit\": \"m\"}, {\"name\": \"beacon.b2.y\", \"unit\": \"m\"}],"
    " \"outputs\": [{\"name\": \"command.forward\", \"unit\": \"m/s\", \"min\": 0, \"max\": 1.5},"
    "  {\"name\": \"command.yaw_rate\", \"unit\": \"rad/s\", \"min\": -2, \"max\": 2},"
    "  {\"name\": \"controller.along\", \"unit\": \"m\"}, {\"name\": \"controller.beside\", \"unit\": \"m\"}],"
    " \"parameters\": [{\"name\": \"speed\", \"unit\": \"m/s\", \"default\": 0.6, \"min\": 0, \"max\": 1.5},"
    "  {\"name\": \"lookahead\", \"unit\": \"m\", \"default\": 0.5, \"min\": 0.1, \"max\": 5,"
    "   \"about\": \"how far ahead on the axis it looks\"},"
    "  {\"name\": \"beyond\", \"unit\": \"m\", \"default\": 1, \"min\": 0, \"max\": 10,"
    "   \"about\": \"where it stops behind the gate\"}]}";

enum { X, Y, YAW, B1_X, B1_Y, B2_X, B2_Y };
enum { FORWARD, YAW_RATE, ALONG, BESIDE };
enum { SPEED, LOOKAHEAD, BEYOND, PARAMETERS };

static const double ACCELERATION = 0.5; /* m/s² */
static const double GAIN = 2.5;         /* 1/s */
static const double TURN = 1.2;         /* rad/s */

/* What it remembers. */
typedef struct {
    double speed;
    double way; /* +1 or -1 along the axis; 0 before the first step */
} Memory;

typedef struct {
    double parameters[PARAMETERS];
    Memory memory;
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
    Memory *memory = &self->memory;
    const double *parameters = self->parameters;

    /* The axis is normal to the chord, through its middle. */
    const double cx = inputs[B2_X] - inputs[B1_X], cy = inputs[B2_Y] - inputs[B1_Y];
    const double length = sqrt(cx * cx + cy * cy);
    if (!(length > 0.0)) return 1;
    double ax = -cy / length, ay = cx / length;
    const double dx = inputs[X] - 0.5 * (inputs[B1_X] + inputs[B2_X]);
    const double dy = inputs[Y] - 0.5 * (inputs[B1_Y] + inputs[B2_Y]);
    if (memory->way == 0.0) memory->way = ax * dx + ay * dy > 0.0 ? -1.0 : 1.0;
    ax *= memory->way;
    ay *= memory->way;
    const double along = ax * dx + ay * dy;  /* beyond the gate */
    const double beside = ax * dy - ay * dx; /* to the left of the axis */

    const double look = parameters[LOOKAHEAD];
    const double heading = atan2(ay * look - ax * beside, ax * look + ay * beside);
    const double bearing = remainder(heading - inputs[YAW], 2.0 * acos(-1.0));

    /* As fast as it can still stop, and slower the less it points where it wants to. */
    const double left = fmax(parameters[BEYOND] - along, 0.0);
    const double brakes = sqrt(ACCELERATION * left);
    const double wanted = fmin(parameters[SPEED], brakes) * fmax(1.0 - fabs(bearing), 0.0);
    memory->speed += clamp(wanted - memory->speed, -ACCELERATION * dt, ACCELERATION * dt);
    outputs[FORWARD] = memory->speed;
    outputs[YAW_RATE] = left > 0.0 ? clamp(GAIN * bearing, -TURN, TURN) : 0.0;
    outputs[ALONG] = along;
    outputs[BESIDE] = beside;
    return 0;
}

const char *appell_reason(void *member)
{
    return member ? "the beacons b1 and b2 must be apart" : "no memory left";
}

size_t appell_save(void *member, uint8_t *bytes, size_t room)
{
    const Member *self = member;
    if (room >= sizeof self->memory) memcpy(bytes, &self->memory, sizeof self->memory);
    return sizeof self->memory;
}

int32_t appell_restore(void *member, const uint8_t *bytes, size_t length)
{
    Member *self = member;
    if (length != sizeof self->memory) return 1;
    memcpy(&self->memory, bytes, length);
    return 0;
}

int32_t appell_take_over(void *member, const double *outputs)
{
    ((Member *)member)->memory.speed = clamp(outputs[FORWARD], 0.0, 1.5);
    return 0;
}
