"""Occlusion: could a hidden robot reach the body at any time of a motion?

The point of that robot which would touch the body is not seen now, and no farther away than it can move in that time.
It belongs to a body that fits into the unseen floor: near it is a disc of the body's width that no ray crosses and that
gets around the shelves in time. Both are looked for on a lattice, at its resolution.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, part
from warehouse_env.simulation.physics.contact import COS, SIN
from warehouse_env.simulation.physics.discs import is_taken
from warehouse_env.simulation.physics.floor import FINE, UNIT
from warehouse_env.simulation.physics.footprint import clearance_at
from warehouse_env.simulation.physics.people import distance_to_body
from warehouse_env.simulation.physics.stops import BODY_COS, BODY_SIN, CENTRE_X, CENTRE_Y
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO
from warehouse_env.simulation.senses.scanners import SCANNERS, centre_of, sees_all, sees_disc

SIDE = 112  # places of a window's side; everything beyond counts as hidden
GRAINS = (FINE, 2 * FINE)  # places to a cell's side, for robots faster than SLOW [m/s] and for others
SLOW = np.float32(0.5)
UNKNOWN, SHELF, SEEN, HIDDEN = np.uint8(0), np.uint8(1), np.uint8(2), np.uint8(3)
_POINTS = 128  # that are not seen and could come; of more, it is not told which
_FINE, _UNIT = np.float32(FINE), np.float32(UNIT)
_ROOT_2, _ROOT_HALF = np.float32(1.4142137), np.float32(0.70710678)
_STRAIGHT = np.float32(0.9238)  # of a way from place to place to the way as the crow flies, at the least


class Looker(NamedTuple):
    """The robot that may drive a motion only if nobody hidden could come into its way."""

    i: Any  # its number
    motion: Any  # float32[MOTION, N], where all robots are (contact.py)
    seen: Any  # see scratch; kinds are filled in as they are asked for
    p: Any  # PARAMETERS
    floor: Any


class Passage(NamedTuple):
    """A motion of its body, and the speed of a hidden robot."""

    path: Any  # float32[T + 1, PLACE]
    samples: Any
    pace: Any  # [m], the most that any point of the body moves in a substep
    speed: Any  # [m/s], of the fastest point of a hidden robot


class LatticeWindow(NamedTuple):
    """The part of the lattice that is looked at."""

    step: Any  # [m] from place to place
    top: Any  # its first row
    left: Any  # and column
    fit: Any  # [m], radius of a disc that is in any body


def scratch(count: int, rays: int) -> tuple[NDArray[Any], ...]:
    """Return what one robot sees: ranges float32[SCANNERS, R] [m], known robots int32[N + 1] (the last: how many); of a
    window of the lattice kinds uint8, ways left over float32 [m] and a queue int32; and points float32[2, _POINTS] [m].
    """
    places = SIDE * SIDE
    return (
        np.empty((SCANNERS, rays), np.float32),
        np.empty(count + 1, np.int32),
        np.empty(places, np.uint8),
        np.empty(places, np.float32),
        np.empty(places, np.int32),
        np.empty((2, _POINTS), np.float32),
    )


@inline
def _is_known(x, y, within, motion, view, p):
    """Whether a point is in the body of a known robot, or within so many metres of it."""
    known = view[1]
    for n in range(known[known.shape[0] - 1]):
        j = known[n]
        cx, cy = centre_of(j, motion, p)
        if distance_to_body(x, y, cx, cy, motion[COS, j], motion[SIN, j], p) <= within:
            return True
    return False


@inline
def _kind(row, column, window, looker):
    """Return the kind of a place of the lattice, looked at once."""
    (step, top, left, fit), (i, motion, view, p, floor) = window, looker
    ranges, kinds = view[0], view[2]
    at = (row - top) * SIDE + column - left
    kind = kinds[at]
    if kind != UNKNOWN:
        return kind
    slack = _ROOT_HALF * step
    x, y = (np.float32(column) + HALF) * step, (np.float32(row) + HALF) * step
    inside = x > ZERO and y > ZERO and int(y / p["cell"] * _FINE) < floor.clearance.shape[0]
    inside = inside and int(x / p["cell"] * _FINE) < floor.clearance.shape[1]
    room = clearance_at(x, y, floor) + _UNIT + _ROOT_2 * p["cell"] / _FINE  # at most, of a point there
    kind = SHELF
    if inside and room >= fit:
        seen = sees_disc(x, y, fit - slack, i, motion, p, ranges)
        kind = SEEN if seen or _is_known(x, y, fit - slack, motion, view, p) else HIDDEN
    kinds[at] = kind
    return kind


@inline
def _meets(x, y, passage, speed, contact, p):
    """Return the last sample of a motion at which the body is within `contact` [m] of a robot from a point at a speed
    [m/s], on the straight way, 0 if at none.
    """
    path, pace = passage.path, passage.pace
    n = passage.samples - 1
    while n > 0:
        gap = distance_to_body(
            x, y, path[n, CENTRE_X], path[n, CENTRE_Y], path[n, BODY_COS], path[n, BODY_SIN], p
        ) - contact - speed * np.float32(n) * p["dt"]  # fmt: skip
        if gap <= ZERO:
            return n
        n -= max(1, int(gap / pace))
    return 0


@part
def _list_points(box, step, passage, looker):
    """Write the points that may be unseen and could come to the body in time; return how many, _POINTS if too many."""
    i, motion, view, p, floor = looker
    ranges, points, count, slack = view[0], view[5], 0, _ROOT_HALF * step
    contact = slack + passage.pace + p["max_acceleration"] * p["time_step"] * p["time_step"]
    for row in range(box[0], box[1] + 1):
        for column in range(box[2], box[3] + 1):
            x, y = (np.float32(column) + HALF) * step, (np.float32(row) + HALF) * step
            if x < ZERO or y < ZERO or _meets(x, y, passage, passage.speed, contact, p) == 0:
                continue
            if is_taken(x, y, floor):
                continue
            if not _is_known(x, y, ZERO, motion, view, p) and not sees_all(x, y, slack, i, motion, p, ranges):
                points[0, count], points[1, count] = x, y
                count += 1
                if count == _POINTS:
                    return count
    return count


@inline
def _box(reach, window, passage, looker):
    """Return the first and last row and column within reach [m] of a motion's bodies, in the window."""
    (step, top, left, _), path, samples, p = window, passage.path, passage.samples, looker.p
    cx, cy = centre_of(looker.i, looker.motion, p)
    low_x, high_x, low_y, high_y = cx, cx, cy, cy
    for n in range(samples):
        low_x, high_x = min(low_x, path[n, CENTRE_X]), max(high_x, path[n, CENTRE_X])
        low_y, high_y = min(low_y, path[n, CENTRE_Y]), max(high_y, path[n, CENTRE_Y])
    around = reach + p["radius"]
    return (
        max(int((low_y - around) / step), top),
        min(int((high_y + around) / step) + 1, top + SIDE - 1),
        max(int((low_x - around) / step), left),
        min(int((high_x + around) / step) + 1, left + SIDE - 1),
    )


@inline
def _is_near(x, y, within, points, count):
    """Whether one of the points is within so many metres, or there are too many to tell."""
    if count == _POINTS:
        return True
    for n in range(count):
        dx, dy = points[0, n] - x, points[1, n] - y
        if dx * dx + dy * dy <= within * within:
            return True
    return False


@part
def could_come(passage, fit, grain, looker):
    """Whether a hidden robot could be where a robot's body will be, at any time of a motion.

    fit: see LatticeWindow; grain: one of GRAINS.
    """
    (i, motion, view, p, _), (_, samples, pace, speed) = looker, passage
    left_over, queue, points = view[3], view[4], view[5]
    step = p["cell"] / np.float32(grain)
    slack, gain = _ROOT_HALF * step, p["max_acceleration"] * p["time_step"] * p["time_step"]
    far = min(p["half_length"], p["half_width"]) * _ROOT_2
    cx, cy = centre_of(i, motion, p)
    top, left = int(cy / step) - SIDE // 2, int(cx / step) - SIDE // 2
    window = LatticeWindow(step, top, left, fit)
    comes = speed * np.float32(samples) * p["dt"] + gain
    box = _box(comes + slack + pace, window, passage, looker)
    count = _list_points(box, step, passage, looker)
    if count == 0:
        return False
    contact = far + slack + pace  # of the disc's centre, on all the way from the sample before
    box = _box(contact, window, passage, looker)
    tail = 0
    left_over[:] = -ONE
    for row in range(box[0], box[1] + 1):
        for column in range(box[2], box[3] + 1):
            x, y = (np.float32(column) + HALF) * step, (np.float32(row) + HALF) * step
            n = _meets(x, y, passage, ZERO, contact, p)
            if n == 0:
                continue
            kind = _kind(row, column, window, looker)
            if kind == HIDDEN and _is_near(x, y, far + slack + slack, points, count):
                return True
            if kind != SHELF:
                at = (row - top) * SIDE + column - left
                left_over[at] = speed * np.float32(n) * p["dt"] + gain + slack + slack
                queue[tail] = at
                tail += 1
    return _comes_out(tail, count, contact + gain, window, passage, looker)


@part
def _comes_out(tail, count, contact, window, passage, looker):
    """Whether a hidden place near one of `count` points is no farther from a place in the queue, up to `tail`, than
    what is left over there [m]; a place is looked at again where more is left over than before.
    """
    (step, top, left, _), view, p = window, looker.seen, looker.p
    left_over, queue, points = view[3], view[4], view[5]
    straight, head, size = step * _STRAIGHT, 0, queue.shape[0]
    across = straight * _ROOT_2
    near = min(p["half_length"], p["half_width"]) * _ROOT_2 + _ROOT_2 * step
    while head != tail:
        at = queue[head]
        head = (head + 1) % size
        row, column, here = at // SIDE + top, at % SIDE + left, left_over[at]
        if here < straight:
            continue
        for r in range(row - 1, row + 2):
            for c in range(column - 1, column + 2):
                if r < top or r >= top + SIDE or c < left or c >= left + SIDE:
                    return True
                to, rest = (r - top) * SIDE + c - left, here - (across if r != row and c != column else straight)
                if rest < ZERO or rest <= left_over[to]:
                    continue
                kind = _kind(r, c, window, looker)
                if kind == SHELF:
                    continue
                if kind == HIDDEN:
                    x, y = (np.float32(c) + HALF) * step, (np.float32(r) + HALF) * step
                    if _meets(x, y, passage, passage.speed, contact, p) == 0:
                        continue
                    if _is_near(x, y, near, points, count):
                        return True
                left_over[to] = rest
                queue[tail] = to
                tail = (tail + 1) % size
                if tail == head:
                    return True
    return False
