"""From a path of cells to a drivable line: smooth, off the shelves, and in the right-hand lane.

A lattice path runs beside shelves and turns on the spot; a rear-steer robot needs room for its tail, and meeting robots
need a side each. The line is relaxed like an elastic band: every point is drawn to its lane, to the middle of its
neighbours, and away from shelves nearer than CLEARANCE.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from warehouse_env.kernel import inline, kernel
from warehouse_env.maps.clearance import nearest_shelf

# lengths for the default body, in proportion for wider ones
SPACING = 0.5  # [m] between way-points
LANE_CLEARANCE = 0.55  # [m] from the right-hand wall in the narrowest two-way aisle
CLEARANCE = 0.6  # [m] from shelves, where there is room
SIGHT = 2.8  # [m] to either side within which a wall makes an aisle; aisles of up to 3 cells have two lanes
TWO_WAY = 1.2  # [m] of free width from which there are two lanes
FADE = 1.5  # [m] at both ends over which the lane is reached
NARROWER = 0.02  # [m] by which the clearance is less than half the free width
EASE = 0.15  # [m/m] sideways where a lane widens or narrows
ALONG = 0.9  # cosine of the angle to a one-way cell's direction up to which a line leads along it
ITERATIONS = 60
PULL, SMOOTH, PUSH = 0.12, 0.45, 0.5  # shares of the way to lane, neighbours and clearance in one iteration


class LaneFloor(NamedTuple):
    """The floor as lanes see it."""

    solid: Any  # uint8[H + 2, W + 2], padded shelves, y up
    one_way: Any  # uint8[H + 2, W + 2], likewise the directions of one-way cells
    cell: float  # [m]


@inline
def _free_to(floor, mine, x, y, ux, uy, sight):
    """Distance [m] along (ux, uy) to the first shelf, at most `sight`, in steps of 5 cm.

    mine > 0: to the first cell of another direction.
    """
    solid, one_way, cell = floor
    steps = round(sight / 0.05)
    for k in range(1, steps + 1):
        t = 0.05 * k - 0.025
        row = int(math.floor((y + t * uy) / cell)) + 1
        column = int(math.floor((x + t * ux) / cell)) + 1
        if row < 0 or column < 0 or row >= solid.shape[0] or column >= solid.shape[1] or solid[row, column]:
            return t
        if mine > 0 and one_way[row, column] != mine:
            return t
    return sight


@kernel
def _lane_shift(left, right, keep_right, wider):
    """Return the lane's offset to the right of the path [m], from the free widths to both sides; nan at a crossing."""
    width, sight = left + right, SIGHT * wider
    if width < TWO_WAY * wider:
        return 0.5 * (right - left)
    if keep_right <= 0.0:
        return 0.0
    if right < sight and left < sight:
        return right - min(max(0.25 * width, LANE_CLEARANCE * wider), 2.0 * keep_right)
    if right < sight:  # a wall to the right only: keep to it, as in a lane
        return min(right - LANE_CLEARANCE * wider, keep_right)
    return math.nan


@kernel
def _fill_gaps(shift, keep_right):
    """Replace runs of nan: between two lanes by the way from one to the other, on open floor by keep_right."""
    n = shift.shape[0]
    k = 0
    while k < n:
        if not math.isnan(shift[k]):
            k += 1
            continue
        first = k
        while k < n and math.isnan(shift[k]):
            k += 1
        before = shift[first - 1] if first > 0 else keep_right
        after = shift[k] if k < n else keep_right
        for m in range(first, k):
            part = (m - first + 1) / (k - first + 1)
            shift[m] = before + part * (after - before)


@kernel
def _ease_into_single_lanes(shift, room, wider):
    """Limit the lane's sideways change to EASE metres per metre around single lanes, which are fixed."""
    n = shift.shape[0]
    two_way, spacing = (0.5 * TWO_WAY - NARROWER) * wider, SPACING * wider
    for fixed in range(n):
        if room[fixed] >= two_way:
            continue
        for step in (-1, 1):
            k = fixed + step
            while 0 <= k < n and room[k] >= two_way:
                most = EASE * spacing * abs(k - fixed)
                shift[k] = min(max(shift[k], shift[fixed] - most), shift[fixed] + most)
                k += step


@kernel
def _along_one_way(one_way, x, y, ux, uy, cell):
    """Direction (an index into ARROWS) of the one-way cell at a point, 0 for none or if (ux, uy) leads across it."""
    row, column = int(math.floor(y / cell)) + 1, int(math.floor(x / cell)) + 1
    if row < 0 or column < 0 or row >= one_way.shape[0] or column >= one_way.shape[1]:
        return 0
    mine = int(one_way[row, column])
    along = 0.0 if mine == 0 else abs(ux) if mine % 2 == 1 else abs(uy)
    return mine if along > ALONG else 0


@kernel
def _lane_targets(points, floor, keep_right, wider, shift, room, out):
    """Write each point's target (right of the middle if there are two lanes), and its possible clearance."""
    n = points.shape[0]
    for k in range(n):
        ux, uy = _direction(points, k)
        mine = _along_one_way(floor.one_way, points[k, 0], points[k, 1], ux, uy, floor.cell)
        right = _free_to(floor, mine, points[k, 0], points[k, 1], uy, -ux, SIGHT * wider)
        left = _free_to(floor, mine, points[k, 0], points[k, 1], -uy, ux, SIGHT * wider)
        shift[k] = 0.5 * (right - left) if mine > 0 else _lane_shift(left, right, keep_right, wider)
        room[k] = min(CLEARANCE * wider, 0.5 * (left + right) - NARROWER * wider)
    _fill_gaps(shift, keep_right)
    _ease_into_single_lanes(shift, room, wider)
    for k in range(n):
        ux, uy = _direction(points, k)
        along = SPACING * wider * min(k, n - 1 - k)
        s = shift[k] * min(1.0, along / (FADE * wider))
        out[k, 0] = points[k, 0] + s * uy
        out[k, 1] = points[k, 1] - s * ux


@inline
def _direction(points, k):
    """Unit vector along the line at point k, over a metre to either side."""
    a, b = max(k - 2, 0), min(k + 2, points.shape[0] - 1)
    dx, dy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
    norm = math.sqrt(dx * dx + dy * dy)
    return (dx / norm, dy / norm) if norm > 1e-9 else (1.0, 0.0)


@kernel
def _relax(points, targets, room, solid, cell):
    """Move the inner points in place until lane, smoothness and clearance balance."""
    n = points.shape[0]
    for _ in range(ITERATIONS):
        for k in range(1, n - 1):
            x, y = points[k, 0], points[k, 1]
            mx = 0.5 * (points[k - 1, 0] + points[k + 1, 0])
            my = 0.5 * (points[k - 1, 1] + points[k + 1, 1])
            nx = x + PULL * (targets[k, 0] - x) + SMOOTH * (mx - x)
            ny = y + PULL * (targets[k, 1] - y) + SMOOTH * (my - y)
            d, ux, uy = nearest_shelf(solid, nx, ny, cell, room[k])
            if d < room[k]:
                nx += PUSH * (room[k] - d) * ux
                ny += PUSH * (room[k] - d) * uy
            points[k, 0], points[k, 1] = nx, ny


@inline
def distance(dx, dy):
    """Return sqrt(dx^2 + dy^2), corrected as glibc's hypot does (Borges 2021), since libraries and GPUs round apart."""
    high, low = max(abs(dx), abs(dy)), min(abs(dx), abs(dy))
    root = math.sqrt(high * high + low * low)
    if root == 0.0:
        return root
    if root <= 2.0 * low:
        off = root - low
        error = high * (2.0 * off - high) + (off - 2.0 * (high - low)) * off
    else:
        off = root - high
        error = 2.0 * off * (high - 2.0 * low) + ((4.0 * off - low) * low + off * off)
    return root - error / (2.0 * root)


@kernel
def resample(points, spacing):
    """Return the polyline float64[L, 2] [m] as evenly spaced points, nearest to `spacing` [m]; both ends are kept."""
    n = points.shape[0]
    arc = np.zeros(n)
    for k in range(1, n):
        arc[k] = arc[k - 1] + distance(points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1])
    length = arc[n - 1]
    pieces = max(int(round(length / spacing)), 1) if length > 0.0 else 0
    step = length / max(pieces, 1)
    line = np.empty((pieces + 1, 2))
    before = 0
    for k in range(pieces + 1):
        at = k * step if k < pieces else length
        while before + 1 < n and arc[before + 1] <= at and length > 0.0:
            before += 1
        for axis in range(2):
            line[k, axis] = points[before, axis]
            if arc[before] < at and before + 1 < n:
                slope = (points[before + 1, axis] - points[before, axis]) / (arc[before + 1] - arc[before])
                line[k, axis] += slope * (at - arc[before])
    return line


@kernel
def drivable_line(points, solid, one_way, cell, keep_right, wider=1.0, reach=np.inf):
    """Return way-points float32[R, 2] [m], evenly spaced about SPACING apart, from the first to the last point.

    points: float64[L, 2] [m], the planned path's cell centres; solid: uint8[H + 2, W + 2], padded shelves, y up;
    one_way: uint8[H + 2, W + 2], likewise the directions of one-way cells, in the middle of which lines run;
    keep_right [m]: offset of the default body to the right on open floor, 0 for no lanes; wider: width of the body over
    the default; reach [m]: how much of the line is drivable, the rest follows the planned path.
    """
    spacing, keep_right = SPACING * wider, keep_right * wider
    line = resample(points, spacing)
    near = line[: int(min(reach / spacing, np.float64(len(line)))) + 1]
    if len(near) > 2:
        targets, shift, room = np.empty_like(near), np.empty(len(near)), np.empty(len(near))
        _lane_targets(near, LaneFloor(solid, one_way, cell), keep_right, wider, shift, room, targets)
        _relax(near, targets, room, solid, cell)
        line = resample(line, spacing)
    return line.astype(np.float32)
