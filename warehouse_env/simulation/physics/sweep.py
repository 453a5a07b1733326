"""Do bodies touch between two samples of their motion, in which each drives on an arc as kinematics.roll drives it?

Bodies that are apart at both ends along one and the same axis are apart in between: a corner leaves its chord by the
arc's bow at most, and where both move it is before or behind where it would be at even speed by the blur at most. Where
no axis says so, the arcs are cut into ever shorter pieces.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import inline, part
from warehouse_env.simulation.physics.geometry import rectangles_touch
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


@inline
def _gap_along(ux, uy, d0x, d0y, d1x, d1y, a0c, a0s, a1c, a1s, b0c, b0s, b1c, b1s, la, wa, lb, wb):
    """Return the lesser of the gaps [m] along a unit axis at both ends; negative where they are on different sides."""
    first, second = d0x * ux + d0y * uy, d1x * ux + d1y * uy
    if first < ZERO:
        first, second = -first, -second
    first -= la * abs(ux * a0c + uy * a0s) + wa * abs(uy * a0c - ux * a0s)
    first -= lb * abs(ux * b0c + uy * b0s) + wb * abs(uy * b0c - ux * b0s)
    second -= la * abs(ux * a1c + uy * a1s) + wa * abs(uy * a1c - ux * a1s)
    second -= lb * abs(ux * b1c + uy * b1s) + wb * abs(uy * b1c - ux * b1s)
    return min(first, second)


@part
def _are_apart(d0x, d0y, d1x, d1y, a0c, a0s, a1c, a1s, b0c, b0s, b1c, b1s, la, wa, lb, wb, blurs, bow):
    """Whether an axis shows that two bodies are apart all along a piece of their arcs.

    The axes of both bodies at both ends are tried, and the one across their relative motion, which settles whatever
    does not turn. blurs: (x, y, all ways) [m] of a, then of b.
    """
    for k in range(9):
        if k < 4:
            ux, uy = (a0c, a0s) if k < 2 else (a1c, a1s)
        elif k < 8:
            ux, uy = (b0c, b0s) if k < 6 else (b1c, b1s)
        else:
            mx, my = d1x - d0x, d1y - d0y
            norm = max(np.sqrt(mx * mx + my * my), _TINY)
            ux, uy = -my / norm, mx / norm
        if k % 2 == 1:
            ux, uy = -uy, ux
        blur = abs(blurs[0] * ux + blurs[1] * uy) + blurs[2] + abs(blurs[3] * ux + blurs[4] * uy) + blurs[5]
        gap = _gap_along(ux, uy, d0x, d0y, d1x, d1y, a0c, a0s, a1c, a1s, b0c, b0s, b1c, b1s, la, wa, lb, wb)
        if gap > blur + bow + ROUNDING:
            return True
    return False


@inline
def halve(c, s, x, y):
    """Return (cosine and sine of half the angle, chord of the first half) of an arc.

    c, s: of half the angle by which an arc turns; (x, y): its chord [m].
    """
    half_c = np.sqrt(max(HALF + HALF * c, _TINY))
    half_s = HALF * s / half_c
    scale = HALF / half_c
    return half_c, half_s, scale * (x * half_c + y * half_s), scale * (y * half_c - x * half_s)


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


@part
def _keep_apart(halvings, dx, dy, c1, s1, ax, ay, ac, as_, c2, s2, bx, by, bc, bs, lb, wb, b_offset, blurs, p, q):
    """Whether two bodies are apart in each of 2^halvings pieces of their arcs.

    dx, dy: from the axle of a to that of b [m]; c1, s1 and c2, s2: their headings; ax, ay: the chord of a [m]; ac, as_:
    cosine and sine of half the angle by which it turns; so of b; all else: `touch_between`.
    """
    la, wa, offset = p["half_length"], p["half_width"], p["offset"]
    for _ in range(halvings):
        ac, as_, ax, ay = halve(ac, as_, ax, ay)
        bc, bs, bx, by = halve(bc, bs, bx, by)
    bow = bow_of(ax, ay, _TWO * abs(as_) / max(ac, _TINY), p) + bow_of(bx, by, _TWO * abs(bs) / max(bc, _TINY), q)
    # each piece turns the chord, and the body, by as much again
    a_c, a_s, b_c, b_s = ac * ac - as_ * as_, _TWO * ac * as_, bc * bc - bs * bs, _TWO * bc * bs
    for _ in range(1 << halvings):
        next_c1, next_s1 = c1 * a_c - s1 * a_s, s1 * a_c + c1 * a_s
        next_c2, next_s2 = c2 * b_c - s2 * b_s, s2 * b_c + c2 * b_s
        next_dx, next_dy = dx + bx - ax, dy + by - ay
        if not _are_apart(
            dx - b_offset * c2 + offset * c1, dy - b_offset * s2 + offset * s1,
            next_dx - b_offset * next_c2 + offset * next_c1, next_dy - b_offset * next_s2 + offset * next_s1,
            c1, s1, next_c1, next_s1, c2, s2, next_c2, next_s2, la, wa, lb, wb, blurs, bow,
        ):  # fmt: skip
            return False
        dx, dy, c1, s1, c2, s2 = next_dx, next_dy, next_c1, next_s1, next_c2, next_s2
        ax, ay, bx, by = ax * a_c - ay * a_s, ay * a_c + ax * a_s, bx * b_c - by * b_s, by * b_c + bx * b_s
    return True


@part
def touch_between(
    ax0, ay0, ac0, as0, ax1, ay1, ac1, as1, bx0, by0, bc0, bs0, bx1, by1, bc1, bs1, lb, wb, b_offset,
    a_back, b_back, p, q
):  # fmt: skip
    """Whether a robot's body a and a body b touch between two samples of their motions, at which they do not.

    x, y: their centres [m] at the first and the second sample; c, s: their headings; lb, wb: half length and half width
    of b [m]; b_offset: from the point of b that moves on an arc along b's heading, back to its centre [m]; back: see
    `turns_back`; p, q: the parameters of a and of b, which of a cell, that stays where it is, may be any.
    """
    offset = p["offset"]
    ax, ay = ax1 - ax0 + offset * (ac1 - ac0), ay1 - ay0 + offset * (as1 - as0)  # chords of the axles
    bx, by = bx1 - bx0 + b_offset * (bc1 - bc0), by1 - by0 + b_offset * (bs1 - bs0)
    a_moves, b_moves = ax != ZERO or ay != ZERO, bx != ZERO or by != ZERO
    a_turn, b_turn = turn_bound(ac0, as0, ac1, as1), turn_bound(bc0, bs0, bc1, bs1)
    blurs = (*_blur(ax, ay, a_turn, a_back, b_moves, p), *_blur(bx, by, b_turn, b_back, a_moves, q))
    if _are_apart(
        bx0 - ax0, by0 - ay0, bx1 - ax1, by1 - ay1, ac0, as0, ac1, as1, bc0, bs0, bc1, bs1,
        p["half_length"], p["half_width"], lb, wb, blurs, bow_of(ax, ay, a_turn, p) + bow_of(bx, by, b_turn, q),
    ):  # fmt: skip
        return False
    a_c = np.sqrt(max(HALF + HALF * (ac0 * ac1 + as0 * as1), _TINY))
    b_c = np.sqrt(max(HALF + HALF * (bc0 * bc1 + bs0 * bs1), _TINY))
    a_s, b_s = HALF * (ac0 * as1 - as0 * ac1) / a_c, HALF * (bc0 * bs1 - bs0 * bc1) / b_c
    dx, dy = bx0 - ax0 + b_offset * bc0 - offset * ac0, by0 - ay0 + b_offset * bs0 - offset * as0
    for level in range(LEVELS):
        if _keep_apart(
            2 * level + 2, dx, dy, ac0, as0, ax, ay, a_c, a_s, bc0, bs0, bx, by, b_c, b_s, lb, wb, b_offset, blurs, p, q
        ):  # fmt: skip
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
def _touch_cell(first_row, last_row, first_column, last_column, x0, y0, c0, s0, x1, y1, c1, s1, spare, back, p, solid):
    """Whether a body touches one of the cells on the way; most that are near it passes along its axes at the end."""
    cell, half, length, width = p["cell"], HALF * p["cell"], p["half_length"], p["half_width"]
    c, s, corner = abs(c0 * c1 + s0 * s1), abs(c0 * s1 - s0 * c1), half * (abs(c1) + abs(s1)) + spare
    long, wide = max(length, length * c + width * s) + corner, max(width, length * s + width * c) + corner
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            if solid[row, column] == 0:
                continue
            x, y = (np.float32(column) - HALF) * cell, (np.float32(row) - HALF) * cell
            dx0, dy0, dx1, dy1 = x - x0, y - y0, x - x1, y - y1
            if not _passes(
                dx0 * c1 + dy0 * s1, dx1 * c1 + dy1 * s1, dy0 * c1 - dx0 * s1, dy1 * c1 - dx1 * s1, long, wide
            ) and touch_between(
                x0, y0, c0, s0, x1, y1, c1, s1, x, y, ONE, ZERO, x, y, ONE, ZERO, half, half, ZERO, back, ZERO, p, p
            ):  # fmt: skip
                return True
    return False


@inline
def touches_shelf(x0, y0, c0, s0, x1, y1, c1, s1, way, back, between, p, solid):
    """Return where a robot's body touches a shelf or the rim in a motion: AT_END, else, if asked, BETWEEN, or NOWHERE.

    x, y: its centre [m]; c, s: its heading; way: of any point of it at most [m], which leaves its chord by an eighth of
    way^2 / far at most; back: see `turns_back`. Along the axes of the floor a body is apart from all cells but those
    that the box around it at both ends meets.
    """
    length, width, cell, half = p["half_length"], p["half_width"], p["cell"], HALF * p["cell"]
    spare = _EIGHTH * way * way / p["far"] + back + ROUNDING
    ex0, ey0 = length * abs(c0) + width * abs(s0), length * abs(s0) + width * abs(c0)
    ex1, ey1 = length * abs(c1) + width * abs(s1), length * abs(s1) + width * abs(c1)
    (rows, columns), scale, more, near = solid.shape, ONE / cell, spare + _ON_FLOOR, False
    first_row = max(int((min(y0 - ey0, y1 - ey1) - more) * scale + ONE), 0)  # under 0 is rounded up, to the rim
    last_row = min(int((max(y0 + ey0, y1 + ey1) + more) * scale) + 1, rows - 1)
    first_column = max(int((min(x0 - ex0, x1 - ex1) - more) * scale + ONE), 0)
    last_column = min(int((max(x0 + ex0, x1 + ex1) + more) * scale) + 1, columns - 1)
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            if solid[row, column] != 0:
                near = between
                dx, dy = (np.float32(column) - HALF) * cell - x1, (np.float32(row) - HALF) * cell - y1
                if rectangles_touch(dx, dy, c1, s1, length, width, ONE, ZERO, half, half):
                    return AT_END
    if near and _touch_cell(
        first_row, last_row, first_column, last_column, x0, y0, c0, s0, x1, y1, c1, s1, spare, back, p, solid
    ):  # fmt: skip
        return BETWEEN
    return NOWHERE
