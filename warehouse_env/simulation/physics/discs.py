"""Discs on the floor, such as pillars: contact with bodies, also between two samples, and lidar.

Kernels take the discs of a floor, or None: Numba does not compile a branch on an argument that is None.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, part
from warehouse_env.maps.discs import cells_near
from warehouse_env.simulation.physics.geometry import Rectangle, half_box, squared_distance_to
from warehouse_env.simulation.physics.sweep import ROUNDING, arc_of, turned
from warehouse_env.simulation.physics.trigonometry import ONE, ZERO, arc_tan2, sin_cos

_TWO = np.float32(2.0)
_STRAIGHT = np.float32(1e-3)  # [rad] under which an arc is a line
_MOST = 1 << 16  # steps along an arc after which the body counts as touching
LISTED = 1e-3  # [m] from a cell up to which it lists a disc, so that rounding leaves none out


class Discs(NamedTuple):
    """Discs, and the discs near each padded cell, y up."""

    discs: NDArray[np.float32]  # [K, 3]: x, y, radius [m]
    near: NDArray[np.int32]  # indices of discs by padded cell, one list after another
    first: NDArray[np.int32]  # [H + 2, W + 3], where a cell's list begins in `near`; it ends where the next one begins


def discs_near(discs: NDArray[np.float32], margin: float, shape: tuple[int, ...], cell: float) -> Discs | None:
    """Return the discs within `margin` [m] of each padded cell; None if there are none.

    shape: of the padded floor, (H + 2, W + 2) cells of `cell` [m].
    """
    if not len(discs):
        return None
    shift = np.array([cell, cell, 0.0])
    at, who = list[NDArray[np.int64]](), list[NDArray[np.int64]]()
    for k, disc in enumerate(discs.astype(np.float64)):
        row, column = cells_near(disc + shift, margin, shape, cell).T
        at.append(row * shape[1] + column)
        who.append(np.full(len(row), k))
    order = np.argsort(np.concatenate(at), kind="stable")
    ends = np.cumsum(np.bincount(np.concatenate(at), minlength=shape[0] * shape[1])).reshape(shape)
    first = np.zeros((shape[0], shape[1] + 1), np.int32)
    first[:, 1:] = ends
    first[1:, 0] = ends[:-1, -1]
    return Discs(discs, np.concatenate(who)[order].astype(np.int32), first)


def lower_clearance(clearance: NDArray[np.uint8], discs: NDArray[np.float32], step: float, unit: float) -> None:
    """Lower a field of clearance uint8[R, C] by discs; step [m]: of its samples; unit [m]: of a count; see Floor."""
    most = 255 * unit
    for x, y, radius in discs.astype(np.float64):
        reach = radius + most + step
        rows, columns = (slice(max(int((at - reach) / step), 0), max(int((at + reach) / step) + 1, 0)) for at in (y, x))
        part = clearance[rows, columns]
        dy = (np.arange(part.shape[0]) + rows.start + 0.5) * step - y
        dx = (np.arange(part.shape[1]) + columns.start + 0.5) * step - x
        distance = np.hypot(dy[:, None], dx[None, :]) - radius - step * np.sqrt(0.5)
        np.minimum(part, np.clip(distance / unit, 0.0, 255.0).astype(np.uint8), out=part)


@inline
def reached_rows(low, high, count, cell):
    """Return the first and the last of `count` padded rows that lie between two places [m]; none: last < first."""
    return max(int(np.ceil(low / cell)), 0), min(int(np.floor(high / cell)) + 1, count - 1)


@inline
def reached_columns(low, high, count, cell):
    """Return the first and the last of `count` padded columns as `reached_rows` does, both where there are any."""
    return min(max(int(np.ceil(low / cell)), 0), count - 1), max(min(int(np.floor(high / cell)) + 1, count - 1), -1)


@part
def meets_disc(body, floor, discs):
    """Return whether a closed Rectangle touches one of the discs of a floor."""
    if discs is None:
        return False
    (ex, ey), cell, (rows, columns) = half_box(body), floor.cell, floor.solid.shape
    first_row, last_row = reached_rows(body.y - ey, body.y + ey, rows, cell)
    left, right = reached_columns(body.x - ex, body.x + ex, columns, cell)
    for row in range(first_row, last_row + 1):
        for k in range(discs.first[row, left], discs.first[row, right + 1]):
            e = discs.near[k]
            radius = discs.discs[e, 2]
            if squared_distance_to(discs.discs[e, 0], discs.discs[e, 1], body) <= radius * radius:
                return True
    return False


@inline
def _on_arc(start, arc, half, t, offset):
    """Return the body, a Rectangle, after a share t of an arc of its axle, on which it turns by twice `half` [rad]."""
    s, c = sin_cos(t * half)
    share = t if abs(half) < _STRAIGHT else s / sin_cos(half)[0]
    chord_s, chord_c = sin_cos((t - ONE) * half)
    dx, dy = turned(share * arc.x, share * arc.y, chord_c, chord_s)
    to_c, to_s = turned(start.c, start.s, c * c - s * s, _TWO * c * s)
    x, y = start.x + offset * (start.c - to_c) + dx, start.y + offset * (start.s - to_s) + dy
    return Rectangle(x, y, to_c, to_s, start.length, start.width)


@part
def keeps_off_disc(x, y, radius, body, way, p):
    """Whether a body, a Sweep, keeps off a disc at (x, y) [m] between two samples; way: of its fastest point [m].

    Conservative advancement: the body moves along its arc by the room that it has.
    """
    offset, t = p["offset"], ZERO
    arc = arc_of(body.start, body.end, offset)
    half = arc_tan2(arc.s, arc.c)
    for _ in range(_MOST):
        at = _on_arc(body.start, arc, half, t, offset)
        room = np.sqrt(squared_distance_to(x, y, at)) - radius - body.back
        if room <= ROUNDING:
            return False
        t += room / way
        if t >= ONE:
            return True
    return False


@part
def touches_disc(body, way, between, p, floor, discs):
    """Whether a robot's body touches a disc in a motion, as `sweep.touches_cell` does for shelves."""
    if discs is None:
        return False
    (start, end), cell, r = (body.start, body.end), p["cell"], p["radius"] + way
    rows, columns = floor.solid.shape
    first_row, last_row = reached_rows(min(start.y, end.y) - r, max(start.y, end.y) + r, rows, cell)
    left, right = reached_columns(min(start.x, end.x) - r, max(start.x, end.x) + r, columns, cell)
    for row in range(first_row, last_row + 1):
        for k in range(discs.first[row, left], discs.first[row, right + 1]):
            e = discs.near[k]
            x, y, radius = discs.discs[e, 0], discs.discs[e, 1], discs.discs[e, 2]
            if squared_distance_to(x, y, end) <= radius * radius:
                return True
            if between and not keeps_off_disc(x, y, radius, body, way, p):
                return True
    return False


@part
def scan_discs(cx, cy, row, column, discs, turned, out):
    """Shorten the rays from (cx, cy) [m] that meet a disc.

    row, column: of the padded cell there; turned float32[2 or more, R]: the rays' directions; out [m]: R or more.
    """
    if discs is None:
        return
    for n in range(discs.first[row, column], discs.first[row, column + 1]):
        e = discs.near[n]
        dx, dy, radius = discs.discs[e, 0] - cx, discs.discs[e, 1] - cy, discs.discs[e, 2]
        squared = radius * radius
        within = dx * dx + dy * dy <= squared
        for k in range(turned.shape[1]):
            along = dx * turned[0, k] + dy * turned[1, k]
            aside = dy * turned[0, k] - dx * turned[1, k]
            left = squared - aside * aside
            distance = along - np.sqrt(left if left > ZERO else ZERO)
            distance = ZERO if within else distance
            meets = (left >= ZERO) & (distance >= ZERO) & (distance < out[k])
            out[k] = distance if meets | within else out[k]
