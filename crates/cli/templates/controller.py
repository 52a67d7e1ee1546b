"""A controller to start from: drives to the beacon of the task and stops beside it."""

import math

from appell_plugin import controller


@controller(
    # What it reads: signals of the robot's motion and sensors, with their units.
    inputs={"pose.x": "m", "pose.y": "m", "pose.yaw": "rad"},
    # What it writes, and within which limits: more is a fault.
    outputs={
        "command.forward": ("m/s", -1.0, 1.0),
        "command.yaw_rate": ("rad/s", -2.0, 2.0),
        "controller.distance": "m",  # a signal of its own, recorded like any other
    },
    # Numbers that a scenario, --set and a batch can change: default, unit, least, largest.
    parameters={"speed": (0.6, "m/s", 0.0, 1.0), "gain": (2.0, "1/s", 0.0, 10.0)},
)
def homing(now, inputs, parameters, memory):
    """Turns to the beacon and drives to it."""
    task = now.context["task"]
    beacons = now.context["arena"]["beacon"]
    x, y = next(b["position"] for b in beacons if b["name"] == task["beacon"])
    dx, dy = x - inputs["pose.x"], y - inputs["pose.y"]
    left = math.hypot(dx, dy) - 0.9 * task["distance"]
    bearing = math.remainder(math.atan2(dy, dx) - inputs["pose.yaw"], math.tau)

    # `memory` lasts from step to step. One that takes over from another begins at its speed.
    if now.before is not None:
        memory["speed"] = now.before["command.forward"]
    # Speed up gently; brake so as to stop in time.
    wanted = 0.0
    if abs(bearing) < 0.5 and left > 0.0:
        wanted = min(parameters["speed"], math.sqrt(2.0 * 0.3 * left))
    last = memory.get("speed", 0.0)
    change = 0.6 * now.dt
    memory["speed"] = last + min(max(wanted - last, -change), change)
    turn = min(max(parameters["gain"] * bearing, -1.2), 1.2)
    return {
        "command.forward": memory["speed"],
        "command.yaw_rate": turn if left > 0.02 else 0.0,
        "controller.distance": left,
    }
