"""The shelves' edges as the lidar sees them: for every cell, the few that face it, lie in range and are not hidden.

Made once per map and range. A ray then meets no cells but a handful of edges, of which a run of shelves has only one.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, kernel
from warehouse_env.simulation.physics.discs import Discs, discs_near

_EXACT = 1e-9  # [cells] rounding of the crossings below
WEST, EAST, SOUTH, NORTH = 0, 1, 2, 3  # where an edge faces: to its free side
_FACES = 4


class Edges(NamedTuple):
    """Static arrays of one map and lidar range. An edge runs along x = line or y = line, from `low` to `high`."""

    edges: NDArray[np.float32]  # [K, 3]: line, low, high [m]
    seen: NDArray[np.int32]  # edges by cell, one list after another; of each, those along x = line come first
    first: NDArray[np.int32]  # [H + 2, W + 2, 3]: where a cell's list begins, where those along y begin, its end
    discs: Discs | None


class Edge(NamedTuple):
    """An edge, in cells of the padded floor."""

    face: int
    line: float
    low: float
    high: float


@inline
def _edge(edges, k):
    """Return edge k of float64[K, 4]."""
    return Edge(int(edges[k, 0]), edges[k, 1], edges[k, 2], edges[k, 3])


@kernel
def _merged(solid, cell_edges):
    """Number the longest straight edges; cell_edges int32[4, H + 2, W + 2]: that of each free cell's side, or -1.

    Returns the edges as float64[K, 4]: face, line, low, high, in cells of the padded floor `solid` (y up).
    """
    rows, columns = solid.shape
    found, edges = 0, np.empty((4 * rows * columns, 4))
    for face in range(_FACES):
        across_x = face in (WEST, EAST)
        step = 1 if face in (WEST, SOUTH) else -1  # from the free cell to the shelf it looks at
        outer, inner = (columns, rows) if across_x else (rows, columns)
        for a in range(outer):
            b = 0
            while b < inner:
                row, column = (b, a) if across_x else (a, b)
                other_row, other_column = (row, column + step) if across_x else (row + step, column)
                inside = 0 <= other_row < rows and 0 <= other_column < columns
                if not inside or solid[row, column] != 0 or solid[other_row, other_column] == 0:
                    b += 1
                    continue
                low = b
                while b < inner:
                    row, column = (b, a) if across_x else (a, b)
                    other_row, other_column = (row, column + step) if across_x else (row + step, column)
                    if solid[row, column] != 0 or solid[other_row, other_column] == 0:
                        break
                    cell_edges[face, row, column] = found
                    b += 1
                edges[found, 0], edges[found, 1] = face, a + 1 if step > 0 else a
                edges[found, 2], edges[found, 3] = low, b
                found += 1
    return edges[:found]


@inline
def _all_cross(row, column, edge, wall):
    """Whether every line of sight from the cell to an edge crosses another one, the wall: it is hidden."""
    across_x, wall_across_x = edge.face < SOUTH, wall.face < SOUTH  # does it run along x = line?
    sign = 1.0 if wall.face in (WEST, SOUTH) else -1.0  # on which side of the wall's line its shelf is
    for end in range(2):
        far = edge.low if end == 0 else edge.high
        far_x, far_y = (edge.line, far) if across_x else (far, edge.line)
        across, beside = (far_x, far_y) if wall_across_x else (far_y, far_x)
        if sign * (across - wall.line) < 0.0:
            return False
        for corner in range(4):
            near_x, near_y = float(column + corner % 2), float(row + corner // 2)
            from_across, from_beside = (near_x, near_y) if wall_across_x else (near_y, near_x)
            if across == from_across:
                return False
            at = from_beside + (wall.line - from_across) / (across - from_across) * (beside - from_beside)
            if at < wall.low - _EXACT or at > wall.high + _EXACT:
                return False
    return True


@kernel
def _squared_way(row, column, edge):
    """Return the squared distance from the cell to an edge [cells^2], infinite if it does not face the cell."""
    face, line, low, high = edge
    across, beside = (column, row) if face in (WEST, EAST) else (row, column)
    away = line - (across + 1) if face in (WEST, SOUTH) else across - line
    aside = max(max(low - (beside + 1), beside - high), 0.0)
    return away * away + aside * aside if away >= 0.0 else np.inf


@kernel
def _candidates(row, column, cell_edges, edges, reach, marks, out, ways):
    """Write the edges that face a cell within `reach` [cells], each once, and their squared ways; return their number.

    marks int32[K]: the last cell that has looked at an edge.
    """
    _, rows, columns = cell_edges.shape
    mark = row * columns + column + 1
    span = int(math.ceil(min(reach, rows + columns))) + 1
    count = 0
    for r in range(max(row - span, 0), min(row + span + 1, rows)):
        for c in range(max(column - span, 0), min(column + span + 1, columns)):
            for face in range(_FACES):
                k = cell_edges[face, r, c]
                if k >= 0 and marks[k] != mark:
                    marks[k] = mark
                    ways[count] = _squared_way(row, column, _edge(edges, k))
                    if ways[count] <= reach * reach:
                        out[count] = k
                        count += 1
    return count


@kernel
def _hide(row, column, edges, near, ways, hidden):
    """Say which of the edges `near` int32[M] are hidden from the cell by another of them; ways: of each, squared.

    Lines of sight meet what hides before what is hidden, so it is no farther; and behind what is hidden itself, all is
    hidden by the same edge. So each is held against those before it that are seen, and those as far away: else a long
    range takes minutes.
    """
    order, front, seen = np.argsort(ways, kind="mergesort"), np.empty(len(near), np.int32), 0  # stable
    for n in range(len(near)):
        e = near[order[n]]
        as_far = n + 1
        while as_far < len(near) and ways[order[as_far]] == ways[order[n]]:
            as_far += 1
        hidden[order[n]] = False
        for k in range(seen + as_far - n - 1):
            w = front[k] if k < seen else near[order[n + 1 + k - seen]]
            if _all_cross(row, column, _edge(edges, e), _edge(edges, w)):
                hidden[order[n]] = True
                break
        if not hidden[order[n]]:
            front[seen] = e
            seen += 1


@kernel
def _lists(solid, cell_edges, edges, reach):
    """Return (seen, its length, first) of Edges; nothing is seen from a shelf's cell."""
    rows, columns = solid.shape
    first = np.zeros((rows, columns, 3), np.int32)
    marks = np.zeros(len(edges), np.int32)
    near, ways, hidden = np.empty(len(edges), np.int32), np.empty(len(edges) + 1), np.empty(len(edges), np.bool_)
    seen, length = np.empty(rows * columns, np.int32), 0
    for row in range(rows):
        for column in range(columns):
            count = 0
            if solid[row, column] == 0:
                count = _candidates(row, column, cell_edges, edges, reach, marks, near, ways)
                _hide(row, column, edges, near[:count], ways[:count], hidden)
            if length + count > len(seen):
                seen = np.concatenate((seen[:length], np.empty(length + 2 * count, np.int32)))
            first[row, column, 0] = length
            for along_y in range(2):
                for k in range(count):
                    if hidden[k] or (edges[near[k], 0] in (SOUTH, NORTH)) != (along_y == 1):
                        continue
                    seen[length] = near[k]
                    length += 1
                first[row, column, 1 + along_y] = length
    return seen, length, first


def edges_of(solid: NDArray[np.uint8], cell: float, lidar_range: float, discs: NDArray[np.float32]) -> Edges:
    """Return the edges of a floor, with its discs beside them if there are any.

    solid: uint8[H + 2, W + 2], padded shelves, y up; cell [m]; lidar_range [m]; discs: float32[K, 3], see GridMap.
    """
    cell_edges = np.full((_FACES, *solid.shape), -1, dtype=np.int32)
    edges = _merged(solid, cell_edges)
    seen, length, first = _lists(solid, cell_edges, edges, lidar_range / cell)
    seen = seen[:length].copy()
    metres = ((edges[:, 1:] - 1.0) * cell).astype(np.float32)  # without the padding
    for array in (metres, seen, first):
        array.flags.writeable = False
    return Edges(metres, seen, first, discs_near(discs, lidar_range, solid.shape, cell))
