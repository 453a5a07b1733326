"""Arriving where robots stop at their goals: how one comes to rest at its route's end, and when it is there.

Only for `EnvConfig.arrival` other than "pass". A robot's goal is a point (goal_x, goal_y) and a heading, nan for any.
The event `arrived` then says that the robot stands: what is done to it at its goal can begin in the same step.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import inline
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO, sin_cos, wrap

RESTS = np.float32(0.01)  # [m] before the end of its route at which a robot may rest
STILL = np.float32(0.01)  # [m/s] under which it stands
_BRAKING = np.float32(0.9)  # share of the full deceleration that stops are planned with
_TWO, _FIVE = np.float32(2.0), np.float32(5.0)
_FARTHEST = np.float32(4.0)  # times 5 m that a goal is seen away at most


@inline
def to_go(r):
    """Return the metres left of a robot's route."""
    return np.float32(max(r["points"] - 1, 0)) * r["spacing"] - r["position"]


@inline
def speed_before(way, speed, p):
    """Return the speed [m/s] after the next physics step from which a robot at `speed` stops within `way` [m]."""
    if way <= RESTS:
        return ZERO
    brake = _BRAKING * p["max_acceleration"]
    lag = HALF * brake * p["time_step"]
    left = max(way - HALF * max(speed, ZERO) * p["time_step"], ZERO)
    return np.sqrt(lag * lag + _TWO * brake * left) - lag


@inline
def is_there(r, p):
    """Whether a robot stands at its goal, as near and as well turned as it has to."""
    dx, dy = r["goal_x"] - r["x"], r["goal_y"] - r["y"]
    if dx * dx + dy * dy > p["arrival_radius"] * p["arrival_radius"] or abs(r["speed"]) > STILL:
        return False
    return not abs(wrap(r["heading"] - r["goal_heading"])) > p["arrival_angle"]  # nan: any heading will do


@inline
def observe(r, p, row, at):
    """Write the slice `goal` (see observation_layout) from row[at] on."""
    dx, dy = r["goal_x"] - r["x"], r["goal_y"] - r["y"]
    row[at] = min(max((dx * r["cos"] + dy * r["sin"]) / _FIVE, -_FARTHEST), _FARTHEST)
    row[at + 1] = min(max((dy * r["cos"] - dx * r["sin"]) / _FIVE, -_FARTHEST), _FARTHEST)
    turn = wrap(r["goal_heading"] - r["heading"])
    row[at + 2] = row[at + 3] = ZERO
    if not np.isnan(turn):
        row[at + 3], row[at + 2] = sin_cos(turn)
    stop = HALF * r["speed"] * abs(r["speed"]) / (_BRAKING * p["max_acceleration"])
    row[at + 4] = ONE if to_go(r) <= stop + RESTS else ZERO
