"""The protective field: a robot moves only where it could still stop without touching anything (ISO 3691-4).

Every robot has a committed motion at all times: at first its safe stop, full braking with the steering held, which
depends on its pose, speed and steering alone, never on a route or a goal. In each physics step the robots commit one
after another: a new motion, one step as commanded and then the safe stop from there, is taken if at equal times it
keeps `field_margin` from what all others have committed, and off the shelves; else the robot brakes within what it had
committed, which the others kept off. So by induction a safe stop for all exists after every step.

Motions are sampled at every substep, by the same arithmetic with which contact.py moves the bodies; where two have
come nearer than the margin already (put there by a user), a motion that brings them no nearer is taken.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.simulation.buckets import bucket_at
from warehouse_env.simulation.contact import ACCELERATION, COS, HEADING, SIN, SPEED, STEER, STEER_RATE, X, Y
from warehouse_env.simulation.footprint import body_room, body_touches_shelf
from warehouse_env.simulation.geometry import separation
from warehouse_env.simulation.kernel import inline, kernel
from warehouse_env.simulation.kinematics import braking, curvature, roll
from warehouse_env.simulation.trigonometry import HALF, ONE, ZERO, sin_cos

FREE, SHELF = -2, -1  # what refuses a motion: nothing, a shelf; else the index of a robot
NOBODY = -1  # in ROBOT's held_by
REST = np.float32(1e-6)  # [m/s] under which a stop is over: what rounding leaves of a speed
_ROOT_2 = np.float32(1.4142137)
# The field's arrays (see `scratch`). paths float32[N + 1, T, PLACE]: the body's centre and heading at each substep of
# the committed motions; the last row is that of the motion on trial.
CENTRE_X, CENTRE_Y, BODY_COS, BODY_SIN = range(4)
PLACE = 4
# bounds float32[BOUND, N + 1]: a circle around all that a motion sweeps [m], and how far any point of the body moves at
# most in one of its substeps [m].
MIDDLE_X, MIDDLE_Y, REACH, PACE = range(4)
BOUND = 4
# marks int32[MARK, N + 1]: samples of a path, 0 where it has not been needed yet; has the robot committed in this step?
SAMPLES, COMMITTED = 0, 1
MARK = 2


@inline
def scratch(count, p):  # type: ignore[no-untyped-def]
    """Return the arrays of a world's field: paths, bounds, marks, and the order int32[N] in which robots commit."""
    if p["field"] == 0:
        count = 0
    paths = np.empty((count + 1, p["stop_samples"], PLACE), np.float32)
    return (
        paths,
        np.empty((BOUND, count + 1), np.float32),
        np.empty((MARK, count + 1), np.int32),
        np.empty(count, np.int32),
    )


@inline
def rank(robots, ranks):  # type: ignore[no-untyped-def]
    """Write the robots' indices in the order of priority: longest on the way to its goal first, ties by index."""
    for i in range(robots.shape[0]):
        k = i
        while k > 0 and robots[ranks[k - 1]]["age"] < robots[i]["age"]:
            ranks[k] = ranks[k - 1]
            k -= 1
        ranks[k] = i


@inline
def begin(motion, field, p):  # type: ignore[no-untyped-def]
    """Begin a physics step: nobody has committed to more than its stop, of which only bounds are known."""
    _, bounds, marks, _ = field
    for i in range(motion.shape[1]):
        speed = motion[SPEED, i]
        way = (
            HALF * speed * speed / p["max_acceleration"]
            + HALF * p["max_acceleration"] * p["time_step"] * p["time_step"]
        )
        bounds[MIDDLE_X, i] = motion[X, i] - p["offset"] * motion[COS, i]
        bounds[MIDDLE_Y, i] = motion[Y, i] - p["offset"] * motion[SIN, i]
        bounds[REACH, i] = p["radius"] + (ZERO if speed == ZERO else way * p["swing"])
        marks[SAMPLES, i] = 0
        marks[COMMITTED, i] = 0


@kernel
def _sample(row, i, acceleration, steer_rate, commanded, motion, paths, bounds, marks, p):  # type: ignore[no-untyped-def]
    """Sample robot i's motion into a row of `paths`: `commanded` substeps at a command, then full braking."""
    x, y, heading, c, s = motion[X, i], motion[Y, i], motion[HEADING, i], motion[COS, i], motion[SIN, i]
    speed, steer, lock, dt = motion[SPEED, i], motion[STEER, i], p["max_steer"], p["dt"]
    offset, far = p["offset"], p["far"]
    left = right = x - offset * c
    low = high = y - offset * s
    paths[row, 0, CENTRE_X], paths[row, 0, CENTRE_Y], paths[row, 0, BODY_COS], paths[row, 0, BODY_SIN] = left, low, c, s
    bend = curvature(steer, p["wheelbase"])
    pace, n = ZERO, 0
    while n + p["substeps"] <= paths.shape[1]:
        if n >= commanded:
            if abs(speed) < REST:
                break
            acceleration, steer_rate = braking(speed, p), ZERO
        for _ in range(p["substeps"]):
            next_speed = min(max(speed + acceleration * dt, p["min_speed"]), p["max_speed"])
            next_steer = min(max(steer + steer_rate * dt, -lock), lock)
            if next_steer != steer or n == commanded:
                bend = curvature(HALF * (steer + next_steer), p["wheelbase"])
            if speed != ZERO or next_speed != ZERO:
                distance = HALF * (speed + next_speed) * dt
                x, y, heading = roll(x, y, heading, distance, bend)
                s, c = sin_cos(heading)
                pace = max(pace, abs(distance) * (ONE + far * abs(bend)))
            speed, steer = next_speed, next_steer
            cx, cy = x - offset * c, y - offset * s
            left, right, low, high = min(left, cx), max(right, cx), min(low, cy), max(high, cy)
            paths[row, n, CENTRE_X], paths[row, n, CENTRE_Y], paths[row, n, BODY_COS], paths[row, n, BODY_SIN] = (
                cx,
                cy,
                c,
                s,
            )
            n += 1
    wide, tall = HALF * (right - left), HALF * (high - low)
    bounds[MIDDLE_X, row], bounds[MIDDLE_Y, row] = left + wide, low + tall
    bounds[REACH, row] = np.sqrt(wide * wide + tall * tall) + p["radius"]
    bounds[PACE, row] = pace
    marks[SAMPLES, row] = max(n, 1)


@inline
def _know(i, motion, paths, bounds, marks, p):  # type: ignore[no-untyped-def]
    """Sample what robot i has committed, unless that has been done."""
    if marks[SAMPLES, i] == 0:
        _sample(i, i, ZERO, ZERO, 0, motion, paths, bounds, marks, p)


@inline
def _near(a, b, bounds, p):  # type: ignore[no-untyped-def]
    """Whether the circles around two motions are within the margin of each other."""
    dx, dy = bounds[MIDDLE_X, a] - bounds[MIDDLE_X, b], bounds[MIDDLE_Y, a] - bounds[MIDDLE_Y, b]
    reach = bounds[REACH, a] + bounds[REACH, b] + p["field_margin"]
    return dx * dx + dy * dy <= reach * reach


@kernel
def _least_separation(a, b, paths, bounds, marks, p):  # type: ignore[no-untyped-def]
    """Return the least separation [m] of two motions at equal times; one over the margin may not be the least.

    Substeps in which they cannot come within the margin are passed over: a separation is at least 0.7 of the distance.
    """
    half_length, half_width = p["half_length"], p["half_width"]
    most = bounds[PACE, a] + bounds[PACE, b]
    last_a, last_b = marks[SAMPLES, a] - 1, marks[SAMPLES, b] - 1
    last, n, least = max(last_a, last_b), 0, np.float32(np.inf)
    while n <= last:
        k, m = min(n, last_a), min(n, last_b)
        dx = paths[b, m, CENTRE_X] - paths[a, k, CENTRE_X]
        dy = paths[b, m, CENTRE_Y] - paths[a, k, CENTRE_Y]
        gap = separation(
            dx, dy, paths[a, k, BODY_COS], paths[a, k, BODY_SIN], paths[b, m, BODY_COS], paths[b, m, BODY_SIN],
            half_length, half_width,
        )  # fmt: skip
        least = min(least, gap)
        n += 1
        spare = gap - _ROOT_2 * p["field_margin"]
        if spare > most:
            n += last if most == ZERO else int(min(spare / most, np.float32(last)) * np.float32(0.999))
    return least


@kernel
def _meets_shelf(row, paths, bounds, marks, p, solid, clearance):  # type: ignore[no-untyped-def]
    """Whether the body touches a shelf anywhere along a motion."""
    half_length, half_width, cell, pace = p["half_length"], p["half_width"], p["cell"], bounds[PACE, row]
    n, count = 0, marks[SAMPLES, row]
    while n < count:
        cx, cy = paths[row, n, CENTRE_X], paths[row, n, CENTRE_Y]
        c, s = paths[row, n, BODY_COS], paths[row, n, BODY_SIN]
        room = body_room(cx, cy, c, s, half_length, half_width, clearance, cell)
        if room <= ZERO and body_touches_shelf(cx, cy, c, s, half_length, half_width, solid, clearance, cell):
            return True
        n += 1
        if room > pace:
            n += count if pace == ZERO else int(min(room / pace, np.float32(count)) * np.float32(0.999))
    return False


@kernel
def _who_refuses(i, trial, motion, field, places, p):  # type: ignore[no-untyped-def]
    """Return a robot whose committed motion the one on trial would come too near, FREE if there is none.

    Of several, one that has committed in this step already: those cannot be asked to make room.
    """
    paths, bounds, marks, _ = field
    order, starts, _ = places
    columns, found = p["bucket_columns"], FREE
    cx, cy = motion[X, i] - p["offset"] * motion[COS, i], motion[Y, i] - p["offset"] * motion[SIN, i]
    row, column = bucket_at(cx, cy, p)
    left, right = max(column - 1, 0), min(column + 2, columns)
    for by in range(max(row - 1, 0), min(row + 2, p["bucket_rows"])):
        for n in range(starts[by * columns + left], starts[by * columns + right]):
            j = order[n]
            if j == i or not _near(trial, j, bounds, p):
                continue
            _know(j, motion, paths, bounds, marks, p)
            if not _near(trial, j, bounds, p):
                continue
            least = _least_separation(trial, j, paths, bounds, marks, p)
            if least > p["field_margin"]:
                continue
            _know(i, motion, paths, bounds, marks, p)
            if least < _least_separation(i, j, paths, bounds, marks, p):
                if marks[COMMITTED, j] != 0:
                    return j
                found = j
    return found


@kernel
def commit(i, acceleration, steer_rate, motion, field, places, p, solid, clearance):  # type: ignore[no-untyped-def]
    """Have robot i commit to a command [m/s^2], [rad/s] for this physics step and the safe stop after it, if it may.

    Returns FREE where it has; else SHELF, or the index of a robot that is in the way, and what i had committed stands.
    May be called for any robot at any time between `begin` and the motion, also again with another command.
    """
    paths, bounds, marks, _ = field
    speed = motion[SPEED, i]
    if speed != ZERO or min(max(acceleration * p["dt"], p["min_speed"]), p["max_speed"]) != ZERO:
        trial = motion.shape[1]
        _sample(trial, i, acceleration, steer_rate, p["substeps"], motion, paths, bounds, marks, p)
        if _meets_shelf(trial, paths, bounds, marks, p, solid, clearance):
            return SHELF
        refuser = _who_refuses(i, trial, motion, field, places, p)
        if refuser != FREE:
            return refuser
        for n in range(marks[SAMPLES, trial]):
            for k in range(PLACE):
                paths[i, n, k] = paths[trial, n, k]
        bounds[:, i] = bounds[:, trial]
        marks[SAMPLES, i] = marks[SAMPLES, trial]
    marks[COMMITTED, i] = 1
    motion[ACCELERATION, i], motion[STEER_RATE, i] = acceleration, steer_rate
    return FREE


@inline
def hold(i, motion, field, p):  # type: ignore[no-untyped-def]
    """Have robot i stay with its stop."""
    marks = field[2]
    marks[COMMITTED, i] = 1
    motion[ACCELERATION, i], motion[STEER_RATE, i] = braking(motion[SPEED, i], p), ZERO


@inline
def guard(robots, motion, field, places, p, solid, clearance):  # type: ignore[no-untyped-def]
    """Let the robots commit, in the order of priority, to the commands that `motion` holds; who may not, brakes."""
    begin(motion, field, p)
    for i in field[3]:
        r = robots[i]
        refuser = commit(i, motion[ACCELERATION, i], motion[STEER_RATE, i], motion, field, places, p, solid, clearance)
        if refuser == FREE:
            r["held_time"] = ZERO
            continue
        hold(i, motion, field, p)
        r["held"] += 1
        r["held_time"] += p["time_step"]
        r["held_by"] = max(refuser, NOBODY)


@inline
def settle(robots):  # type: ignore[no-untyped-def]
    """End the stops: no speed that is nothing but rounding is left after a physics step."""
    for i in range(robots.shape[0]):
        if abs(robots[i]["speed"]) < REST:
            robots[i]["speed"] = ZERO
