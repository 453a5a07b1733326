"""At every instant of a solution: do two bodies overlap, or a body and a disc? Kernels for check.py.

Between two looks at a gap lies no more time than the fastest points of both would need to close it (conservative
advancement; Mirtich 1996), so that no overlap deeper than the slack is missed, however short.
"""

import math
from typing import NamedTuple

from train.clmapf.motions import BEGIN, BEND, END, HEADING, LENGTH, X, Y
from train.evaluation.audit.bodies import gap, outline_of, point_gap
from warehouse_env.kernel import inline, kernel

NEVER = -1.0
ALONE = -1  # no arc
_FINE = 1e-3  # to which least gaps are found


class Shape(NamedTuple):
    """The body and the discs, and how much of an overlap is none."""

    half_length: float
    half_width: float
    middle: float  # of the body, ahead of its axle
    far: float  # from the axle to the front or the tail, whichever is farther
    disc_radius: float
    slack: float  # of a gap, which rounding makes


@inline
def _place(arcs, n, t, shape):
    """Return the centre of the body on arc n at t [s], or before or after it, its cosine and sine."""
    a = arcs[n]
    seconds = a[END] - a[BEGIN]
    share = min(max(t - a[BEGIN], 0.0), seconds) / seconds if seconds > 0.0 else 0.0
    way = share * a[LENGTH]
    half = 0.5 * way * a[BEND]
    chord = way * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    heading = a[HEADING] + 2.0 * half
    c, s = math.cos(heading), math.sin(heading)
    x, y = a[X] + chord * math.cos(a[HEADING] + half), a[Y] + chord * math.sin(a[HEADING] + half)
    return x + shape.middle * c, y + shape.middle * s, c, s


@inline
def _speed(arcs, n, t, shape):
    """Return how fast the fastest point of a body is on an arc at t [s], and until when that holds [s]."""
    a = arcs[n]
    if t < a[BEGIN]:
        return 0.0, a[BEGIN]
    if t >= a[END]:
        return 0.0, math.inf
    across, along = 1.0 + abs(a[BEND]) * shape.half_width, abs(a[BEND]) * shape.far
    return abs(a[LENGTH]) / (a[END] - a[BEGIN]) * math.sqrt(across * across + along * along), a[END]


@inline
def _arc_at(arcs, n, last, t):
    """Return which arc, n or a later one up to `last`, a robot is on at t [s]."""
    while n < last and arcs[n, END] <= t:
        n += 1
    return n


@inline
def _next_look(t, found, least, speed, shape):
    """Return until when [s] a gap can become neither an overlap nor the least by more than _FINE."""
    if found < -shape.slack:
        return t + _FINE / speed if speed > 0.0 else math.inf
    sure = found - max(least - _FINE, -2.0 * shape.slack)
    return t + sure / speed if speed > 0.0 else math.inf


@kernel
def follow(arcs, own, other, disc, end, least, shape):
    """Follow a robot past another or past a disc until `end` [s].

    own, other: the first and last of a robot's arcs, both included; other: (ALONE, ALONE) for the disc at `disc`;
    least: the least gap of interest. Returns (when they first overlap or NEVER, the depth, the least gap).
    """
    first, last = own
    second, second_last = other
    t, since, deepest, their, their_until = 0.0, NEVER, 0.0, 0.0, math.inf
    while True:
        first = _arc_at(arcs, first, last, t)
        x, y, c, s = _place(arcs, first, t, shape)
        if second == ALONE:
            dx, dy = disc[0] - x, disc[1] - y
            ahead, left = dx * c + dy * s, dy * c - dx * s
            found = point_gap(ahead, left, shape.half_length, shape.half_width) - shape.disc_radius
        else:
            second = _arc_at(arcs, second, second_last, t)
            found = gap(outline_of((x, y, c, s), shape), outline_of(_place(arcs, second, t, shape), shape))
            their, their_until = _speed(arcs, second, t, shape)
        least = min(least, found)
        if found < -shape.slack:
            since = t if since == NEVER else since
            deepest = max(deepest, -found)
        if t >= end:
            return since, deepest, least
        speed, until = _speed(arcs, first, t, shape)
        t = min(min(until, their_until), min(end, _next_look(t, found, least, speed + their, shape)))
