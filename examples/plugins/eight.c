/* Figure eight: once round the beacon "west", once round "east" the other way, on circles that touch in the
 * middle between them; then it stops.
 *
 *   clang --target=wasm32 -mbulk-memory -nostdlib -Wl,--no-entry,--export-dynamic -O2 -ffp-contract=off \
 *     -I ../../sdk/c -o eight.wasm eight.c
 *   cc -shared -fPIC -O2 -ffp-contract=off -I ../../sdk/c -o eight.so eight.c -lm
 *   appell run eight.toml
 *
 * It needs nothing of the C library but mathematics: members come from a pool.
 */
#include "appell_plugin.h"

static const char DESCRIPTION[] =
    "{\"protocol\": 1, \"name\": \"eight\", \"version\": \"1.0\","
    " \"about\": \"Drives circles round two beacons by turns, each the other way.\","
    " \"inputs\": [{\"name\": \"pose.x\", \"unit\": \"m\"}, {\"name\": \"pose.y\", \"unit\": \"m\"},"
    "  {\"name\": \"pose.yaw\", \"unit\": \"rad\"},"
    "  {\"name\": \"beacon.west.x\", \"unit\": \"m\"}, {\"name\": \"beacon.west.y\", \"unit\": \"m\"},"
    "  {\"name\": \"beacon.east.x\", \"unit\": \"m\"}, {\"name\": \"beacon.east.y\", \"unit\": \"m\"}],"
    " \"outputs\": [{\"name\": \"command.forward\", \"unit\": \"m/s\", \"min\": 0, \"max\": 1.5},"
    "  {\"name\": \"command.yaw_rate\", \"unit\": \"rad/s\", \"min\": -2, \"max\": 2},"
    "  {\"name\": \"controller.circle\", \"unit\": \"1\"}, {\"name\": \"controller.outside\", \"unit\": \"m\"}],"
    " \"parameters\": [{\"name\": \"speed\", \"unit\": \"m/s\", \"default\": 0.2, \"min\": 0, \"max\": 1.5},"
    "  {\"name\": \"laps\", \"unit\": \"1\", \"default\": 1, \"min\": 1, \"max\": 1000}]}";

enum { X, Y, YAW, BEACON /* x and y of the first, then of the second */ };
enum { FORWARD, YAW_RATE, CIRCLE, OUTSIDE };
enum { SPEED, LAPS, PARAMETERS };

static const double ACCELERATION = 0.2; /* m/s² */
static const double LOOKAHEAD = 0.3;    /* m */
static const double GAIN = 2.0;         /* 1/s */
static const double TURN = 1.5;         /* rad/s */
static const double PI = 3.14159265358979323846;

/* What it remembers: numbers only, so that its bytes have no gaps. */
typedef struct {
    double speed;
    double circle; /* how many were driven */
    double first;  /* beacon of the first circle, 0 or 1 */
    double sense;  /* of the present circle, +1 to the left; 0 before the first step */
    double angle;  /* at which the beacon saw it last */
    double turned; /* round the beacon since the middle */
} Memory;

typedef struct {
    double parameters[PARAMETERS];
    Memory memory;
    unsigned char is_used;
} Member;

/* Members that live at once. Threads may make some at the same time: a place is taken in one go. */
static Member pool[256];

uint32_t appell_abi(void) { return APPELL_ABI; }

const char *appell_describe(void) { return DESCRIPTION; }

void *appell_create(const double *parameters, const char *context)
{
    (void)context;
    for (unsigned k = 0; k < sizeof pool / sizeof *pool; k++) {
        Member *member = &pool[k];
        if (__atomic_test_and_set(&member->is_used, __ATOMIC_ACQUIRE)) continue;
        member->memory = (Memory){0};
        for (int i = 0; i < PARAMETERS; i++) member->parameters[i] = parameters[i];
        return member;
    }
    return NULL;
}

void appell_destroy(void *member) { __atomic_clear(&((Member *)member)->is_used, __ATOMIC_RELEASE); }

static double clamp(double value, double least, double most)
{
    return fmin(fmax(value, least), most);
}

/* An angle in [-pi, pi]. */
static double wrap(double angle) { return remainder(angle, 2.0 * PI); }

/* The beacon of the present circle: 0 or 1. */
static int beacon(const Memory *memory) { return (int)fmod(memory->first + memory->circle, 2.0); }

/* The angle of the place from a beacon. */
static double angle(const double *inputs, int k, double x, double y)
{
    return atan2(y - inputs[BEACON + 2 * k + 1], x - inputs[BEACON + 2 * k]);
}

/* Begins with the nearer beacon, the way round it that the robot points. */
static void begin(Memory *memory, const double *inputs)
{
    double away[2];
    for (int k = 0; k < 2; k++) {
        away[k] = hypot(inputs[X] - inputs[BEACON + 2 * k], inputs[Y] - inputs[BEACON + 2 * k + 1]);
    }
    memory->first = away[1] < away[0] ? 1.0 : 0.0;
    const int k = beacon(memory), other = 1 - k;
    memory->angle = angle(inputs, k, inputs[X], inputs[Y]);
    memory->sense = sin(inputs[YAW] - memory->angle) < 0.0 ? -1.0 : 1.0;
    const double middle = angle(inputs, k, inputs[BEACON + 2 * other], inputs[BEACON + 2 * other + 1]);
    memory->turned = memory->sense * wrap(memory->angle - middle);
    /* A little before the middle is not almost round. */
    if (memory->turned < -0.3) memory->turned += 2.0 * PI;
}

int32_t appell_step(void *member, double t, double dt, const double *inputs, double *outputs)
{
    (void)t;
    Member *self = member;
    Memory *memory = &self->memory;
    if (memory->sense == 0.0) begin(memory, inputs);

    const double seen = angle(inputs, beacon(memory), inputs[X], inputs[Y]);
    memory->turned += memory->sense * wrap(seen - memory->angle);
    memory->angle = seen;
    const double circles = 2.0 * floor(self->parameters[LAPS]);
    if (memory->turned >= 2.0 * PI && memory->circle + 1.0 < circles) {
        memory->circle += 1.0;
        memory->turned -= 2.0 * PI;
        memory->sense = -memory->sense;
        memory->angle = angle(inputs, beacon(memory), inputs[X], inputs[Y]);
    }

    const double *at = inputs + BEACON + 2 * beacon(memory);
    const double dx = inputs[BEACON + 2] - inputs[BEACON], dy = inputs[BEACON + 3] - inputs[BEACON + 1];
    const double radius = 0.5 * sqrt(dx * dx + dy * dy);
    if (!(radius > 0.0)) return 1;
    const double px = inputs[X] - at[0], py = inputs[Y] - at[1];
    const double outside = sqrt(px * px + py * py) - radius;

    /* Along the circle, and the more inwards the farther outside. */
    const double heading = memory->angle + memory->sense * (0.5 * PI + atan(outside / LOOKAHEAD));
    const double bearing = wrap(heading - inputs[YAW]);

    /* It brakes to stop where it began. */
    const double rounds = circles - 1.0 - memory->circle;
    const double left = radius * fmax(2.0 * PI * (1.0 + rounds) - memory->turned, 0.0);
    const double brakes = sqrt(ACCELERATION * left);
    const double wanted = fmin(self->parameters[SPEED], brakes) * fmax(1.0 - fabs(bearing), 0.0);
    memory->speed += clamp(wanted - memory->speed, -ACCELERATION * dt, ACCELERATION * dt);
    const double turn = memory->sense * memory->speed / radius + GAIN * bearing;
    outputs[FORWARD] = memory->speed;
    outputs[YAW_RATE] = left > 0.0 ? clamp(turn, -TURN, TURN) : 0.0;
    outputs[CIRCLE] = memory->circle;
    outputs[OUTSIDE] = outside;
    return 0;
}

const char *appell_reason(void *member)
{
    return member ? "the beacons west and east must be apart" : "has no more than 256 members at once";
}

size_t appell_save(void *member, uint8_t *bytes, size_t room)
{
    const Member *self = member;
    if (room >= sizeof self->memory) __builtin_memcpy(bytes, &self->memory, sizeof self->memory);
    return sizeof self->memory;
}

int32_t appell_restore(void *member, const uint8_t *bytes, size_t length)
{
    Member *self = member;
    if (length != sizeof self->memory) return 1;
    __builtin_memcpy(&self->memory, bytes, length);
    return 0;
}

int32_t appell_take_over(void *member, const double *outputs)
{
    ((Member *)member)->memory.speed = clamp(outputs[FORWARD], 0.0, 1.5);
    return 0;
}
