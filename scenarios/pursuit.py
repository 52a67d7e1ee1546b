"""Pure pursuit of the planned path: steer for a point of it some way ahead."""

import math

from appell_plugin import controller


@controller(
    inputs={"pose.x": "m", "pose.y": "m", "pose.yaw": "rad"},
    outputs={
        "command.forward": ("m/s", 0.0, 2.0),
        "command.yaw_rate": ("rad/s", -4.0, 4.0),
        "controller.ahead": "m",
    },
    parameters={"speed": (0.5, "m/s", 0.0, 2.0), "lookahead": (0.3, "m", 0.05, 2.0)},
)
def pursuit(now, inputs, parameters, memory):
    """Pure pursuit of the planned path."""
    path = now.context["path"]
    points, ds = path["points"], path["ds"]
    x, y, yaw = inputs["pose.x"], inputs["pose.y"], inputs["pose.yaw"]

    def distance(k):
        return math.hypot(points[k][0] - x, points[k][1] - y)

    last = len(points) - 1
    if "nearest" not in memory:
        # The path may cross itself: a point that also points where the robot does.
        def cost(k):
            turned = math.remainder(path["heading"][k] - yaw, math.tau)
            return distance(k) + 0.2 * abs(turned)

        memory["nearest"] = min(range(len(points)), key=cost)
        memory["speed"] = now.before["command.forward"] if now.before else 0.0
    nearest = memory["nearest"]
    while nearest < last and distance(nearest + 1) <= distance(nearest):
        nearest += 1
    memory["nearest"] = nearest

    ahead = min(last, nearest + max(1, round(parameters["lookahead"] / ds)))
    dx, dy = points[ahead][0] - x, points[ahead][1] - y
    bearing = math.remainder(math.atan2(dy, dx) - yaw, math.tau)
    left = (last - nearest) * ds
    # A speed that half the braking distance allows, reached gently.
    wanted = min(parameters["speed"], math.sqrt(2.0 * 0.4 * left)) * max(0.2, math.cos(bearing))
    change = 0.8 * now.dt
    memory["speed"] += min(max(wanted - memory["speed"], -change), change)
    curvature = 2.0 * math.sin(bearing) / max(math.hypot(dx, dy), 0.05)
    yaw_rate = min(max(curvature * memory["speed"], -3.0), 3.0)
    return {
        "command.forward": max(memory["speed"], 0.0),
        "command.yaw_rate": yaw_rate,
        "controller.ahead": left,
    }
