"""PIBT over motion primitives of car-like bodies: one decision of all robots of a world.

A primitive is a speed and a steering angle that the robot goes for during one decision; a stop at that steering
follows. A robot may take it if the body, driven so, meets no shelf and no other's committed motion; what it can always
fall back on is to stop, which the decision before kept free.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import kernel
from warehouse_env.simulation.physics import kinematics
from warehouse_env.simulation.physics.floor import Floor
from warehouse_env.simulation.physics.footprint import body_touches_shelf
from warehouse_env.simulation.physics.geometry import Rectangle, rectangles_touch, squared_distance
from warehouse_env.simulation.physics.kinematics import Chassis, approach
from warehouse_env.simulation.physics.trigonometry import sin_cos

X, Y, COS, SIN = 0, 1, 2, 3  # of the body's centre
DT = 0.05  # [s] between the poses of a motion: the simulator's substep, at whose ends it looks for contacts
HOLD = 4  # DT for which a command stands
POSES = 52  # of a motion: a decision of a second, and braking from 1.5 m/s
MARGIN = 0.02  # [m] between bodies, and to shelves,
LEAST = 0.002  # [m] but this for who stands nearer, as at a start beside the rim
NEAR = 5.0  # [m] beyond which no two motions meet
UNDECIDED, CHOOSING, CHOSEN = 0, 1, 2  # of a robot
_roll_on = kinematics.drive

Floats = NDArray[np.float64]


class Given(NamedTuple):
    """What a decision is made from: the robots of one world, and what they may do."""

    poses: Floats  # [N, 3], x, y [m] and heading [rad] of the front axles
    speeds: Floats  # [N]
    steers: Floats  # [N]
    commands: Floats  # [K, 2], speed and steering of each primitive
    keys: Floats  # [N, K], less is better
    floor: Floor
    body: Floats  # half length, half width [m]
    limits: Floats  # acceleration, steering rate, wheelbase, axle to centre
    decision: int  # DT of a decision


class _Made(NamedTuple):
    """What has been decided so far."""

    state: NDArray[np.int8]  # [N], UNDECIDED, CHOOSING or CHOSEN
    choice: NDArray[np.int64]  # [N], a primitive, -1: stop
    motions: Floats  # [N, POSES, 4], of the undecided the stop
    stops: Floats  # [N, POSES, 4]


@kernel
def drive(pose, speed, steer, goal_speed, goal_steer, decision, limits, motion):
    """Write the motion float64[POSES, 4]: a decision of so many steps of DT, or of none at all, then the stop.

    A stop's last command is weaker, so that it ends at rest.
    pose: x, y, heading of the front axle; limits: acceleration, steering rate, wheelbase, axle to centre.
    """
    x, y, heading = pose[0], pose[1], pose[2]
    chassis = Chassis(limits[2], 0.0, 0.0, 0.0)  # of which rolling asks for no limits
    steps = max(decision, 1)
    change = approach(0.0, goal_speed - speed, limits[0] * DT * decision) / steps
    turn = approach(0.0, goal_steer - steer, limits[1] * DT * decision) / steps
    for k in range(POSES):
        if k >= decision and (k - decision) % HOLD == 0:
            change, turn = approach(0.0, -speed / HOLD, limits[0] * DT), 0.0
        x, y, heading = _roll_on((x, y, heading), speed, speed + change, steer, steer + turn, chassis, DT)
        speed += change
        steer += turn
        s, c = sin_cos(heading)
        motion[k, X], motion[k, Y] = x - limits[3] * c, y - limits[3] * s
        motion[k, COS], motion[k, SIN] = c, s


@kernel
def meet(one, two, half_length, half_width, margin):
    """Whether two motions float64[POSES, 4] come nearer than `margin` [m] at any time."""
    reach = 2.0 * np.hypot(half_length, half_width) + margin
    wide, long = half_width + 0.5 * margin, half_length + 0.5 * margin
    for k in range(POSES):
        body = Rectangle(one[k, X], one[k, Y], one[k, COS], one[k, SIN], long, wide)
        other = Rectangle(two[k, X], two[k, Y], two[k, COS], two[k, SIN], long, wide)
        if squared_distance(body, other) <= reach * reach and rectangles_touch(body, other):
            return True
    return False


@kernel
def meets_shelf(motion, half_length, half_width, margin, floor):
    """Whether a motion comes nearer than `margin` [m] to a shelf of a Floor."""
    for k in range(POSES):
        x, y, c, s = motion[k, X], motion[k, Y], motion[k, COS], motion[k, SIN]
        body = Rectangle(x, y, c, s, half_length + margin, half_width + margin)
        if body_touches_shelf(body, floor):
            return True
    return False


@kernel
def _too_near(motion, stop, other, other_stop, body):
    """Whether two motions come nearer than MARGIN, or than LEAST if the robots' stops do."""
    if not meet(motion, other, body[0], body[1], MARGIN):
        return False
    return not meet(stop, other_stop, body[0], body[1], MARGIN) or meet(motion, other, body[0], body[1], LEAST)


@kernel
def _is_near(given, i, j):
    return np.hypot(given.poses[i, 0] - given.poses[j, 0], given.poses[i, 1] - given.poses[j, 1]) <= NEAR


@kernel
def _is_free(given, made, i, motion):
    """Whether a motion of robot i keeps clear of those who are choosing or have chosen."""
    for j in range(made.state.size):
        if j == i or made.state[j] == UNDECIDED or not _is_near(given, i, j):
            continue
        if _too_near(motion, made.stops[i], made.motions[j], made.stops[j], given.body):
            return False
    return True


@kernel
def _fall_back(given, made, i):
    """Let robot i stop, and those as well that have chosen a motion which counts on its moving away."""
    stop = made.stops[i]
    made.state[i], made.choice[i], made.motions[i] = CHOSEN, -1, stop
    for j in range(made.state.size):
        if made.state[j] != CHOSEN or made.choice[j] < 0:
            continue
        if _too_near(stop, stop, made.motions[j], made.stops[j], given.body):
            _fall_back(given, made, j)


@kernel
def _decide(given, made, i):
    """Choose robot i's primitive, the best that meets nobody who has decided; who bars it is asked to decide first.

    False: it falls back on its stop. It calls itself, and no other that calls it: kept on disk, those crash (Numba).
    """
    length, width = given.body[0], given.body[1]
    margin = LEAST if meets_shelf(made.stops[i], length, width, MARGIN, given.floor) else MARGIN
    made.state[i] = CHOOSING
    motion = np.empty((POSES, 4))
    for k in np.argsort(given.keys[i]):
        speed, steer = given.commands[k, 0], given.commands[k, 1]
        drive(given.poses[i], given.speeds[i], given.steers[i], speed, steer, given.decision, given.limits, motion)
        if meets_shelf(motion, length, width, margin, given.floor) or not _is_free(given, made, i, motion):
            continue
        made.motions[i], made.choice[i] = motion, k
        leave = True
        for j in range(made.state.size):  # who is in the way decides first, and must leave its place
            asked = leave and made.state[j] == UNDECIDED and _is_near(given, i, j)
            if asked and _too_near(motion, made.stops[i], made.motions[j], made.stops[j], given.body):
                leave = _decide(given, made, j)
        if leave and _is_free(given, made, i, motion):  # some may have fallen back
            made.state[i] = CHOSEN
            return True
    _fall_back(given, made, i)
    return False


@kernel
def decide_all(given, order):
    """Return each robot's primitive int64[N], -1: stop; order int64[N]: first the highest priority."""
    n = given.speeds.size
    stops = np.empty((n, POSES, 4))
    for i in range(n):
        drive(given.poses[i], given.speeds[i], given.steers[i], 0.0, given.steers[i], 0, given.limits, stops[i])
    made = _Made(np.full(n, UNDECIDED, np.int8), np.full(n, -1, np.int64), stops.copy(), stops)
    for i in order:
        if made.state[i] == UNDECIDED:
            _decide(given, made, i)
    return made.choice
