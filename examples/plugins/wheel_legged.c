/* A model of one's own: the kinematics of a wheel-legged robot, whose front and rear wheels steer.
 *
 *   cc -shared -fPIC -O2 -ffp-contract=off -I ../../sdk/c -o wheel_legged.so wheel_legged.c -lm
 *   clang --target=wasm32 -mbulk-memory -nostdlib -Wl,--no-entry,--export-dynamic -O2 -ffp-contract=off \
 *     -I ../../sdk/c -o wheel_legged.wasm wheel_legged.c
 *
 * The rear axle's middle B moves at V along its wheels, which are turned by beta, those of the front axle by
 * alpha. The center of mass lies l2 before B and l1 behind the front axle. Then (Feng and
 * Guo 2015)
 *
 *   yaw rate = V sin(alpha - beta) / ((l1 + l2) cos alpha),
 *
 * and the center of mass moves as B does, and by l2 times the yaw rate to the left. The rear wheels turn
 * against the front ones: beta = -rear alpha. Commands are speed and yaw rate; the legs steer no faster than
 * they can.
 */
#include "appell_plugin.h"

static const char DESCRIPTION[] =
    "{\"protocol\": 1, \"name\": \"wheel-legged\", \"about\": \"Kinematics with front and rear steering.\","
    " \"inputs\": [{\"name\": \"command.forward\", \"unit\": \"m/s\"},"
    "  {\"name\": \"command.yaw_rate\", \"unit\": \"rad/s\"}],"
    " \"outputs\": [{\"name\": \"pose.x\", \"unit\": \"m\"}, {\"name\": \"pose.y\", \"unit\": \"m\"},"
    "  {\"name\": \"pose.yaw\", \"unit\": \"rad\"}, {\"name\": \"twist.forward\", \"unit\": \"m/s\"},"
    "  {\"name\": \"twist.left\", \"unit\": \"m/s\"}, {\"name\": \"twist.yaw_rate\", \"unit\": \"rad/s\"},"
    "  {\"name\": \"model.front_angle\", \"unit\": \"rad\"}, {\"name\": \"model.rear_angle\", \"unit\": \"rad\"}],"
    " \"parameters\": ["
    "  {\"name\": \"ahead\", \"unit\": \"m\", \"default\": 0.115, \"min\": 0.001, \"max\": 10, \"about\": \"l1\"},"
    "  {\"name\": \"behind\", \"unit\": \"m\", \"default\": 0.115, \"min\": 0.001, \"max\": 10, \"about\": \"l2\"},"
    "  {\"name\": \"rear\", \"unit\": \"1\", \"default\": 0.5, \"min\": 0, \"max\": 1,"
    "   \"about\": \"rear angle per front angle, against it\"},"
    "  {\"name\": \"angle_max\", \"unit\": \"rad\", \"default\": 0.6, \"min\": 0.01, \"max\": 1.2},"
    "  {\"name\": \"rate_max\", \"unit\": \"rad/s\", \"default\": 3, \"min\": 0.01, \"max\": 100},"
    "  {\"name\": \"acceleration\", \"unit\": \"m/s\xc2\xb2\", \"default\": 2, \"min\": 0.01, \"max\": 100}]}";

enum { FORWARD, YAW_RATE };
enum { AHEAD, BEHIND, REAR, ANGLE_MAX, RATE_MAX, ACCELERATION, PARAMETERS };

/* All that it remembers: pose of the center of mass, speed of the rear axle, front angle. */
typedef struct {
    double x, y, yaw, speed, angle;
} State;

typedef struct {
    double parameters[PARAMETERS];
    State state;
    int is_used;
} Member;

/* Without the C library a module has no malloc. */
enum { MEMBERS = 256 };
static Member members[MEMBERS];

uint32_t appell_abi(void) { return APPELL_ABI; }

const char *appell_describe(void) { return DESCRIPTION; }

void *appell_create(const double *parameters, const char *context)
{
    (void)context;
    for (int k = 0; k < MEMBERS; k++) {
        if (members[k].is_used) continue;
        members[k] = (Member){.is_used = 1};
        for (int p = 0; p < PARAMETERS; p++) members[k].parameters[p] = parameters[p];
        return &members[k];
    }
    return 0;
}

void appell_destroy(void *member) { ((Member *)member)->is_used = 0; }

static double clamp(double value, double least, double most) { return fmin(fmax(value, least), most); }

static double yaw_rate(const double *p, double speed, double angle)
{
    return speed * sin(angle * (1.0 + p[REAR])) / ((p[AHEAD] + p[BEHIND]) * cos(angle));
}

/* The front angle at which the yaw rate is the wanted one: by halving, for it grows with the angle. */
static double wanted_angle(const double *p, double speed, double wanted)
{
    double low = -p[ANGLE_MAX], high = p[ANGLE_MAX];
    const double sense = speed < 0.0 ? -1.0 : 1.0;
    for (int k = 0; k < 40; k++) {
        const double middle = 0.5 * (low + high);
        if (sense * (yaw_rate(p, speed, middle) - wanted) < 0.0) low = middle;
        else high = middle;
    }
    return 0.5 * (low + high);
}

/* Rates of x, y and yaw of the center of mass. */
static void rates(const double *p, const State *s, double yaw, double *rate)
{
    const double turn = yaw_rate(p, s->speed, s->angle), course = yaw - p[REAR] * s->angle;
    rate[0] = s->speed * cos(course) - p[BEHIND] * turn * sin(yaw);
    rate[1] = s->speed * sin(course) + p[BEHIND] * turn * cos(yaw);
    rate[2] = turn;
}

int32_t appell_step(void *member, double t, double dt, const double *inputs, double *outputs)
{
    (void)t;
    Member *self = member;
    const double *p = self->parameters;
    State *s = &self->state;
    const double change = p[ACCELERATION] * dt, turn = p[RATE_MAX] * dt;
    s->speed += clamp(inputs[FORWARD] - s->speed, -change, change);
    /* Standing it cannot turn, and keeps its wheels as they are. */
    if (fabs(s->speed) > 1e-3)
        s->angle += clamp(wanted_angle(p, s->speed, inputs[YAW_RATE]) - s->angle, -turn, turn);

    /* Runge-Kutta 4 at constant speed and angle: the yaw rate is constant, the rest follows the yaw. */
    double first[3], middle[3], last[3];
    rates(p, s, s->yaw, first);
    rates(p, s, s->yaw + 0.5 * dt * first[2], middle);
    rates(p, s, s->yaw + dt * first[2], last);
    s->x += dt / 6.0 * (first[0] + 4.0 * middle[0] + last[0]);
    s->y += dt / 6.0 * (first[1] + 4.0 * middle[1] + last[1]);
    s->yaw += dt * first[2];

    rates(p, s, 0.0, first);
    outputs[0] = s->x;
    outputs[1] = s->y;
    outputs[2] = s->yaw;
    for (int k = 0; k < 3; k++) outputs[3 + k] = first[k];
    outputs[6] = s->angle;
    outputs[7] = -p[REAR] * s->angle;
    return 0;
}

size_t appell_save(void *member, uint8_t *bytes, size_t room)
{
    if (room >= sizeof(State)) __builtin_memcpy(bytes, &((Member *)member)->state, sizeof(State));
    return sizeof(State);
}

int32_t appell_restore(void *member, const uint8_t *bytes, size_t length)
{
    if (length != sizeof(State)) return 1;
    __builtin_memcpy(&((Member *)member)->state, bytes, length);
    return 0;
}

/* It goes on from the pose and the speed of the model before it, its wheels turned as that one moved. */
int32_t appell_take_over(void *member, const double *outputs)
{
    Member *self = member;
    State *s = &self->state;
    s->x = outputs[0], s->y = outputs[1], s->yaw = outputs[2], s->speed = outputs[3];
    s->angle = fabs(s->speed) > 1e-3 ? wanted_angle(self->parameters, s->speed, outputs[5]) : 0.0;
    return 0;
}
