"""Noise in what robots do, put in from outside between two steps of a Simulator: its kernels know nothing of it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import kernel
from warehouse_env.simulation.physics.footprint import body_touches_shelf
from warehouse_env.simulation.physics.geometry import body_of, rectangles_touch
from warehouse_env.simulation.physics.trigonometry import sin_cos, wrap
from warehouse_env.simulation.simulator import Simulator


class Noise(NamedTuple):
    """Standard deviations of normal errors in each env step."""

    command: float  # of the change of speed and of steering, relative: acceleration and steering rate are off by that
    slip: float  # [m] of the place along and across, for each metre driven
    turn: float  # [rad] of the heading, for each metre driven


@kernel
def _touches(robots, i, x, y, heading, p, floor):
    """Whether robot i would touch a shelf or another robot at a pose."""
    s, c = sin_cos(heading)
    body = body_of(x, y, c, s, p)
    if body_touches_shelf(body, floor):
        return True
    for j in range(robots.shape[0]):
        o = robots[j]
        if j != i and rectangles_touch(
            body, body_of(o["motion"]["x"], o["motion"]["y"], o["motion"]["cos"], o["motion"]["sin"], p)
        ):
            return True
    return False


@kernel
def _move(robots, moves, p, floor):
    """Move robots ROBOT[N] by float32[N, 3] (x [m], y [m], heading [rad]), who would touch not; return how many."""
    touches = 0
    for i in range(robots.shape[0]):
        r = robots[i]
        motion = r["motion"]
        x, y, heading = motion["x"] + moves[i, 0], motion["y"] + moves[i, 1], wrap(motion["heading"] + moves[i, 2])
        if _touches(robots, i, x, y, heading, p, floor):
            touches += 1
            continue
        motion["x"], motion["y"], motion["heading"] = x, y, heading
        motion["sin"], motion["cos"] = sin_cos(heading)
    return touches


def slip(simulator: Simulator, before: NDArray[Any], noise: Noise, rng: np.random.Generator) -> int:
    """Add noise to the last env step of a Simulator's first world; return how many robots it made touch something.

    before: ROBOT[1, N], the robots before the step. Who stands does not slip.
    """
    if not any(noise):
        return 0
    robots, limits = simulator.robots[0], simulator.config.robot
    motion = robots["motion"]
    for name, low, high in (
        ("speed", limits.min_speed, limits.max_speed),
        ("steer", -limits.max_steering, limits.max_steering),
    ):
        off = noise.command * rng.standard_normal(len(robots)) * (motion[name] - before[0]["motion"][name])
        motion[name] = np.where(motion["speed"] != 0, np.clip(motion[name] + off, low, high), motion[name])
    sizes = np.array([noise.slip, noise.slip, noise.turn])
    moves = (rng.standard_normal((len(robots), 3)) * sizes * simulator.events.driven[0][:, None]).astype(np.float32)
    floor = simulator._floor
    return int(_move(robots, moves, simulator._params[0], floor))
