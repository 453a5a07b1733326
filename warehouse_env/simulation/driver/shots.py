"""Shots: a Reeds-Shepp curve from a pose to exact poses, used whole if the body can drive it.

Of all curve words (routes/reeds_shepp.py) at several turning radii, the quickest drivable one is taken, at the prices
of the manoeuvre search (turning.py). The shortest curve turns at full lock, and its steering jumps cost more time than
a wider turn.
"""

import numpy as np

from warehouse_env.kernel import part
from warehouse_env.routes.reeds_shepp import TURNS, WORDS, seen_from, word
from warehouse_env.simulation.driver.bodies import arc_is_free
from warehouse_env.simulation.driver.line import to_steering
from warehouse_env.simulation.driver.scratch import HEADING, SHOT, X, Y
from warehouse_env.simulation.driver.turning import BACKWARD_SPEED, FORWARD_SPEED, LOCK_SHARE, change_time
from warehouse_env.simulation.physics.geometry import pose_at
from warehouse_env.simulation.physics.kinematics import arc_end, curvature
from warehouse_env.simulation.physics.trigonometry import ZERO

RADII = (1.3, 2.0, 3.5)  # times the least radius: what is left of the steering keeps a robot on its arcs
_STRAIGHT_SPEED = np.float32(1.2)  # [m/s] that straight pieces are priced by
_GRAIN = 1e-4  # [m] to which arcs are rounded: the same on machines whose sines differ in the last bit
_LEAST = np.float32(1e-3)  # [m] of an arc


@part
def _seconds(n, lengths, radius, steer, p):
    """Return the seconds [s] that the segments of word n take; steer [rad]: the steering angle before."""
    seconds, last = ZERO, ZERO
    for k in range(SHOT):
        length = np.float32(lengths[k])
        if abs(length) < _LEAST:
            continue
        bend = np.float32(TURNS[n, k] / radius)
        wanted = to_steering(bend, p["wheelbase"], p["max_steer"])
        speed = BACKWARD_SPEED
        if length > ZERO:
            speed = FORWARD_SPEED if bend != ZERO else _STRAIGHT_SPEED
        seconds += abs(length) / speed + change_time(last, steer, length, wanted, p)
        last, steer = length, wanted
    return seconds


@part
def _is_free(n, lengths, radius, pose, margin, around):
    """Whether the body keeps clear of shelves and bodies along word n from a Pose."""
    p = around.p
    for k in range(SHOT):
        length = np.float32(lengths[k])
        if abs(length) < _LEAST:
            continue
        bend = curvature(to_steering(np.float32(TURNS[n, k] / radius), p["wheelbase"], p["max_steer"]), p["wheelbase"])
        if not arc_is_free(pose, bend, length, margin, around):
            return False
        x, y, heading = arc_end(pose.x, pose.y, pose.heading, length, bend)
        pose = pose_at(x, y, heading)
    return True


@part
def shoot(pose, steer, goals, margin, most, around, arcs):
    """Write the soonest free curve from a Pose to one of goals float32[G, GOAL] into arcs float32[SHOT, 2].

    steer [rad]: steering angle at the start; margin [m]: kept from shelves; around: SearchArea; most [s]: only faster
    curves are considered. Returns (number of arcs, seconds), -1 arcs if no curve is free.
    """
    count, least, p = -1, most, around.p
    sharpest = abs(curvature(LOCK_SHARE * p["max_steer"], p["wheelbase"]))
    for g in range(goals.shape[0]):
        ahead, left, turn = seen_from(
            np.float64(pose.x), np.float64(pose.y), np.float64(pose.heading),
            np.float64(goals[g, X]), np.float64(goals[g, Y]), np.float64(goals[g, HEADING]),
        )  # fmt: skip
        for share in RADII:
            radius = share / np.float64(sharpest)
            for n in range(WORDS):
                length, a, b, c, d, e = word(n, ahead, left, turn, radius)
                if length >= least * _STRAIGHT_SPEED:
                    continue
                lengths = (a, b, c, d, e)
                seconds = _seconds(n, lengths, radius, steer, p)
                if seconds >= least or not _is_free(n, lengths, radius, pose, margin, around):
                    continue
                count, least = 0, seconds
                for k in range(SHOT):
                    way = lengths[k]
                    if abs(way) >= _LEAST:
                        arcs[count, 0] = np.float32(np.rint(way / _GRAIN) * _GRAIN)
                        arcs[count, 1] = to_steering(np.float32(TURNS[n, k] / radius), p["wheelbase"], p["max_steer"])
                        count += 1
    return count, least
