"""Does a body touch a shelf or a disc between two samples of its motion? Of shelves see sweep.py; here are discs.

A body and a disc that are apart at both ends along one and the same axis are apart in between, but for the bow of the
body's arcs; where no axis says so, the arc is cut into ever shorter pieces, as there.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from warehouse_env.kernel import inline, part
from warehouse_env.simulation.physics.discs import reached_columns, reached_rows
from warehouse_env.simulation.physics.geometry import squared_distance_to
from warehouse_env.simulation.physics.sweep import (
    AT_END,
    BETWEEN,
    LEVELS,
    NOWHERE,
    ROUNDING,
    arc_bow,
    arc_of,
    bow_of,
    halve,
    touches_shelf,
    turn_bound,
    turned,
)
from warehouse_env.simulation.physics.trigonometry import ZERO

_TWO = np.float32(2.0)
_TINY = np.float32(1e-9)


class _Facing(NamedTuple):
    """A body that has a disc before it: from the body's centre to the disc's [m], and the body's heading."""

    x: Any
    y: Any
    c: Any
    s: Any


@inline
def _towards(one, p):
    """Return the unit vector from the point of a body nearest to a disc's centre to that; 0 from within."""
    px, py = one.x * one.c + one.y * one.s, one.y * one.c - one.x * one.s
    ex = px - min(max(px, -p["half_length"]), p["half_length"])
    ey = py - min(max(py, -p["half_width"]), p["half_width"])
    norm = max(np.sqrt(ex * ex + ey * ey), _TINY)
    return (ex * one.c - ey * one.s) / norm, (ex * one.s + ey * one.c) / norm


@inline
def _gap_along(ux, uy, start, end, radius, p):
    """Return the lesser of a body's gaps [m] to a disc along a unit axis at both ends; see `_are_apart`."""
    length, width = p["half_length"], p["half_width"]
    first, second = start.x * ux + start.y * uy, end.x * ux + end.y * uy
    if first < ZERO:
        first, second = -first, -second
    first -= length * abs(ux * start.c + uy * start.s) + width * abs(uy * start.c - ux * start.s)
    second -= length * abs(ux * end.c + uy * end.s) + width * abs(uy * end.c - ux * end.s)
    return min(first, second) - radius


@part
def _are_apart(start, end, radius, spare, p):
    """Whether an axis shows that a body and a disc, _Facing at both ends, are apart all along a piece of an arc.

    The axes from the body to the disc at both ends are tried, and the one across the motion.
    """
    for k in range(3):
        if k == 0:
            ux, uy = _towards(start, p)
        elif k == 1:
            ux, uy = _towards(end, p)
        else:
            dx, dy = end.x - start.x, end.y - start.y
            norm = max(np.sqrt(dx * dx + dy * dy), _TINY)
            ux, uy = (start.y - end.y) / norm, dx / norm
        if _gap_along(ux, uy, start, end, radius, p) > spare:
            return True
    return False


@inline
def _from_axle(one, offset):
    return _Facing(one.x + offset * one.c, one.y + offset * one.s, one.c, one.s)


@part
def _keeps_apart(halvings, axle, arc, radius, back, p):
    """Whether a body is apart from a disc in each of 2^halvings pieces of its arc.

    axle: _Facing of its axle at the start; arc: the axle's.
    """
    for _ in range(halvings):
        arc = halve(arc)
    spare = arc_bow(arc, p) + back + ROUNDING
    turn_c, turn_s, offset = arc.c * arc.c - arc.s * arc.s, _TWO * arc.c * arc.s, p["offset"]
    ax, ay = arc.x, arc.y
    for _ in range(1 << halvings):
        c, s = turned(axle.c, axle.s, turn_c, turn_s)
        after = _Facing(axle.x - ax, axle.y - ay, c, s)
        if not _are_apart(_from_axle(axle, offset), _from_axle(after, offset), radius, spare, p):
            return False
        axle = after
        ax, ay = turned(ax, ay, turn_c, turn_s)
    return True


@part
def touches_disc_between(x, y, radius, body, p):
    """Whether a body, a Sweep, touches a disc at (x, y) [m] between two samples of its motion."""
    start, end, offset = body.start, body.end, p["offset"]
    arc = arc_of(start, end, offset)
    spare = bow_of(arc.x, arc.y, turn_bound(start.c, start.s, end.c, end.s), p) + body.back + ROUNDING
    before, after = _Facing(x - start.x, y - start.y, start.c, start.s), _Facing(x - end.x, y - end.y, end.c, end.s)
    if _are_apart(before, after, radius, spare, p):
        return False
    axle = _Facing(before.x - offset * start.c, before.y - offset * start.s, start.c, start.s)
    for level in range(LEVELS):  # noqa: SIM110 (kernels have no generators)
        if _keeps_apart(2 * level + 2, axle, arc, radius, body.back, p):
            return False
    return True


@part
def touches_disc(body, way, between, p, floor, discs):
    """Return where a robot's body touches a disc in a motion, as `touches_shelf` does for shelves."""
    start, end, cell, where, r = body.start, body.end, p["cell"], NOWHERE, p["radius"]
    if discs is None:
        return NOWHERE
    rows, columns = floor.solid.shape
    first_row, last_row = reached_rows(min(start.y, end.y) - r - way, max(start.y, end.y) + r + way, rows, cell)
    left, right = reached_columns(min(start.x, end.x) - r - way, max(start.x, end.x) + r + way, columns, cell)
    for row in range(first_row, last_row + 1):
        for k in range(discs.first[row, left], discs.first[row, right + 1]):
            x, y, radius = discs.discs[k, 0], discs.discs[k, 1], discs.discs[k, 2]
            after = squared_distance_to(x, y, end)
            if after <= radius * radius:
                return AT_END
            if between and where == NOWHERE:
                before = squared_distance_to(x, y, start)
                if np.sqrt(before) + np.sqrt(after) <= way + radius + radius and touches_disc_between(
                    x, y, radius, body, p
                ):
                    where = BETWEEN
    return where


@inline
def touches_obstacle(body, way, between, p, floor):
    """Return where a robot's body touches a shelf, the rim or a disc in a motion; see `touches_shelf`."""
    at_shelf = touches_shelf(body, way, between, p, floor)
    if at_shelf == AT_END:
        return AT_END
    return max(at_shelf, touches_disc(body, way, between, p, floor, floor.discs))
