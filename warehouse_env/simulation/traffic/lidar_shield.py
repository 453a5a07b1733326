"""The shield by lidar alone: robots neither send nor receive messages.

All robots choose a motion at once, by what their own scanners see at that instant: a step as commanded, or a weaker
one, and a full stop. The motion runs if both rules allow it; otherwise the robot brakes along its current stop.

- *Seen*: two robots that see each other know each other's stop. Every point that the motion sweeps must be nearer to
  what the own stop sweeps than to what the other's stop sweeps. Both ensure this, so no point is swept by both.
- *Unseen*: an occluded robot reaches no point of the motion before the body has left it, provided that no point of it
  moves faster than any of this robot has moved, less what both could have braked since. Of two robots that are hidden
  from each other, the faster one is responsible for both. So a robot drives slowly past occlusions.

The proof that no robot then runs into another: docs/traffic.md.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from warehouse_env.kernel import inline, part, whole
from warehouse_env.simulation.physics import people
from warehouse_env.simulation.physics.contact import ACCELERATION, SPEED, STEER_RATE
from warehouse_env.simulation.physics.geometry import separation
from warehouse_env.simulation.physics.kinematics import braking
from warehouse_env.simulation.physics.stops import (
    BODY_COS,
    BODY_SIN,
    CENTRE_X,
    CENTRE_Y,
    MIDDLE_X,
    MIDDLE_Y,
    PACE,
    REACH,
    SAMPLES,
    SLACK,
    is_far_from_shelves,
    meets_shelf,
    outline_of,
    outline_trial,
    outlines_meet,
    sample,
    sampled,
)
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO
from warehouse_env.simulation.senses.scanners import Scanners, centre_of, scan, see_each_other
from warehouse_env.simulation.senses.sensing import TURNED
from warehouse_env.simulation.state import NOBODY
from warehouse_env.simulation.traffic import occlusion
from warehouse_env.simulation.traffic.shield import FREE, PERSON, SHELF, begin

UNSEEN, TOO_FAST = -4, -5  # what refuses a motion, beside those of shield.py
NOT_SEEN = -ONE
_TRIES = 4  # commands, each half as far from full braking as the one before
_ROOT_2 = np.float32(1.4142137)
_ARC = np.float32(1.05)  # of an arc to its chord, at most
_SPEED = np.float32(0.01)  # [m/s] of rounding


def scratch(count: int, scanners: Scanners | None) -> Any:
    """Return the scratch arrays of a world: of a scan (see sensing.scan_shelves), and of what is seen; None without
    scanners.
    """
    if scanners is None:
        return None
    rays = scanners.rays.shape[1]
    return np.empty((TURNED, rays), np.float32), occlusion.scratch(count, rays)


@inline
def _shift(a, n, b, m, paths, p):
    """Return at least how far [m] a point of the body is between two poses."""
    dx, dy = paths[a, n, CENTRE_X] - paths[b, m, CENTRE_X], paths[a, n, CENTRE_Y] - paths[b, m, CENTRE_Y]
    dc, ds = paths[a, n, BODY_COS] - paths[b, m, BODY_COS], paths[a, n, BODY_SIN] - paths[b, m, BODY_SIN]
    return np.sqrt(dx * dx + dy * dy) + p["radius"] * np.sqrt(dc * dc + ds * ds)


@inline
def _blur(row, n, paths, marks, p):
    """Return how far [m] any point is at most from where it is at sample n, half-way to the samples beside it."""
    most = ZERO
    if n > 0:
        most = _shift(row, n, row, n - 1, paths, p)
    if n + 1 < marks[SAMPLES, row]:
        most = max(most, _shift(row, n, row, n + 1, paths, p))
    return HALF * _ARC * most + p["blur"]


@part
def _shares(i, j, paths, outlines, marks, p):
    """Whether all that the motion on trial sweeps is nearer to what robot i's stop sweeps than to robot j's."""
    trial, pace = paths.shape[0] - 1, outlines[PACE, j]
    for n in range(marks[SAMPLES, trial]):
        beyond = np.float32(np.inf)
        for m in range(marks[SAMPLES, i]):
            beyond = min(beyond, _shift(trial, n, i, m, paths, p))
        blur, m = _blur(trial, n, paths, marks, p), 0
        while m < marks[SAMPLES, j]:
            gap = separation(sampled(trial, n, paths, p), sampled(j, m, paths, p))
            need = beyond + blur + blur + _blur(j, m, paths, marks, p) + SLACK
            if gap <= need:
                return False
            m += 1 if pace == ZERO else max(1, int((gap - _ROOT_2 * (need + pace)) / pace))
    return True


@inline
def _who_refuses(i, motion, field, sights, p):
    """Return a robot that i sees and would not keep its share from, FREE if there is none."""
    paths, outlines, marks, _ = field
    trial, gap = motion.shape[1], p["stride"] + p["stride"]
    outline = outline_of(trial, outlines)
    for j in range(motion.shape[1]):
        if sights[i, j] == NOT_SEEN or not outlines_meet(outline, trial, j, gap, outlines):
            continue
        for k in (i, j):
            if marks[SAMPLES, k] == 0:
                sample(whole(k), k, (ZERO, ZERO, np.int32(0)), motion, paths, outlines, marks, p)
        if not _shares(i, j, paths, outlines, marks, p):
            return j
    return FREE


@part
def commit(i, command, persons, wary, around, walking, p, floor):
    """Return what refuses robot i a command [m/s^2], [rad/s] for this physics step and the safe stop after it, or FREE.

    wary [m/s]: at least so fast comes who is hidden; around: (motion, field, sights, view). The motion's pace is
    left in the last of the outlines.
    """
    (acceleration, steer_rate), (motion, field, sights, view) = command, around
    paths, outlines, marks, _ = field
    trial, speed = motion.shape[1], motion[SPEED, i]
    marks[SAMPLES, trial], outlines[PACE, trial] = 0, ZERO
    if speed == ZERO and min(max(acceleration * p["dt"], p["min_speed"]), p["max_speed"]) == ZERO:
        return FREE
    outline_trial(i, acceleration, steer_rate, motion, outlines, p)
    sample(trial, i, (acceleration, steer_rate, p["substeps"]), motion, paths, outlines, marks, p)
    pace, samples = outlines[PACE, trial], marks[SAMPLES, trial]
    fastest = max(p["max_speed"], -p["min_speed"])
    if pace - p["blur"] > (fastest + _SPEED) * p["dt"]:
        return TOO_FAST
    if not is_far_from_shelves(trial, outlines, p, floor) and meets_shelf(trial, paths, outlines, marks, p, floor):
        return SHELF
    x, y, reach = outlines[MIDDLE_X, trial], outlines[MIDDLE_Y, trial], outlines[REACH, trial]
    fit, comes = min(p["half_length"], p["half_width"]), max((pace - p["blur"]) / p["dt"], wary)
    if walking is not None:
        fit, comes = min(fit, people.RADIUS), max(comes, people.PACE)
        if people.anybody_near(persons, x, y, reach, p) and people.could_meet(persons, paths[trial], samples, pace, p):
            return PERSON
    refuser = _who_refuses(i, motion, field, sights, p)
    grain = whole(occlusion.GRAINS[1] if abs(speed) <= occlusion.SLOW else occlusion.GRAINS[0])
    passage, looker = occlusion.Passage(paths[trial], samples, pace, comes), occlusion.Looker(i, motion, view, p, floor)
    if refuser == FREE and occlusion.could_come(passage, fit, grain, looker):
        return UNSEEN
    return refuser


@part
def _look(robots, persons, motion, places, sights, walking, p, floor):
    """Find which robots see each other, and raise the speed bound for robots that have just gone out of sight.

    sights float32[N, N]: as fast as j may become by the next look [m/s], if i sees it, or NOT_SEEN.
    """
    count, gain = motion.shape[1], p["max_acceleration"] * p["time_step"]
    fastest, reach = max(p["max_speed"], -p["min_speed"]), p["lidar_range"] + p["radius"] + p["radius"]
    for i in range(count):
        robots[i]["shield"]["occluded_speed_bound"] = max(robots[i]["shield"]["occluded_speed_bound"] - gain, ZERO)
    for i in range(count):
        x, y = centre_of(i, motion, p)
        for j in range(i + 1, count):
            other_x, other_y = centre_of(j, motion, p)
            dx, dy, had = other_x - x, other_y - y, sights[i, j] != NOT_SEEN
            if dx * dx + dy * dy < reach * reach and see_each_other(i, j, persons, motion, places, walking, p, floor):
                sights[i, j] = min((abs(motion[SPEED, j]) + gain) * p["point_speed_ratio"], fastest)
                sights[j, i] = min((abs(motion[SPEED, i]) + gain) * p["point_speed_ratio"], fastest)
            elif had:
                robots[i]["shield"]["occluded_speed_bound"] = max(
                    robots[i]["shield"]["occluded_speed_bound"], sights[i, j]
                )
                robots[j]["shield"]["occluded_speed_bound"] = max(
                    robots[j]["shield"]["occluded_speed_bound"], sights[j, i]
                )
                sights[i, j] = sights[j, i] = NOT_SEEN


@inline
def _open_eyes(i, persons, sights, scratch, walking, p, scanners):
    """Scan for robot i, and note the robots that it knows: itself, and those that see it."""
    motion, (turned, view) = scratch.motions[1], scratch.looks
    ranges, known, kinds, _, _, _ = view
    scan(i, persons, motion, scratch.places, walking, p, scanners, (turned, ranges))
    kinds[:] = occlusion.UNKNOWN
    count, n = motion.shape[1], 0
    for j in range(count):
        if j == i or sights[i, j] != NOT_SEEN:
            known[n] = j
            n += 1
    known[count] = n


@inline
def guard(robots, persons, sights, scratch, walking, p, floor, scanners):
    """Let the robots drive as `motion` commands, or as much of it as the shield allows; otherwise they brake."""
    motion, field, places, view = scratch.motions[1], scratch.guards, scratch.places, scratch.looks[1]
    around = motion, field, sights, view
    begin(motion, field, p, None)
    _look(robots, persons, motion, places, sights, walking, p, floor)
    for i in range(robots.shape[0]):
        r = robots[i]
        shield = r["shield"]
        acceleration, steer_rate = motion[ACCELERATION, i], motion[STEER_RATE, i]
        brake, refuser, share = braking(motion[SPEED, i], p), FREE, ONE
        if motion[SPEED, i] == ZERO and acceleration == ZERO:
            shield["vetoed_time"] = ZERO
            continue
        _open_eyes(i, persons, sights, scratch, walking, p, scanners)
        for _ in range(_TRIES):
            weaker = brake + share * (acceleration - brake)
            refuser = commit(
                i, (weaker, steer_rate), persons, shield["occluded_speed_bound"], around, walking, p, floor
            )
            if refuser == FREE or acceleration == brake:
                break
            share *= HALF
        if refuser == FREE:
            motion[ACCELERATION, i] = weaker
            shield["occluded_speed_bound"] = max(
                shield["occluded_speed_bound"], (field[1][PACE, motion.shape[1]] - p["blur"]) / p["dt"]
            )
            shield["vetoed_time"] = ZERO
            continue
        motion[ACCELERATION, i] = brake
        if motion[SPEED, i] != ZERO:
            motion[STEER_RATE, i] = ZERO
        shield["vetoed"] += 1
        shield["vetoed_time"] += p["time_step"]
        shield["vetoed_by"] = max(refuser, NOBODY)
