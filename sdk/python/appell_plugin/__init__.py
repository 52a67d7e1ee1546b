"""Controllers for Appell in Python: one function in one file.

    from appell_plugin import controller

    @controller(
        inputs={"pose.x": "m", "pose.y": "m", "pose.yaw": "rad"},
        outputs={"command.forward": ("m/s", -1.0, 1.0), "command.yaw_rate": "rad/s"},
        parameters={"speed": (0.5, "m/s"), "gain": 2.0},
    )
    def circle(now, inputs, parameters, memory):
        return {"command.forward": parameters["speed"], "command.yaw_rate": 0.5}

A scenario names the file; Appell starts it with ``python3 -m appell_plugin FILE``. Units are SI, frames those
of REP-103. What is printed goes to the terminal.
"""

import math
from dataclasses import dataclass, field
from typing import Any, Callable, Optional

__all__ = ["Controller", "Now", "controller"]

#: Version of the messages between Appell and a plug-in.
PROTOCOL = 1


@dataclass
class Now:
    """The instant of a step.

    ``t`` and ``dt``: time and length of the step, s. ``context``: where the controller is, as plain data
    with the keys ``robot``, ``period``, ``step``, ``seed``, ``trial``, ``arena``, ``task``, ``pose`` and
    ``platform`` of the scenario, and ``path``, the way that Appell plans for the task (``None`` where there
    is none): ``points`` every ``ds`` metres, with their ``heading`` and ``curvature``. ``before``: at the first step of a controller that took over from another, what that
    one wrote last, by name; else ``None``.
    """

    t: float = 0.0
    dt: float = 0.0
    context: dict = field(default_factory=dict)
    before: Optional[dict] = None


@dataclass
class Controller:
    """A function with its ports; what :func:`controller` makes."""

    step: Callable
    descriptor: dict
    start: Optional[Callable]

    def __call__(self, *arguments: Any) -> Any:
        return self.step(*arguments)


#: Those of the file that is served.
registered: list = []


def controller(
    *,
    inputs: dict,
    outputs: dict,
    parameters: Optional[dict] = None,
    start: Optional[Callable] = None,
    name: str = "",
    version: str = "",
    about: str = "",
) -> Callable:
    """Makes a function a controller.

    ``inputs``: name to unit. ``outputs``: name to unit, or to (unit, least, largest). ``parameters``: name to
    default, or to (default, unit), or to (default, unit, least, largest). The function takes ``now``
    (:class:`Now`), ``inputs`` and ``parameters`` (numbers by name) and ``memory``, a dictionary of its own
    that lasts from step to step; plain data in it (texts for keys, lists rather than
    tuples) can be saved and restored. It returns the outputs, by
    name or in their order. ``start(context, parameters)``, if given, makes the memory.
    """

    def make(step: Callable) -> Controller:
        about_lines = (about or (step.__doc__ or "")).strip().splitlines()
        descriptor = {
            "protocol": PROTOCOL,
            "name": name or step.__name__,
            "version": version,
            "about": about_lines[0] if about_lines else "",
            "inputs": [{"name": key, "unit": unit} for key, unit in inputs.items()],
            "outputs": [_output(key, what) for key, what in outputs.items()],
            "parameters": [_parameter(key, what) for key, what in (parameters or {}).items()],
        }
        made = Controller(step, descriptor, start)
        registered.append(made)
        return made

    return make


def _output(name: str, what: Any) -> dict:
    if isinstance(what, str):
        return {"name": name, "unit": what}
    unit, least, largest = what
    return {"name": name, "unit": unit, **_limits(least, largest)}


def _limits(least: Any, largest: Any) -> dict:
    """Limits that are finite; there are no others in JSON."""
    limits = {"min": float(least), "max": float(largest)}
    return {key: limit for key, limit in limits.items() if not math.isinf(limit)}


def _parameter(name: str, what: Any) -> dict:
    if not isinstance(what, (tuple, list)):
        return {"name": name, "default": float(what)}
    parameter = {"name": name, "default": float(what[0])}
    if len(what) > 1:
        parameter["unit"] = what[1]
    if len(what) > 2:
        parameter.update(_limits(what[2], what[3]))
    return parameter
