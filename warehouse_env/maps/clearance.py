"""Numba kernels for the distance of points and segments from shelves: squares of the map and its rim.

solid: uint8[H + 2, W + 2], shelves with a rim; its square [i, j] lies from ((j - 1) cell, (i - 1) cell) on. Imported
only when first needed, because importing numba takes about 0.4 s.
"""

import math

from warehouse_env.kernel import inline, kernel


@kernel
def distance(ax, ay, bx, by):
    """Return the distance of two points, the same to the bit in compiled and in plain Python."""
    return math.sqrt((bx - ax) * (bx - ax) + (by - ay) * (by - ay))


@inline
def nearest_shelf(solid, x, y, cell, reach):
    """Return (distance, unit vector away from it) of the nearest shelf within `reach` of a point.

    A shelf farther away may be found as well; without any the distance is 1e9.
    """
    reach += 1e-9  # so that rounding leaves none out
    first_row, last_row = int(math.floor((y - reach) / cell)) + 1, int(math.floor((y + reach) / cell)) + 1
    first, last = int(math.floor((x - reach) / cell)) + 1, int(math.floor((x + reach) / cell)) + 1
    best, bx, by = 1e18, 0.0, 0.0
    for i in range(max(first_row, 0), min(last_row + 1, solid.shape[0])):
        for j in range(max(first, 0), min(last + 1, solid.shape[1])):
            if solid[i, j]:
                dx = x - min(max(x, (j - 1) * cell), j * cell)
                dy = y - min(max(y, (i - 1) * cell), i * cell)
                d = dx * dx + dy * dy
                if d < best:
                    best, bx, by = d, dx, dy
    d = math.sqrt(best)
    if d < 1e-9:
        return d, 0.0, 0.0
    return d, bx / d, by / d


@kernel
def crosses(ax, ay, bx, by, low_x, low_y, side):
    """Return whether the segment a-b has a point in the closed square (clipping by its four sides)."""
    first, last = 0.0, 1.0
    for start, step, low in ((ax, bx - ax, low_x), (ay, by - ay, low_y)):
        if step == 0.0:
            if start < low or start > low + side:
                return False
            continue
        enter, leave = (low - start) / step, (low + side - start) / step
        first, last = max(first, min(enter, leave)), min(last, max(enter, leave))
    return first <= last


@kernel
def _segment_to_square(ax, ay, bx, by, low_x, low_y, side):
    """Return the distance between the segment a-b and a closed square: of an end or of a corner, or 0."""
    if crosses(ax, ay, bx, by, low_x, low_y, side):
        return 0.0
    best = math.inf
    for x, y in ((ax, ay), (bx, by)):
        dx, dy = min(max(x, low_x), low_x + side) - x, min(max(y, low_y), low_y + side) - y
        best = min(best, dx * dx + dy * dy)
    ux, uy = bx - ax, by - ay
    length = ux * ux + uy * uy
    for x in (low_x, low_x + side):
        for y in (low_y, low_y + side):
            at = min(max(((x - ax) * ux + (y - ay) * uy) / length, 0.0), 1.0) if length > 0.0 else 0.0
            dx, dy = x - ax - at * ux, y - ay - at * uy
            best = min(best, dx * dx + dy * dy)
    return math.sqrt(best)


@kernel
def segment_gap(solid, ax, ay, bx, by, cell, reach):
    """Return the distance from the segment a-b to the nearest shelf or rim, at most `reach`.

    solid: uint8[H + 2, W + 2], shelves with a rim; its square [i, j] lies from ((j - 1) cell, (i - 1) cell) on.
    """
    best = reach
    first_row = max(int(math.floor((min(ay, by) - reach) / cell)) + 1, 0)
    last_row = min(int(math.floor((max(ay, by) + reach) / cell)) + 1, solid.shape[0] - 1)
    first_column = max(int(math.floor((min(ax, bx) - reach) / cell)) + 1, 0)
    last_column = min(int(math.floor((max(ax, bx) + reach) / cell)) + 1, solid.shape[1] - 1)
    for i in range(first_row, last_row + 1):
        for j in range(first_column, last_column + 1):
            if solid[i, j]:
                best = min(best, _segment_to_square(ax, ay, bx, by, (j - 1) * cell, (i - 1) * cell, cell))
    return best
