"""Do bodies touch between two samples of their motion, in which each drives on an arc as kinematics.roll drives it?

Bodies that are apart at both ends along one and the same axis are apart in between: a corner leaves its chord by the
arc's bow at most, and where both move it is before or behind where it would be at even speed by the blur at most. Where
no axis says so, the arcs are cut into ever shorter pieces.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from warehouse_env.kernel import inline, part
from warehouse_env.simulation.physics.geometry import half_box, rectangles_touch, square_at
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO

_EIGHTH = np.float32(0.125)
_TWO = np.float32(2.0)
_TINY = np.float32(1e-9)
ROUNDING = np.float32(2e-7)  # [m], of gaps
_ON_FLOOR = np.float32(1e-4)  # [m] for what rounds places on the floor
LEVELS = 3  # of pieces of the arcs, each a quarter of those before, until bodies that seem to touch do
NOWHERE, BETWEEN, AT_END = range(3)  # a body touches a shelf


@inline
def turn_bound(c0, s0, c1, s1):
    """Return at least the angle [rad] between two headings, and little more of a small one."""
    return _TWO * abs(c0 * s1 - s0 * c1) / max(ONE + c0 * c1 + s0 * s1, _TINY)


class Sweep(NamedTuple):
    """A body at two samples of its motion, and how far it may go beyond the arc's ends [m] (`turns_back`)."""

    start: Any  # Rectangle
    end: Any
    back: Any


class _Pair(NamedTuple):
    """Two bodies at one moment: from the one to the other [m], and both headings."""

    x: Any
    y: Any
    ac: Any
    as_: Any
    bc: Any
    bs: Any


class _Sizes(NamedTuple):
    """Half the lengths and widths of two bodies [m], and from the axle of each to its centre [m]."""

    a_length: Any
    a_width: Any
    a_offset: Any
    b_length: Any
    b_width: Any
    b_offset: Any


class Arc(NamedTuple):
    """An arc of an axle: its chord [m], cosine and sine of half the angle by which it turns."""

    x: Any
    y: Any
    c: Any
    s: Any


@inline
def _half_widths(ux, uy, pair, sizes):
    """Return how far the two bodies reach, of half of each, along a unit axis [m]."""
    return (
        sizes.a_length * abs(ux * pair.ac + uy * pair.as_) + sizes.a_width * abs(uy * pair.ac - ux * pair.as_),
        sizes.b_length * abs(ux * pair.bc + uy * pair.bs) + sizes.b_width * abs(uy * pair.bc - ux * pair.bs),
    )


@inline
def _gap_along(ux, uy, start, end, sizes):
    """Return the lesser of the gaps [m] along a unit axis at both ends; negative where they are on different sides."""
    first, second = start.x * ux + start.y * uy, end.x * ux + end.y * uy
    if first < ZERO:
        first, second = -first, -second
    a, b = _half_widths(ux, uy, start, sizes)
    first = first - a - b
    a, b = _half_widths(ux, uy, end, sizes)
    return min(first, second - a - b)


@part
def _are_apart(start, end, sizes, blurs, bow):
    """Whether an axis shows that two bodies, a _Pair at both ends, are apart all along a piece of their arcs.

    The axes of both bodies at both ends are tried, and the one across their relative motion, which settles whatever
    does not turn. blurs: (x, y, all ways) [m] of a, then of b.
    """
    for k in range(9):
        if k < 4:
            ux, uy = (start.ac, start.as_) if k < 2 else (end.ac, end.as_)
        elif k < 8:
            ux, uy = (start.bc, start.bs) if k < 6 else (end.bc, end.bs)
        else:
            mx, my = end.x - start.x, end.y - start.y
            norm = max(np.sqrt(mx * mx + my * my), _TINY)
            ux, uy = -my / norm, mx / norm
        if k % 2 == 1:
            ux, uy = -uy, ux
        blur = abs(blurs[0] * ux + blurs[1] * uy) + blurs[2] + abs(blurs[3] * ux + blurs[4] * uy) + blurs[5]
        if _gap_along(ux, uy, start, end, sizes) > blur + bow + ROUNDING:
            return True
    return False


@inline
def halve(arc):
    """Return the first half of an arc."""
    c = np.sqrt(max(HALF + HALF * arc.c, _TINY))
    scale = HALF / c
    s = HALF * arc.s / c
    return Arc(scale * (arc.x * c + arc.y * s), scale * (arc.y * c - arc.x * s), c, s)


@inline
def turned(x, y, c, s):
    """Return (x, y) turned by an angle of which c and s are cosine and sine."""
    return x * c - y * s, y * c + x * s


@inline
def turns_back(speed, next_speed, bend, p):
    """Return how far a point of a body goes beyond the ends of its arc [m] in a substep in which it turns back, else 0.

    bend: the arc's curvature [1/m].
    """
    if speed * next_speed >= ZERO:
        return ZERO
    beyond = HALF * p["dt"] * min(speed * speed, next_speed * next_speed) / abs(next_speed - speed)
    return beyond * (ONE + p["far"] * abs(bend))


@inline
def _blur(x, y, turn, back, other_moves, p):
    """Return how far a body may be before or behind where it would be at even speed, along x, y, and all ways [m].

    Beside one that stands it does not matter when it is where.
    """
    way, blur = max(np.sqrt(x * x + y * y), _TINY), p["blur"] if other_moves else ZERO
    return blur * x / way, blur * y / way, min(blur * turn * (ONE + p["far"] / way), p["far"] * turn) + back


@inline
def bow_of(x, y, turn, p):
    """Return how far any point of a body leaves its chord [m], of whose axle the chord is (x, y) [m]."""
    return _EIGHTH * turn * (np.sqrt(x * x + y * y) + p["far"] * turn)


@inline
def arc_of(start, end, offset):
    """Return the arc on which the axle of a body comes from one Rectangle to another."""
    x, y = end.x - start.x + offset * (end.c - start.c), end.y - start.y + offset * (end.s - start.s)
    c = np.sqrt(max(HALF + HALF * (start.c * end.c + start.s * end.s), _TINY))
    return Arc(x, y, c, HALF * (start.c * end.s - start.s * end.c) / c)


@inline
def arc_bow(arc, p):
    """Return how far any point of a body on an arc leaves its chord [m]."""
    return bow_of(arc.x, arc.y, _TWO * abs(arc.s) / max(arc.c, _TINY), p)


@inline
def _middles(axles, sizes):
    """Return the _Pair of two bodies' centres from that of their axles."""
    return _Pair(
        axles.x - sizes.b_offset * axles.bc + sizes.a_offset * axles.ac,
        axles.y - sizes.b_offset * axles.bs + sizes.a_offset * axles.as_,
        axles.ac, axles.as_, axles.bc, axles.bs,
    )  # fmt: skip


@part
def _keep_apart(halvings, axles, a, b, sizes, blurs, p, q):
    """Whether two bodies are apart in each of 2^halvings pieces of their arcs.

    axles: the _Pair of their axles at the start; a, b: the Arcs of these; all else: `touch_between`.
    """
    for _ in range(halvings):
        a, b = halve(a), halve(b)
    bow = arc_bow(a, p) + arc_bow(b, q)
    # each piece turns the chord, and the body, by as much again
    a_c, a_s, b_c, b_s = a.c * a.c - a.s * a.s, _TWO * a.c * a.s, b.c * b.c - b.s * b.s, _TWO * b.c * b.s
    ax, ay, bx, by, middles = a.x, a.y, b.x, b.y, _middles(axles, sizes)
    for _ in range(1 << halvings):
        ac, as_ = turned(axles.ac, axles.as_, a_c, a_s)
        bc, bs = turned(axles.bc, axles.bs, b_c, b_s)
        axles = _Pair(axles.x + bx - ax, axles.y + by - ay, ac, as_, bc, bs)
        ends = _middles(axles, sizes)
        if not _are_apart(middles, ends, sizes, blurs, bow):
            return False
        middles = ends
        ax, ay = turned(ax, ay, a_c, a_s)
        bx, by = turned(bx, by, b_c, b_s)
    return True


@part
def touch_between(a, b, b_offset, p, q):
    """Whether a robot's body a and a body b touch between two samples of their motions, at which they do not.

    a, b: Sweeps; b_offset: from the point of b that moves on an arc along b's heading, back to its centre [m]; p, q:
    the parameters of a and of b, which of a cell, that stays where it is, may be any.
    """
    a0, a1, b0, b1, offset = a.start, a.end, b.start, b.end, p["offset"]
    ax, ay = a1.x - a0.x + offset * (a1.c - a0.c), a1.y - a0.y + offset * (a1.s - a0.s)  # chords of the axles
    bx, by = b1.x - b0.x + b_offset * (b1.c - b0.c), b1.y - b0.y + b_offset * (b1.s - b0.s)
    a_moves, b_moves = ax != ZERO or ay != ZERO, bx != ZERO or by != ZERO
    a_turn, b_turn = turn_bound(a0.c, a0.s, a1.c, a1.s), turn_bound(b0.c, b0.s, b1.c, b1.s)
    blurs = (*_blur(ax, ay, a_turn, a.back, b_moves, p), *_blur(bx, by, b_turn, b.back, a_moves, q))
    sizes = _Sizes(a0.length, a0.width, offset, b0.length, b0.width, b_offset)
    start = _Pair(b0.x - a0.x, b0.y - a0.y, a0.c, a0.s, b0.c, b0.s)
    end = _Pair(b1.x - a1.x, b1.y - a1.y, a1.c, a1.s, b1.c, b1.s)
    if _are_apart(start, end, sizes, blurs, bow_of(ax, ay, a_turn, p) + bow_of(bx, by, b_turn, q)):
        return False
    a_arc, b_arc = arc_of(a0, a1, offset), arc_of(b0, b1, b_offset)
    axles = _Pair(
        start.x + b_offset * b0.c - offset * a0.c, start.y + b_offset * b0.s - offset * a0.s, a0.c, a0.s, b0.c, b0.s
    )
    for level in range(LEVELS):  # noqa: SIM110 (kernels have no generators)
        if _keep_apart(2 * level + 2, axles, a_arc, b_arc, sizes, blurs, p, q):
            return False
    return True


@inline
def _passes(along0, along1, across0, across1, long, wide):
    """Whether two bodies are on the same side of each other at both ends: ahead or astern, or abeam.

    along, across: from the middle of one to that of the other at both ends [m]; long, wide: the most at which they
    come near [m].
    """
    return (
        min(along0, along1) > long or max(along0, along1) < -long
        or min(across0, across1) > wide or max(across0, across1) < -wide
    )  # fmt: skip


@part
def _touch_cell(box, body, spare, p, solid):
    """Whether a body touches one of the cells in a box (first row, last row, first column, last column) on the way.

    body: its Sweep. Most cells that are near it passes along its axes at the end.
    """
    first_row, last_row, first_column, last_column = box
    start, end, cell, half = body.start, body.end, p["cell"], HALF * p["cell"]
    c, s = abs(start.c * end.c + start.s * end.s), abs(start.c * end.s - start.s * end.c)
    length, width, corner = end.length, end.width, half * (abs(end.c) + abs(end.s)) + spare
    long, wide = max(length, length * c + width * s) + corner, max(width, length * s + width * c) + corner
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            if solid[row, column] == 0:
                continue
            shelf = square_at((np.float32(column) - HALF) * cell, (np.float32(row) - HALF) * cell, half)
            dx0, dy0, dx1, dy1 = shelf.x - start.x, shelf.y - start.y, shelf.x - end.x, shelf.y - end.y
            if not _passes(
                dx0 * end.c + dy0 * end.s, dx1 * end.c + dy1 * end.s,
                dy0 * end.c - dx0 * end.s, dy1 * end.c - dx1 * end.s, long, wide,
            ) and touch_between(body, Sweep(shelf, shelf, ZERO), ZERO, p, p):  # fmt: skip
                return True
    return False


@inline
def touches_shelf(body, way, between, p, floor):
    """Return where a robot's body touches a shelf or the rim in a motion: AT_END, else, if asked, BETWEEN, or NOWHERE.

    body: its Sweep; way: of any point of it at most [m], which leaves its chord by an eighth of way^2 / far at most.
    Along the axes of the floor a body is apart from all cells but those that the box around it at both ends meets.
    """
    start, end, cell, half = body.start, body.end, p["cell"], HALF * p["cell"]
    spare = _EIGHTH * way * way / p["far"] + body.back + ROUNDING
    (ex0, ey0), (ex1, ey1) = half_box(start), half_box(end)
    (rows, columns), scale, more, near = floor.solid.shape, ONE / cell, spare + _ON_FLOOR, False
    first_row = max(int((min(start.y - ey0, end.y - ey1) - more) * scale + ONE), 0)  # under 0 is rounded up, to the rim
    last_row = min(int((max(start.y + ey0, end.y + ey1) + more) * scale) + 1, rows - 1)
    first_column = max(int((min(start.x - ex0, end.x - ex1) - more) * scale + ONE), 0)
    last_column = min(int((max(start.x + ex0, end.x + ex1) + more) * scale) + 1, columns - 1)
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            if floor.solid[row, column] != 0:
                near = between
                x, y = (np.float32(column) - HALF) * cell, (np.float32(row) - HALF) * cell
                if rectangles_touch(end, square_at(x, y, half)):
                    return AT_END
    if near and _touch_cell((first_row, last_row, first_column, last_column), body, spare, p, floor.solid):
        return BETWEEN
    return NOWHERE
