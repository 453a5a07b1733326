"""Does a body touch a shelf or a disc between two samples of its motion? Of shelves see sweep.py; here are discs.

A body and a disc that are apart at both ends along one and the same axis are apart in between, but for the bow of the
body's arcs; where no axis says so, the arc is cut into ever shorter pieces, as there.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import inline, part
from warehouse_env.simulation.physics.discs import reached_columns, reached_rows
from warehouse_env.simulation.physics.geometry import squared_distance_to_box
from warehouse_env.simulation.physics.sweep import (
    AT_END,
    BETWEEN,
    LEVELS,
    NOWHERE,
    ROUNDING,
    bow_of,
    halve,
    touches_shelf,
    turn_bound,
)
from warehouse_env.simulation.physics.trigonometry import HALF, ZERO

_TWO = np.float32(2.0)
_TINY = np.float32(1e-9)


@inline
def _towards(dx, dy, c, s, p):
    """Return the unit vector from the point of a body nearest to a point (dx, dy) [m] off its centre; 0 from within."""
    px, py = dx * c + dy * s, dy * c - dx * s
    ex = px - min(max(px, -p["half_length"]), p["half_length"])
    ey = py - min(max(py, -p["half_width"]), p["half_width"])
    norm = max(np.sqrt(ex * ex + ey * ey), _TINY)
    return (ex * c - ey * s) / norm, (ex * s + ey * c) / norm


@inline
def _gap_along(ux, uy, dx, dy, c0, s0, to_x, to_y, c1, s1, radius, p):
    """Return the lesser of a body's gaps [m] to a disc along a unit axis at both ends; see `_are_apart`."""
    length, width = p["half_length"], p["half_width"]
    first, second = dx * ux + dy * uy, to_x * ux + to_y * uy
    if first < ZERO:
        first, second = -first, -second
    first -= length * abs(ux * c0 + uy * s0) + width * abs(uy * c0 - ux * s0)
    second -= length * abs(ux * c1 + uy * s1) + width * abs(uy * c1 - ux * s1)
    return min(first, second) - radius


@part
def _are_apart(dx, dy, c0, s0, to_x, to_y, c1, s1, radius, spare, p):
    """Whether an axis shows that a body and a disc are apart all along a piece of an arc.

    (dx, dy), (to_x, to_y): from the body's centre to the disc's at both ends [m]. The axes from the body to the disc at
    both ends are tried, and the one across the motion.
    """
    for k in range(3):
        if k == 0:
            ux, uy = _towards(dx, dy, c0, s0, p)
        elif k == 1:
            ux, uy = _towards(to_x, to_y, c1, s1, p)
        else:
            norm = max(np.sqrt((to_x - dx) * (to_x - dx) + (to_y - dy) * (to_y - dy)), _TINY)
            ux, uy = (dy - to_y) / norm, (to_x - dx) / norm
        if _gap_along(ux, uy, dx, dy, c0, s0, to_x, to_y, c1, s1, radius, p) > spare:
            return True
    return False


@part
def _keeps_apart(halvings, dx, dy, c, s, ax, ay, ac, as_, radius, back, p):
    """Whether a body is apart from a disc in each of 2^halvings pieces of its arc.

    dx, dy: from its axle to the disc's centre [m]; c, s: its heading; ax, ay: its chord [m]; ac, as_: cosine and sine
    of half the angle by which it turns.
    """
    for _ in range(halvings):
        ac, as_, ax, ay = halve(ac, as_, ax, ay)
    spare = bow_of(ax, ay, _TWO * abs(as_) / max(ac, _TINY), p) + back + ROUNDING
    turn_c, turn_s, offset = ac * ac - as_ * as_, _TWO * ac * as_, p["offset"]
    for _ in range(1 << halvings):
        next_c, next_s, next_dx, next_dy = c * turn_c - s * turn_s, s * turn_c + c * turn_s, dx - ax, dy - ay
        if not _are_apart(
            dx + offset * c, dy + offset * s, c, s,
            next_dx + offset * next_c, next_dy + offset * next_s, next_c, next_s, radius, spare, p,
        ):  # fmt: skip
            return False
        dx, dy, c, s = next_dx, next_dy, next_c, next_s
        ax, ay = ax * turn_c - ay * turn_s, ay * turn_c + ax * turn_s
    return True


@part
def touches_disc_between(x, y, radius, x0, y0, c0, s0, x1, y1, c1, s1, back, p):
    """Whether a body touches a disc at (x, y) [m] between two samples of its motion; all else: see `touches_shelf`."""
    offset = p["offset"]
    ax, ay = x1 - x0 + offset * (c1 - c0), y1 - y0 + offset * (s1 - s0)  # the axle's chord
    spare = bow_of(ax, ay, turn_bound(c0, s0, c1, s1), p) + back + ROUNDING
    if _are_apart(x - x0, y - y0, c0, s0, x - x1, y - y1, c1, s1, radius, spare, p):
        return False
    half_c = np.sqrt(max(HALF + HALF * (c0 * c1 + s0 * s1), _TINY))
    half_s = HALF * (c0 * s1 - s0 * c1) / half_c
    dx, dy = x - x0 - offset * c0, y - y0 - offset * s0
    for level in range(LEVELS):
        if _keeps_apart(2 * level + 2, dx, dy, c0, s0, ax, ay, half_c, half_s, radius, back, p):
            return False
    return True


@part
def touches_disc(x0, y0, c0, s0, x1, y1, c1, s1, way, back, between, p, solid):
    """Return where a robot's body touches a disc in a motion: AT_END, else, if asked, BETWEEN, or NOWHERE.

    Arguments as those of `touches_shelf`.
    """
    length, width, cell, where = p["half_length"], p["half_width"], p["cell"], NOWHERE
    rows, columns = solid.cells.shape
    first_row, last_row = reached_rows(min(y0, y1) - p["radius"] - way, max(y0, y1) + p["radius"] + way, rows, cell)
    left, right = reached_columns(min(x0, x1) - p["radius"] - way, max(x0, x1) + p["radius"] + way, columns, cell)
    for row in range(first_row, last_row + 1):
        for k in range(solid.first[row, left], solid.first[row, right + 1]):
            x, y, radius = solid.discs[k, 0], solid.discs[k, 1], solid.discs[k, 2]
            dx, dy = x - x1, y - y1
            after = squared_distance_to_box(dx * c1 + dy * s1, dy * c1 - dx * s1, length, width)
            if after <= radius * radius:
                return AT_END
            if between and where == NOWHERE:
                dx, dy = x - x0, y - y0
                before = squared_distance_to_box(dx * c0 + dy * s0, dy * c0 - dx * s0, length, width)
                if np.sqrt(before) + np.sqrt(after) <= way + radius + radius and touches_disc_between(
                    x, y, radius, x0, y0, c0, s0, x1, y1, c1, s1, back, p
                ):
                    where = BETWEEN
    return where


@inline
def touches_obstacle(x0, y0, c0, s0, x1, y1, c1, s1, way, back, between, p, solid):
    """Return where a robot's body touches a shelf, the rim or a disc in a motion; see `touches_shelf`."""
    if hasattr(solid, "cells"):
        at_shelf = touches_shelf(x0, y0, c0, s0, x1, y1, c1, s1, way, back, between, p, solid.cells)
        if at_shelf == AT_END:
            return AT_END
        return max(at_shelf, touches_disc(x0, y0, c0, s0, x1, y1, c1, s1, way, back, between, p, solid))
    return touches_shelf(x0, y0, c0, s0, x1, y1, c1, s1, way, back, between, p, solid)
