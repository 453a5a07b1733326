"""The shield: a robot makes only motions from which it can still stop without touching anything (ISO 3691-4).

Every robot always has a committed motion. Initially that is its safe stop: full braking at the present steering angle,
which depends on pose, speed and steering alone. In each physics step the robots commit in turn. A new motion is one
step as commanded and the safe stop from there. It is accepted if it stays clear of the shelves and keeps `field_margin`
from all committed motions at equal times; otherwise the robot brakes within its committed motion, which the others
avoid. By induction a safe stop for all robots exists after every step. Where people walk, the stop must also be over
before a person could reach where it ends, wherever they walk (physics/people.py).

Motions are sampled at every substep by the arithmetic with which contact.py moves the bodies, and swept between samples
where they could touch (sweep.py). If two robots are already nearer than the margin (placed there by a user), a motion
that brings them no nearer is accepted.

A robot whose messages are lost brakes along the stop that it published last, which the others expect
(senses/messages.py).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, part, whole
from warehouse_env.simulation.physics import people
from warehouse_env.simulation.physics.buckets import bucket_at
from warehouse_env.simulation.physics.contact import ACCELERATION, COS, HEADING, SIN, SPEED, STEER, STEER_RATE, X, Y
from warehouse_env.simulation.physics.kinds import kind_of
from warehouse_env.simulation.physics.kinematics import braking, curvature
from warehouse_env.simulation.physics.stops import (
    COMMITTED,
    MARK,
    MIDDLE_X,
    MIDDLE_Y,
    OUTLINE,
    PACE,
    PLACE,
    REACH,
    REST,
    SAMPLES,
    SLACK,
    draw_outline,
    is_far_from_shelves,
    least_separation,
    meets_shelf,
    outline_of,
    outline_trial,
    outlines_meet,
    sample,
    stopping_distance,
)
from warehouse_env.simulation.physics.trigonometry import ZERO
from warehouse_env.simulation.state import NOBODY

LONG_HELD = np.float32(5.0)  # [s] at which the observation saturates
PERSON, FREE, SHELF = -3, -2, -1  # what refuses a motion: a person, nothing, a shelf; else the index of a robot


def scratch(count: int, p: Any) -> tuple[NDArray[Any], ...]:
    """Return the shield's arrays of a world: paths, outlines, marks, and the order int32[N] in which robots commit."""
    if p["field"] == 0:
        count = 0
    paths = np.empty((count + 1, p["stop_samples"] + 1, PLACE), np.float32)
    return (
        paths,
        np.empty((OUTLINE, count + 1), np.float32),
        np.empty((MARK, count + 1), np.int32),
        np.empty(count, np.int32),
    )


@inline
def begin(motion, field, p, kinds):
    """Begin a physics step: every robot is committed to its stop; only its outline is computed."""
    _, outlines, marks, _ = field
    for i in range(motion.shape[1]):
        x, y, heading, c, s = motion[X, i], motion[Y, i], motion[HEADING, i], motion[COS, i], motion[SIN, i]
        speed, bend, own = motion[SPEED, i], ZERO, kind_of(i, p, kinds)
        if speed != ZERO:
            bend = curvature(motion[STEER, i], own["wheelbase"])
        way = stopping_distance(speed, own)
        draw_outline(i, (x, y, heading, c, s), way, bend, (ZERO, ZERO), outlines, own)
        marks[SAMPLES, i] = 0
        marks[COMMITTED, i] = 0


@inline
def _know(i, motion, paths, outlines, marks, p):
    """Sample the committed motion of robot i, unless that is done already."""
    if marks[SAMPLES, i] == 0:
        commanded = p["substeps"] if marks[COMMITTED, i] != 0 else np.int32(0)
        acceleration, steer_rate = motion[ACCELERATION, i], motion[STEER_RATE, i]
        sample(whole(i), i, (acceleration, steer_rate, commanded), motion, paths, outlines, marks, p)


@inline
def _who_refuses(i, command, around, p, kinds):
    """Return a robot whose committed motion is too near to the motion on trial, or FREE.

    Of several, prefer one that has committed in this step: it cannot be asked to make room. p: of robot i.
    """
    (acceleration, steer_rate), (motion, field, places) = command, around
    paths, outlines, marks, _ = field
    order, starts, _ = places
    trial, columns, found, gap = motion.shape[1], p["bucket_columns"], FREE, p["field_margin"] + SLACK
    outline = outline_of(trial, outlines)
    row, column = bucket_at(motion[X, i] - p["offset"] * motion[COS, i], motion[Y, i] - p["offset"] * motion[SIN, i], p)
    left, right = max(column - 1, 0), min(column + 2, columns)
    for by in range(max(row - 1, 0), min(row + 2, p["bucket_rows"])):
        for n in range(starts[by * columns + left], starts[by * columns + right]):
            j = order[n]
            if j == i or not outlines_meet(outline, trial, j, gap, outlines):
                continue
            if marks[SAMPLES, trial] == 0:
                sample(trial, i, (acceleration, steer_rate, p["substeps"]), motion, paths, outlines, marks, p)
            other = kind_of(j, p, kinds)
            _know(j, motion, paths, outlines, marks, other)
            least = least_separation(trial, j, paths, outlines, marks, p, other)
            if least > p["field_margin"]:
                continue
            _know(i, motion, paths, outlines, marks, p)
            if least < least_separation(whole(i), j, paths, outlines, marks, p, other):
                if marks[COMMITTED, j] != 0:
                    return j
                found = j
    return found


@inline
def _publish(i, trial, paths, outlines, marks):
    """Publish the motion on trial as robot i's committed motion."""
    for n in range(marks[SAMPLES, trial]):
        for k in range(PLACE):
            paths[i, n, k] = paths[trial, n, k]
    for k in range(OUTLINE):
        outlines[k, i] = outlines[k, trial]
    marks[SAMPLES, i] = marks[SAMPLES, trial]


@part
def commit(i, command, persons, around, walking, p, kinds, floor):
    """Commit robot i to a command [m/s^2], [rad/s] for this physics step and the safe stop after it, if allowed.

    Returns FREE if it is; otherwise SHELF, PERSON, or the index of the robot in the way, and the earlier commitment
    holds. around: (motion, field, places), the scratch arrays; p: its own; kinds: of all robots (kinds.py). May be
    called for any robot between `begin` and the motion, also again with another command.
    """
    (acceleration, steer_rate), (motion, field, _) = command, around
    paths, outlines, marks, _ = field
    trial, speed = motion.shape[1], motion[SPEED, i]
    if speed != ZERO or min(max(acceleration * p["dt"], p["min_speed"]), p["max_speed"]) != ZERO:
        marks[SAMPLES, trial] = 0
        outline_trial(i, acceleration, steer_rate, motion, outlines, p)
        if not is_far_from_shelves(trial, outlines, floor):
            sample(trial, i, (acceleration, steer_rate, p["substeps"]), motion, paths, outlines, marks, p)
            if meets_shelf(trial, paths, outlines, marks, p, floor):
                return SHELF
        x, y, reach = outlines[MIDDLE_X, trial], outlines[MIDDLE_Y, trial], outlines[REACH, trial]
        if walking is not None and people.anybody_near(persons, x, y, reach, p):
            if marks[SAMPLES, trial] == 0:
                sample(trial, i, (acceleration, steer_rate, p["substeps"]), motion, paths, outlines, marks, p)
            if people.could_meet(persons, paths[trial], marks[SAMPLES, trial], outlines[PACE, trial], p):
                return PERSON
        refuser = _who_refuses(i, command, around, p, kinds)
        if refuser != FREE:
            return refuser
        _publish(i, trial, paths, outlines, marks)
    marks[COMMITTED, i] = 1
    motion[ACCELERATION, i], motion[STEER_RATE, i] = acceleration, steer_rate
    return FREE


@inline
def hold(i, motion, field, p):
    """Let robot i keep its committed stop. A standing robot may steer, which moves neither it nor its stop."""
    marks = field[2]
    marks[COMMITTED, i] = 1
    motion[ACCELERATION, i] = braking(motion[SPEED, i], p)
    if motion[SPEED, i] != ZERO:
        motion[STEER_RATE, i] = ZERO


@inline
def guard(robots, persons, scratch, guarded, walking, vehicles, floor):
    """Let the robots commit, in the order of priority, to the commands in `motion`; the others brake."""
    if guarded is None:
        return
    (p, kinds), motion, field = vehicles, scratch.motions[1], scratch.guards
    around = motion, field, scratch.places
    begin(motion, field, p, kinds)
    for i in field[3]:
        r, own = robots[i], kind_of(i, p, kinds)
        shield = r["shield"]
        refuser = FREE
        if shield["silent"] == 0 and shield["off_plan"] == 0:
            command = motion[ACCELERATION, i], motion[STEER_RATE, i]
            refuser = commit(i, command, persons, around, walking, own, kinds, floor)
            if refuser == FREE:
                shield["vetoed_time"] = ZERO
                continue
        hold(i, motion, field, own)
        shield["vetoed"] += 1
        shield["vetoed_time"] += p["time_step"]
        shield["vetoed_by"] = max(refuser, NOBODY)


@inline
def settle(robots, guarded):
    """Set speeds that are only rounding to zero after a physics step under the shield."""
    if guarded is None:
        return
    for i in range(robots.shape[0]):
        if abs(robots[i]["motion"]["speed"]) < REST:
            robots[i]["motion"]["speed"] = ZERO


@inline
def observe(r, p, row, at):
    """Write the slice `field` from row[at] on, if there is one: how often and how long the shield has vetoed."""
    if at is None:
        return
    row[at] = np.float32(r["shield"]["vetoed"]) / np.float32(p["repeat"])
    row[at + 1] = min(r["shield"]["vetoed_time"], LONG_HELD) / LONG_HELD
