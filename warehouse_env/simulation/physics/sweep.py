"""Do bodies touch between two samples of their motion, on the arcs of kinematics.roll?

If one axis separates two bodies at both ends, they are apart in between: a corner leaves its chord by at most the bow
of the arc, and if both bodies move, it leads or lags even speed by at most the blur. If no axis separates them, the
arcs are cut into shorter pieces.
"""

from typing import Any, NamedTuple

import numpy as np

from warehouse_env.kernel import inline, part
from warehouse_env.simulation.physics.geometry import half_box, rectangles_touch, square_at
from warehouse_env.simulation.physics.trigonometry import HALF, ONE, ZERO

_EIGHTH = np.float32(0.125)
_TWO = np.float32(2.0)
_TINY = np.float32(1e-9)
ROUNDING = np.float32(2e-7)  # [m], of gaps
_ON_FLOOR = np.float32(1e-4)  # [m] for the rounding of places on the floor
LEVELS = 3  # of pieces of the arcs, each a quarter of the one before; bodies that still seem to touch then do


@inline
def turn_bound(c0, s0, c1, s1):
    """Return an upper bound of the angle [rad] between two headings, tight for small ones."""
    return _TWO * abs(c0 * s1 - s0 * c1) / max(ONE + c0 * c1 + s0 * s1, _TINY)


class Sweep(NamedTuple):
    """A body at two samples of its motion, and how far it may pass the ends of the arc [m] (`turns_back`)."""

    start: Any  # Rectangle
    end: Any
    back: Any


class _Pair(NamedTuple):
    """Two bodies at one moment: vector from one to the other [m], and both headings."""

    x: Any
    y: Any
    ac: Any
    as_: Any
    bc: Any
    bs: Any


class _Sizes(NamedTuple):
    """Half lengths and half widths of two bodies [m], and the offset of each axle from the centre [m]."""

    a_length: Any
    a_width: Any
    a_offset: Any
    b_length: Any
    b_width: Any
    b_offset: Any


class Arc(NamedTuple):
    """An arc of an axle: chord [m], cosine and sine of half its turn."""

    x: Any
    y: Any
    c: Any
    s: Any


@inline
def _half_widths(ux, uy, pair, sizes):
    """Return half the extent [m] of each body along a unit axis."""
    return (
        sizes.a_length * abs(ux * pair.ac + uy * pair.as_) + sizes.a_width * abs(uy * pair.ac - ux * pair.as_),
        sizes.b_length * abs(ux * pair.bc + uy * pair.bs) + sizes.b_width * abs(uy * pair.bc - ux * pair.bs),
    )


@inline
def _gap_along(ux, uy, start, end, sizes):
    """Return the smaller gap [m] along a unit axis at both ends; negative if the bodies change sides."""
    first, second = start.x * ux + start.y * uy, end.x * ux + end.y * uy
    if first < ZERO:
        first, second = -first, -second
    a, b = _half_widths(ux, uy, start, sizes)
    first = first - a - b
    a, b = _half_widths(ux, uy, end, sizes)
    return min(first, second - a - b)


@part
def _are_apart(start, end, sizes, blurs, bow):
    """Whether an axis separates two bodies, a _Pair at both ends, all along a piece of their arcs.

    Tries the axes of both bodies at both ends, and the one across their relative motion, which settles bodies that do
    not turn. blurs: (x, y, all directions) [m] of a, then of b.
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
    """Return (x, y) turned by the angle with cosine c and sine s."""
    return x * c - y * s, y * c + x * s


@inline
def turns_back(speed, next_speed, bend, p):
    """Return how far [m] a body passes the ends of its arc in a substep in which its speed changes sign, else 0.

    bend: curvature of the arc [1/m].
    """
    if speed * next_speed >= ZERO:
        return ZERO
    beyond = HALF * p["dt"] * min(speed * speed, next_speed * next_speed) / abs(next_speed - speed)
    return beyond * (ONE + p["far"] * abs(bend))


@inline
def _blur(x, y, turn, back, other_moves, p):
    """Return how far [m] a body may lead or lag even speed: along x, y, and in all directions; 0 beside one at rest."""
    way, blur = max(np.sqrt(x * x + y * y), _TINY), p["blur"] if other_moves else ZERO
    return blur * x / way, blur * y / way, min(blur * turn * (ONE + p["far"] / way), p["far"] * turn) + back


@inline
def bow_of(x, y, turn, p):
    """Return how far any point of a body leaves its chord [m]; (x, y): chord of its axle [m]."""
    return _EIGHTH * turn * (np.sqrt(x * x + y * y) + p["far"] * turn)


@inline
def arc_of(start, end, offset):
    """Return the arc of the axle of a body from one Rectangle to another."""
    x, y = end.x - start.x + offset * (end.c - start.c), end.y - start.y + offset * (end.s - start.s)
    c = np.sqrt(max(HALF + HALF * (start.c * end.c + start.s * end.s), _TINY))
    return Arc(x, y, c, HALF * (start.c * end.s - start.s * end.c) / c)


@inline
def arc_bow(arc, p):
    """Return how far any point of a body on an arc leaves its chord [m]."""
    return bow_of(arc.x, arc.y, _TWO * abs(arc.s) / max(arc.c, _TINY), p)


@inline
def _middles(axles, sizes):
    """Return the _Pair of two bodies' centres, from the _Pair of their axles."""
    return _Pair(
        axles.x - sizes.b_offset * axles.bc + sizes.a_offset * axles.ac,
        axles.y - sizes.b_offset * axles.bs + sizes.a_offset * axles.as_,
        axles.ac, axles.as_, axles.bc, axles.bs,
    )  # fmt: skip


@part
def _keep_apart(halvings, axles, a, b, sizes, blurs, p, q):
    """Whether two bodies are apart in each of 2^halvings pieces of their arcs.

    axles: the _Pair of their axles at the start; a, b: their Arcs; the rest as in `touch_between`.
    """
    for _ in range(halvings):
        a, b = halve(a), halve(b)
    bow = arc_bow(a, p) + arc_bow(b, q)
    # each piece turns chord and body by the same angle
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
    """Whether a robot's body a and a body b, apart at two samples of their motions, touch in between.

    a, b: Sweeps; b_offset: from b's axle back to its centre [m]; p, q: parameters of a and b (any for a shelf's cell).
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
    """Whether two bodies are on the same side of each other at both ends.

    along, across: from centre to centre at both ends [m]; long, wide: the distances from which they may be near [m].
    """
    return (
        min(along0, along1) > long or max(along0, along1) < -long
        or min(across0, across1) > wide or max(across0, across1) < -wide
    )  # fmt: skip


@part
def _passes_cell(box, body, spare, p, solid):
    """Whether a body touches one of the cells in a box (first row, last row, first column, last column) on the way.

    body: its Sweep. The axes of the body at the end settle most cells.
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
def touches_cell(body, way, between, p, solid):
    """Whether a robot's body touches a shelf or the rim at the end of its motion or, if asked, between the samples.

    body: its Sweep; way: the longest path of any point [m], which leaves its chord by at most way^2 / 8 far.
    Only cells that meet the box around the body at both ends count.
    """
    start, end, cell, half = body.start, body.end, p["cell"], HALF * p["cell"]
    spare = _EIGHTH * way * way / p["far"] + body.back + ROUNDING
    (ex0, ey0), (ex1, ey1) = half_box(start), half_box(end)
    (rows, columns), scale, more, near = solid.shape, ONE / cell, spare + _ON_FLOOR, False
    first_row = max(int((min(start.y - ey0, end.y - ey1) - more) * scale + ONE), 0)  # under 0 is rounded up, to the rim
    last_row = min(int((max(start.y + ey0, end.y + ey1) + more) * scale) + 1, rows - 1)
    first_column = max(int((min(start.x - ex0, end.x - ex1) - more) * scale + ONE), 0)
    last_column = min(int((max(start.x + ex0, end.x + ex1) + more) * scale) + 1, columns - 1)
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            if solid[row, column] != 0:
                near = between
                x, y = (np.float32(column) - HALF) * cell, (np.float32(row) - HALF) * cell
                if rectangles_touch(end, square_at(x, y, half)):
                    return True
    return near and _passes_cell((first_row, last_row, first_column, last_column), body, spare, p, solid)
