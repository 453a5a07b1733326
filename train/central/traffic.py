"""The routes of all robots in time, and the meetings of another piece of a route with them.

Time is cut into slots of one second. A meeting is a pair of a slot and a robot that comes nearer than the margin within
the slot. Two checks are never further apart than the time in which the bodies' fastest points could close the gap
(conservative advancement; Mirtich 1996), so no meeting is missed.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from train.central.floor import point_speed
from warehouse_env.kernel import inline, kernel, part
from warehouse_env.routes.reeds_shepp import rolled
from warehouse_env.simulation.physics.geometry import Rectangle, separation

BEGIN, X, Y, HEADING, RATE, BEND, END = range(7)  # columns of a piece: times [s], where it begins, how it is driven
PIECE = 7
_DRIFT = 0.51  # that a body's middle moves in half a slot, at the most


class RoutePiece(NamedTuple):
    """A piece of a route, its fields in the order of the columns."""

    begin: float  # [s]
    x: float  # where it begins
    y: float
    heading: float
    rate: float
    bend: float  # curvature
    end: float  # [s]


class Traffic(NamedTuple):
    """The routes of N robots; a robot stays at the end of its route."""

    pieces: Any  # float64[N, P, PIECE]
    counts: Any  # int32[N], pieces of each; 0: the robot is left out
    first: Any  # int32[S, N], the piece at the beginning of each slot; after the last all robots have parked
    middles: Any  # float64[S, N, 2], the body's middle in the middle of each slot


def empty_traffic(robots: int, pieces: int, slots: int) -> Traffic:
    """Return the traffic with all robots left out."""
    return Traffic(
        np.zeros((robots, pieces, PIECE)), np.zeros(robots, np.int32), np.zeros((slots, robots), np.int32),
        np.zeros((slots, robots, 2)),
    )  # fmt: skip


@inline
def piece_at(begin, x, y, heading, rate, bend, seconds):
    """Return the piece that begins at a pose and takes some seconds."""
    return RoutePiece(begin, x, y, heading, rate, bend, begin + seconds)


@inline
def pose_at(pieces, i, n, t):
    """Return the pose of robot i at t [s] within its piece n, or parked after it."""
    p = pieces[i, n]
    return rolled(p[X], p[Y], p[HEADING], p[RATE] * (min(t, p[END]) - p[BEGIN]), p[BEND])


@kernel
def insert(traffic, i, route, count, floor):
    """Put the route float64[count, PIECE] of robot i in."""
    pieces, first, middles = traffic.pieces, traffic.first, traffic.middles
    pieces[i, :count] = route[:count]
    traffic.counts[i] = count
    n = 0
    for slot in range(first.shape[0]):
        while n + 1 < count and pieces[i, n, END] <= slot:
            n += 1
        first[slot, i] = n
        m = n
        while m + 1 < count and pieces[i, m, END] <= slot + 0.5:
            m += 1
        x, y, heading = pose_at(pieces, i, m, slot + 0.5)
        middles[slot, i, 0] = x + floor.middle * math.cos(heading)
        middles[slot, i, 1] = y + floor.middle * math.sin(heading)


@part
def _meets(piece, start, end, traffic, j, slot, floor):
    """Return whether a piece meets robot j between two times within a slot."""
    pieces, last = traffic.pieces, traffic.counts[j] - 1
    n, t, margin = traffic.first[slot, j], start, floor.margin
    speed = point_speed(piece.rate, piece.bend, floor)
    half_length, half_width = floor.half_length, floor.half_width
    while True:
        while n < last and pieces[j, n, END] <= t:
            n += 1
        own_x, own_y, own = rolled(piece.x, piece.y, piece.heading, piece.rate * (t - piece.begin), piece.bend)
        to_x, to_y, to = pose_at(pieces, j, n, t)
        c, s, to_c, to_s = math.cos(own), math.sin(own), math.cos(to), math.sin(to)
        dx = to_x - own_x + floor.middle * (to_c - c)
        dy = to_y - own_y + floor.middle * (to_s - s)
        body = Rectangle(0.0, 0.0, c, s, half_length, half_width)
        gap = separation(body, Rectangle(dx, dy, to_c, to_s, half_length, half_width))
        if gap < margin:
            return True
        if t >= end:
            return False
        until, their = end, 0.0
        if t < pieces[j, n, END]:
            their = point_speed(pieces[j, n, RATE], pieces[j, n, BEND], floor)
            until = min(end, pieces[j, n, END])
        step = (gap - 0.5 * margin) / (speed + their) if speed + their > 0.0 else np.inf
        t = min(until, t + step)


@part
def meetings(i, piece, most, traffic, floor):
    """Return the number of meetings of robot i with others on a piece, counted up to `most`."""
    begin, x, y, heading, rate, bend, end = piece
    count = 0
    near = 2.0 * (floor.circle + _DRIFT) + floor.margin
    slot = int(begin)
    horizon, robots = traffic.first.shape
    while slot < end and slot < horizon and count < most:
        start, stop = max(begin, float(slot)), min(end, slot + 1.0)
        mid_x, mid_y, mid = rolled(x, y, heading, rate * (0.5 * (start + stop) - begin), bend)
        mid_x, mid_y = mid_x + floor.middle * math.cos(mid), mid_y + floor.middle * math.sin(mid)
        for j in range(robots):
            dx, dy = traffic.middles[slot, j, 0] - mid_x, traffic.middles[slot, j, 1] - mid_y
            if dx * dx + dy * dy > near * near or j == i or traffic.counts[j] == 0:
                continue
            count += _meets(piece, start, stop, traffic, j, slot, floor)
        slot += 1
    return count


@kernel
def passers(i, pose, traffic, floor, later):
    """Write into later int32[S + 1] others' meetings with a body parked there, in each slot and all later ones."""
    pieces, counts, until = traffic.pieces, traffic.counts, 0
    for j in range(counts.size):
        if counts[j] > 0 and j != i:
            until = max(until, int(pieces[j, counts[j] - 1, END]))
    x, y, heading = pose
    later[:] = 0
    for slot in range(min(until, traffic.first.shape[0] - 1), -1, -1):
        parked = piece_at(float(slot), x, y, heading, 0.0, 0.0, 1.0)
        later[slot] = later[slot + 1] + meetings(i, parked, 1 << 20, traffic, floor)


@part
def _meets_in(i, j, slot, traffic, floor):
    """Return whether two routes meet in a slot."""
    pieces, last = traffic.pieces, traffic.counts[i] - 1
    n, t = traffic.first[slot, i], float(slot)
    while t < slot + 1.0:
        while n < last and pieces[i, n, END] <= t:
            n += 1
        p = pieces[i, n]
        if t >= p[END]:
            x, y, heading = pose_at(pieces, i, n, t)
            parked = RoutePiece(t, x, y, heading, 0.0, 0.0, slot + 1.0)
            return _meets(parked, t, slot + 1.0, traffic, j, slot, floor)
        until = min(p[END], slot + 1.0)
        piece = RoutePiece(p[BEGIN], p[X], p[Y], p[HEADING], p[RATE], p[BEND], p[END])
        if _meets(piece, t, until, traffic, j, slot, floor):
            return True
        t = until
    return False


@kernel
def who_meets(i, traffic, floor, met):
    """Write into met int32[N] the number of slots in which robot i meets each other robot."""
    pieces, counts = traffic.pieces, traffic.counts
    robots, horizon = counts.size, traffic.first.shape[0]
    met[:] = 0
    near = 2.0 * (floor.circle + _DRIFT) + floor.margin
    for j in range(robots):
        if j == i or counts[j] == 0 or counts[i] == 0:
            continue
        until = max(pieces[i, counts[i] - 1, END], pieces[j, counts[j] - 1, END])
        for slot in range(min(horizon, int(until) + 1)):
            dx = traffic.middles[slot, i, 0] - traffic.middles[slot, j, 0]
            dy = traffic.middles[slot, i, 1] - traffic.middles[slot, j, 1]
            if dx * dx + dy * dy > near * near:
                continue
            met[j] += _meets_in(i, j, slot, traffic, floor)
