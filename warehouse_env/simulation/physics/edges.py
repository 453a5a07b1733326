"""The shelves' edges for the lidar: for every cell, those that face it, lie in range and are not hidden.

Made once per map and range. A ray then meets a handful of edges instead of cells; a run of shelves has only one edge.
"""

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


def _merged(solid: NDArray[np.uint8]) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Number the longest straight edges of the padded floor `solid` (y up).

    Returns the edges float64[K, 4] as face, line, low, high in cells; and of each cell's sides the edge, or -1,
    int32[4, H + 2, W + 2].
    """
    cell_edges, edges, found = np.full((_FACES, *solid.shape), -1, dtype=np.int32), list[NDArray[np.float64]](), 0
    for face in range(_FACES):
        across_x, step = face in (WEST, EAST), 1 if face in (WEST, SOUTH) else -1  # to the shelf that a free cell faces
        shelf = (solid.T if across_x else solid) != 0
        faces = ~shelf & np.roll(shelf, -step, axis=0)  # the rim is shelf, so nothing comes round
        starts, ends = (faces & ~np.roll(faces, shift, axis=1) for shift in (1, -1))
        numbers = np.where(faces, np.cumsum(starts).reshape(faces.shape) - 1 + found, -1)
        cell_edges[face] = numbers.T if across_x else numbers
        line, low = np.nonzero(starts)
        edges.append(np.column_stack([np.full(len(line), face), line + (step > 0), low, np.nonzero(ends)[1] + 1.0]))
        found += len(line)
    return np.concatenate(edges), cell_edges


@inline
def _all_cross(row, column, edge, wall):
    """Whether every line of sight from the cell to an edge crosses another edge, the wall, so that it is hidden."""
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
    """Return the squared distance from the cell to an edge [cells^2], infinite if the edge faces away."""
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
    """Write which of the edges `near` int32[M] another one hides from the cell; ways: squared distance of each.

    An edge can be hidden only by a nearer one that is seen itself, or by one equally far: comparing with these alone
    keeps long ranges fast.
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
    """Return (seen, its length, first) of Edges; a shelf's cell sees nothing."""
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
    """Return the edges and discs of a floor within lidar_range [m].

    solid: uint8[H + 2, W + 2], padded shelves, y up; cell [m]; discs: float32[K, 3], see GridMap.
    """
    edges, cell_edges = _merged(solid)
    seen, length, first = _lists(solid, cell_edges, edges, lidar_range / cell)
    seen = seen[:length].copy()
    metres = ((edges[:, 1:] - 1.0) * cell).astype(np.float32)  # without the padding
    for array in (metres, seen, first):
        array.flags.writeable = False
    return Edges(metres, seen, first, discs_near(discs, lidar_range, solid.shape, cell))
