"""Slalom: follows the planned path by its curvature, and corrects what it is off.

    appell run slalom.toml

Python needs no building; `pip install ./sdk/python`, where `appell` is not run in the checkout. The law is
that of Samson: the path turns the robot, the distance from it and the angle to it correct. The speed is what
the curves ahead allow.
"""

import math

from appell_plugin import controller


@controller(
    inputs={"pose.x": "m", "pose.y": "m", "pose.yaw": "rad"},
    outputs={
        "command.forward": ("m/s", 0.0, 2.0),
        "command.yaw_rate": ("rad/s", -4.0, 4.0),
        "controller.beside": "m",
        "controller.left": "m",
    },
    parameters={
        "speed": (0.8, "m/s", 0.05, 2.0),
        "acceleration": (0.6, "m/s²", 0.05, 5.0),
        "lateral_acceleration": (0.8, "m/s²", 0.05, 5.0),
        "gain": (4.0, "1/m", 0.1, 20.0),
    },
    version="1.0",
)
def slalom(now, inputs, parameters, memory):
    """Follows the planned path by its curvature, and corrects what it is off."""
    path = now.context["path"]
    points, heading, curvature, ds = path["points"], path["heading"], path["curvature"], path["ds"]
    x, y, yaw = inputs["pose.x"], inputs["pose.y"], inputs["pose.yaw"]
    last = len(points) - 1

    def distance(k):
        return math.hypot(points[k][0] - x, points[k][1] - y)

    if "nearest" not in memory:
        # The path may cross itself: a point that also points where the robot does.
        def cost(k):
            return distance(k) + 0.2 * abs(math.remainder(heading[k] - yaw, math.tau))

        memory["nearest"] = min(range(last + 1), key=cost)
        memory["speed"] = min(max(now.before["command.forward"], 0.0), 2.0) if now.before else 0.0
    here = memory["nearest"]
    while here < last and distance(here + 1) <= distance(here):
        here += 1
    memory["nearest"] = here

    # To the left of the path, and turned to the left of it.
    dx, dy = x - points[here][0], y - points[here][1]
    beside = math.cos(heading[here]) * dy - math.sin(heading[here]) * dx
    turned = math.remainder(yaw - heading[here], math.tau)
    left = (last - here) * ds

    # As fast as it can still be slow enough in the curves ahead, and stop at the end.
    brake = 0.5 * parameters["acceleration"]
    wanted = min(parameters["speed"], math.sqrt(2.0 * brake * left))
    for k in range(here, min(last, here + round(1.5 / ds)) + 1, 4):
        curve = parameters["lateral_acceleration"] / max(abs(curvature[k]), 1e-3)
        wanted = min(wanted, math.sqrt(curve + 2.0 * brake * (k - here) * ds))
    wanted *= max(0.1, math.cos(turned))
    change = parameters["acceleration"] * now.dt
    memory["speed"] += min(max(wanted - memory["speed"], -change), change)
    speed = memory["speed"]

    gain = parameters["gain"]
    along = math.cos(turned) / max(1.0 - curvature[here] * beside, 0.2)
    bent = math.sin(turned) / turned if turned else 1.0
    turn = speed * (curvature[here] * along - gain * gain * beside * bent - 2.0 * gain * turned)
    return {
        "command.forward": max(speed, 0.0),
        "command.yaw_rate": min(max(turn, -3.0), 3.0),
        "controller.beside": beside,
        "controller.left": left,
    }
