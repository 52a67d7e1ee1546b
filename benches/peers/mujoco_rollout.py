#!/usr/bin/env python3
# SPDX-License-Identifier: MIT OR Apache-2.0
"""The same kind of robot in MuJoCo: a platform on two driven wheels and a caster.

Run it on one core:

    taskset -c 0 python3 mujoco_rollout.py
"""

import argparse
import json
import statistics
import time

import mujoco
import numpy as np
from mujoco import rollout

STEP = 1e-3
RADIUS, HALF_TRACK, EMF, INDUCTANCE = 0.05, 0.15, 1.0, 1.2e-3
VOLTAGE = np.array([6.0, 5.0])

# A wheel's own mass, small, since the platform has the rest; the inertia of wheel and
# motor about the axle comes as the joint's armature.
WHEEL_MASS = 0.05
WHEEL_INERTIA = 0.4 * WHEEL_MASS * RADIUS**2

# What a robot on a plane has no use for. Warm starts are off as well: a single iteration
# from the unconstrained acceleration rolls closer to the closed form than one from the
# last step's.
UNUSED = (
    "warmstart equality frictionloss limit spring damper clampctrl filterparent midphase "
    "refsafe sensor eulerdamp autoreset island"
).split()


def parameters(k):
    """Masses, inertias, resistance and torque constant of robot k, as in c/fleet_common.h."""
    vary_mass = 1 + 0.02 * np.sin(k)
    return {
        "mass": 9.6 * vary_mass,
        "mass_eff": 10.4 * vary_mass,
        "inertia_eff": 0.16 * (1 + 0.02 * np.sin(k + 1)),
        "resistance": 1.2 * (1 + 0.02 * np.sin(k + 2)),
        "torque": 0.8 * (1 + 0.02 * np.sin(k + 3)),
    }


def robot(k, integrator, solver):
    """The MJCF of robot k, its bodies such that it has the effective inertias when rolling."""
    of = parameters(k)
    spin = (of["mass_eff"] - of["mass"]) / 2 * RADIUS**2
    platform = of["mass"] - 2 * WHEEL_MASS
    ahead = of["mass"] * 0.05 / platform
    yaw = (
        of["inertia_eff"]
        - platform * ahead**2
        - 2 * (WHEEL_MASS * HALF_TRACK**2 + WHEEL_INERTIA)
        - 2 * spin * (HALF_TRACK / RADIUS) ** 2
    )
    # MuJoCo's motor has one constant for torque and back-EMF. Voltage, resistance and
    # inductance times torque / EMF make it the motor with two.
    torque = of["torque"]
    motor = (
        f'motorconst="{torque} {torque}" resistance="{of["resistance"] * torque / EMF}" '
        f'inductance="{INDUCTANCE * torque / EMF} 0"'
    )
    flags = " ".join(f'{name}="disable"' for name in UNUSED)
    # A wheel touches the plane with a sphere, the cheapest shape with one contact point.
    wheel = "\n".join(
        f"""<body name="{name}" pos="0 {side * HALF_TRACK} 0">
          <joint name="{name}" axis="0 1 0" armature="{spin - WHEEL_INERTIA}"/>
          <inertial pos="0 0 0" mass="{WHEEL_MASS}"
            diaginertia="{WHEEL_INERTIA} {WHEEL_INERTIA} {WHEEL_INERTIA}"/>
          <geom name="{name}" type="sphere" size="{RADIUS}"/>
        </body>"""
        for name, side in (("left", 1), ("right", -1))
    )
    # Contacts are listed pair by pair, without a search for them. The wheels are as
    # stiff as the step allows and the caster is without friction.
    return f"""<mujoco>
      <option timestep="{STEP}" integrator="{integrator}" solver="{solver}" iterations="1"
        ls_iterations="1" cone="pyramidal"><flag {flags}/></option>
      <default><geom contype="0" conaffinity="0"/><pair solref="0.002 1"/></default>
      <worldbody>
        <geom name="floor" type="plane" size="0 0 1"/>
        <body name="platform" pos="0 0 {RADIUS}">
          <freejoint/>
          <inertial pos="{ahead} 0 0" mass="{platform}"
            diaginertia="{0.6 * yaw} {0.7 * yaw} {yaw}"/>
          <geom name="caster" type="sphere" size="0.02" pos="0.2 0 {0.02 - RADIUS}" mass="0"/>
          {wheel}
        </body>
      </worldbody>
      <contact>
        <pair geom1="floor" geom2="left" condim="3"/>
        <pair geom1="floor" geom2="right" condim="3"/>
        <pair geom1="floor" geom2="caster" condim="1"/>
      </contact>
      <actuator><dcmotor joint="left" {motor}/><dcmotor joint="right" {motor}/></actuator>
    </mujoco>"""


def closed_form(k, steps):
    """x of the robots k rolling without slip, by the equations of the other peers."""
    of = parameters(k)

    def rate(y):
        _, theta, v, w, i_l, i_r = y
        moment = of["mass"] * 0.05
        tau_l, tau_r = of["torque"] * i_l, of["torque"] * i_r
        phi_l, phi_r = (v - HALF_TRACK * w) / RADIUS, (v + HALF_TRACK * w) / RADIUS
        turn = HALF_TRACK * (tau_r - tau_l) / RADIUS
        return np.array(
            [
                v * np.cos(theta),
                w,
                ((tau_l + tau_r) / RADIUS + moment * w * w) / of["mass_eff"],
                (turn - moment * v * w) / of["inertia_eff"],
                (VOLTAGE[0] - of["resistance"] * i_l - EMF * phi_l) / INDUCTANCE,
                (VOLTAGE[1] - of["resistance"] * i_r - EMF * phi_r) / INDUCTANCE,
            ]
        )

    y = np.zeros((6, len(k)))
    for _ in range(steps):
        k1 = rate(y)
        k2 = rate(y + STEP / 2 * k1)
        k3 = rate(y + STEP / 2 * k2)
        k4 = rate(y + STEP * k3)
        y = y + STEP / 6 * (k1 + 2 * (k2 + k3) + k4)
    return y[0]


def measure(peer, integrator, solver, robots, steps, rounds):
    numbers = np.arange(robots)
    models = [mujoco.MjModel.from_xml_string(robot(k, integrator, solver)) for k in numbers]
    # One MjData: the rollout stays on the calling thread.
    data = mujoco.MjData(models[0])
    size = mujoco.mj_stateSize(models[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    start = np.zeros((robots, size))
    mujoco.mj_getState(models[0], data, start[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    start[:] = start[0]
    control = np.empty((robots, steps, 2))
    control[:] = parameters(numbers)["torque"][:, None, None] / EMF * VOLTAGE
    # Allocated once, so that no round pays for fresh pages.
    states = np.zeros((robots, steps, size))
    seconds = []
    for _ in range(rounds):
        begin = time.perf_counter()
        rollout.rollout(models, data, start, control, nstep=steps, state=states)
        seconds.append(time.perf_counter() - begin)
    # The state begins with the time; x is the first of the positions.
    x = states[:, -1, 1]
    expected = closed_form(numbers, steps)
    million = 1e-6 * robots * steps
    line = {
        "peer": peer,
        "robots": robots,
        "steps": steps,
        "Msteps_per_s": round(million / min(seconds), 4),
        "median": round(million / statistics.median(seconds), 4),
        "check": float(x[0]),
        "off_closed_form": float(f"{np.max(np.abs(x - expected) / expected):.2g}"),
    }
    print(json.dumps(line), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", type=int, default=16)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--solver", choices=("CG", "Newton", "PGS"), default="CG")
    args = parser.parse_args()
    for integrator in ("Euler", "RK4"):
        peer = f"mujoco-{integrator.lower()}"
        measure(peer, integrator, args.solver, args.robots, args.steps, args.rounds)


if __name__ == "__main__":
    main()
