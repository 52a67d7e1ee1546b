#!/usr/bin/env python3
# SPDX-License-Identifier: MIT OR Apache-2.0
"""The fleet in JAX: one robot's step, vmap over robots, fori_loop over steps, jit.

Run it on one core:

    taskset -c 0 python3 jax_rk4.py
"""

import argparse
import json
import os
import statistics
import time

# Both are read when JAX starts, hence before the import.
os.environ.setdefault(
    "XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
)
os.environ.setdefault("JAX_PLATFORMS", "cpu")

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

STEP = 1e-3
# The first robots of every fleet, over which the second check takes its mean.
CHECKED = 1024


def fleet(robots):
    """The folded constants of each robot, as in c/fleet_common.h."""
    k = np.arange(robots, dtype=np.float64)
    radius, half_track, ahead = 0.05, 0.15, 0.05
    emf, inductance, left, right = 1.0, 1.2e-3, 6.0, 5.0
    vary_mass = 1 + 0.02 * np.sin(k)
    mass, mass_eff = 9.6 * vary_mass, 10.4 * vary_mass
    inertia_eff = 0.16 * (1 + 0.02 * np.sin(k + 1))
    resistance = 1.2 * (1 + 0.02 * np.sin(k + 2))
    torque = 0.8 * (1 + 0.02 * np.sin(k + 3))
    every = np.ones(robots)
    return {
        "pull": torque / (radius * mass_eff),
        "swing": mass * ahead / mass_eff,
        "turn": half_track * torque / (radius * inertia_eff),
        "drag": mass * ahead / inertia_eff,
        "decay": resistance / inductance,
        "back_v": emf / (radius * inductance) * every,
        "back_w": emf * half_track / (radius * inductance) * every,
        "u_l": left / inductance * every,
        "u_r": right / inductance * every,
    }


def angle_rate(of, state):
    _, _, theta, v, w, i_l, i_r = state
    return (
        v * jnp.cos(theta),
        v * jnp.sin(theta),
        w,
        of["pull"] * (i_l + i_r) + of["swing"] * w * w,
        of["turn"] * (i_r - i_l) - of["drag"] * v * w,
        of["u_l"] - of["decay"] * i_l - of["back_v"] * v + of["back_w"] * w,
        of["u_r"] - of["decay"] * i_r - of["back_v"] * v - of["back_w"] * w,
    )


def unit_rate(of, state):
    """The heading as a unit vector (c, s) instead of an angle."""
    _, _, c, s, v, w, i_l, i_r = state
    _, _, _, *rest = angle_rate(of, (0.0, 0.0, 0.0, v, w, i_l, i_r))
    return (v * c, v * s, -w * s, w * c, *rest)


def ahead(state, h, rate):
    return tuple(a + h * d for a, d in zip(state, rate))


def rk4(rate, of, y, h):
    k1 = rate(of, y)
    k2 = rate(of, ahead(y, h / 2, k1))
    k3 = rate(of, ahead(y, h / 2, k2))
    k4 = rate(of, ahead(y, h, k3))
    return tuple(
        a + h / 6 * (d1 + 2 * (d2 + d3) + d4) for a, d1, d2, d3, d4 in zip(y, k1, k2, k3, k4)
    )


def angle_step(of, y, h):
    return rk4(angle_rate, of, y, h)


def unit_step(of, y, h):
    x, y_, c, s, *rest = rk4(unit_rate, of, y, h)
    # One Newton step towards length one.
    norm = 1.5 - 0.5 * (c * c + s * s)
    return (x, y_, c * norm, s * norm, *rest)


ANGLE_START = (0.0,) * 7
UNIT_START = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def rollout(step, start, steps):
    def one_robot(of):
        # The step size and the start take the precision of the coefficients.
        h = jnp.asarray(STEP, of["pull"].dtype)
        y = tuple(jnp.asarray(a, of["pull"].dtype) for a in start)
        return jax.lax.fori_loop(0, steps, lambda _, y: step(of, y, h), y)

    return jax.jit(jax.vmap(one_robot))


def measure(peer, step, start, dtype, robots, width, steps, rounds):
    of = {name: jnp.asarray(a, dtype) for name, a in fleet(robots).items()}
    options = {"xla_cpu_prefer_vector_width": width}
    run = rollout(step, start, steps).lower(of).compile(compiler_options=options)
    seconds = []
    for _ in range(rounds):
        begin = time.perf_counter()
        x = jax.block_until_ready(run(of))[0]
        seconds.append(time.perf_counter() - begin)
    million = 1e-6 * robots * steps
    return {
        "peer": peer,
        "robots": robots,
        "steps": steps,
        "Msteps_per_s": round(million / min(seconds), 3),
        "median": round(million / statistics.median(seconds), 3),
        "check": float(x[0]),
        "check_mean": float(np.mean(np.asarray(x[:CHECKED], np.float64))),
        "vector_width": width,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", type=int, nargs="+", default=[1024, 2048, 4096])
    parser.add_argument("--widths", type=int, nargs="+", default=[256, 512])
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=8)
    args = parser.parse_args()
    for heading, step, start in (
        ("", angle_step, ANGLE_START),
        ("-unit", unit_step, UNIT_START),
    ):
        for dtype in ("float64", "float32"):
            peer = f"jax{heading}-f{dtype[-2:]}"
            # Which batch and which vectors are best depends on the variant and on the
            # processor: the best of all is reported.
            lines = [
                measure(peer, step, start, dtype, robots, width, args.steps, args.rounds)
                for robots in args.robots
                for width in args.widths
            ]
            print(json.dumps(max(lines, key=lambda line: line["Msteps_per_s"])), flush=True)


if __name__ == "__main__":
    main()
