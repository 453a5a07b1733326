"""Arrival where robots stop at their goals: coming to rest at the end of the route, and the test for being there.

Used only if `EnvConfig.arrival` is not "pass". A goal is a point (goal_x, goal_y) and a heading; nan allows any. The
event `arrived` says that the robot stands, so its service can begin in the same step.
"""

import numpy as np

from warehouse_env.kernel import inline
from warehouse_env.simulation.driver.line import to_go
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO, sin_cos, wrap

RESTS = np.float32(0.01)  # [m] before the end of its route at which a robot may rest
STILL = np.float32(0.01)  # [m/s] under which it stands
BRAKING = np.float32(0.9)  # share of the full deceleration that stops are planned with
_TWO, _FIVE = np.float32(2.0), np.float32(5.0)
_FARTHEST = np.float32(4.0)  # times 5 m: the largest distance at which a goal is observed


@inline
def speed_before(way, at_end, speed, p):
    """Return the speed [m/s] of the next physics step that still allows `at_end` [m/s] after `way` [m]."""
    brake = BRAKING * p["max_acceleration"]
    lag = HALF * brake * p["time_step"]
    left = max(way - HALF * abs(speed) * p["time_step"], ZERO)
    return np.sqrt(lag * lag + at_end * at_end + _TWO * brake * left) - lag


@inline
def speed_on_line(r, p):
    """Return the most speed [m/s] along the route from which a robot rests at its end; a docked robot stays there."""
    if r["manoeuvre"]["docks"] != 0 or to_go(r) <= RESTS:
        return ZERO
    return speed_before(to_go(r), ZERO, max(r["motion"]["speed"], ZERO), p)


@inline
def docks_from(r):
    """Whether a robot's next manoeuvre leads to its goal: near it on its route, at its end, or docked beside it."""
    return r["manoeuvre"]["docks"] != 0 or to_go(r) <= max(r["manoeuvre"]["join"], RESTS)


@inline
def wants_to_dock(r):
    """Whether a robot that follows its route is to seek the manoeuvre to its goal: near it, or at rest beside it."""
    rests = r["manoeuvre"]["docks"] != 0 or to_go(r) <= RESTS
    return r["motion"]["speed"] == ZERO if rests else to_go(r) <= r["manoeuvre"]["join"]


@inline
def stands_at(task, x, y, heading, speed, p):
    """Whether a robot at a pose and a speed [m/s] stands at its goal, within the radius and the angle asked for."""
    dx, dy, turn = task["goal_x"] - x, task["goal_y"] - y, heading - task["goal_heading"]
    within = p["arrival_radius"] if np.isnan(turn) else p["pose_radius"]
    if dx * dx + dy * dy > within * within or abs(speed) > STILL:
        return False
    return not abs(wrap(turn)) > p["arrival_angle"]  # nan: any heading will do


@inline
def is_there(r, p):
    """Whether a robot stands at its goal."""
    motion = r["motion"]
    return stands_at(r["task"], motion["x"], motion["y"], motion["heading"], motion["speed"], p)


@inline
def observe(r, p, row, at):
    """Write the slice `goal` (see observation_layout), if there is one, from row[at] on."""
    motion, task = r["motion"], r["task"]
    if at is None:
        return
    dx, dy = task["goal_x"] - motion["x"], task["goal_y"] - motion["y"]
    row[at] = min(max((dx * motion["cos"] + dy * motion["sin"]) / _FIVE, -_FARTHEST), _FARTHEST)
    row[at + 1] = min(max((dy * motion["cos"] - dx * motion["sin"]) / _FIVE, -_FARTHEST), _FARTHEST)
    turn = wrap(task["goal_heading"] - motion["heading"])
    row[at + 2] = row[at + 3] = ZERO
    if not np.isnan(turn):
        row[at + 3], row[at + 2] = sin_cos(turn)
    stop = HALF * motion["speed"] * abs(motion["speed"]) / (BRAKING * p["max_acceleration"])
    row[at + 4] = ONE if to_go(r) <= stop + RESTS else ZERO
