"""At every instant of a solution: do two bodies overlap, or a body and a disc? Kernels for jobs.py.

Between two looks at a gap lies no more time than the fastest points of both would need to close it (conservative
advancement; Mirtich 1996), so that no overlap deeper than the slack is missed, however short.
"""

import math

from train.clmapf.motions import BEGIN, BEND, END, HEADING, LENGTH, X, Y
from train.evaluation.audit.bodies import gap, outline_of, point_gap
from warehouse_env.kernel import inline, kernel

NEVER = -1.0
ALONE = -1  # no arc
_FINE = 1e-3  # to which least gaps are found


@inline
def _place(arcs, n, t, floor):
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
    return x + floor.middle * c, y + floor.middle * s, c, s


@inline
def _speed(arcs, n, t, floor):
    """Return how fast the fastest point of a body is on an arc at t [s], and until when that holds [s]."""
    a = arcs[n]
    if t < a[BEGIN]:
        return 0.0, a[BEGIN]
    if t >= a[END]:
        return 0.0, math.inf
    across, along = 1.0 + abs(a[BEND]) * floor.half_width, abs(a[BEND]) * (floor.half_length + abs(floor.middle))
    return abs(a[LENGTH]) / (a[END] - a[BEGIN]) * math.sqrt(across * across + along * along), a[END]


@inline
def _arc_at(arcs, n, last, t):
    """Return which arc, n or a later one up to `last`, a robot is on at t [s]."""
    while n < last and arcs[n, END] <= t:
        n += 1
    return n


@inline
def _next_look(t, found, least, speed, slack):
    """Return until when [s] a gap can become neither an overlap nor the least by more than _FINE."""
    if found < -slack:
        return t + _FINE / speed if speed > 0.0 else math.inf
    sure = found - max(least - _FINE, -2.0 * slack)
    return t + sure / speed if speed > 0.0 else math.inf


@kernel
def follow(arcs, own, other, least, floor, slack):
    """Follow a robot past another or past a disc until they stand.

    own, other: the first and last of a robot's arcs, both included; other: (ALONE, k) for disc k; floor: CarFloor;
    least: the least gap of interest; slack: of a gap, which rounding makes. Returns (when they first overlap or NEVER,
    the depth, the least gap).
    """
    first, last = own
    second, second_last = other
    end = arcs[last, BEGIN] if second == ALONE else max(arcs[last, BEGIN], arcs[second_last, BEGIN])
    t, since, deepest, their, their_until = 0.0, NEVER, 0.0, 0.0, math.inf
    while True:
        first = _arc_at(arcs, first, last, t)
        x, y, c, s = _place(arcs, first, t, floor)
        if second == ALONE:
            dx, dy = floor.discs[second_last, 0] - x, floor.discs[second_last, 1] - y
            ahead, left = dx * c + dy * s, dy * c - dx * s
            found = point_gap(ahead, left, floor.half_length, floor.half_width) - floor.disc_radius
        else:
            second = _arc_at(arcs, second, second_last, t)
            found = gap(outline_of((x, y, c, s), floor), outline_of(_place(arcs, second, t, floor), floor))
            their, their_until = _speed(arcs, second, t, floor)
        least = min(least, found)
        if found < -slack:
            since = t if since == NEVER else since
            deepest = max(deepest, -found)
        if t >= end:
            return since, deepest, least
        speed, until = _speed(arcs, first, t, floor)
        t = min(min(until, their_until), min(end, _next_look(t, found, least, speed + their, slack)))
