"""Numba kernels over the cells of a map: exact distance fields and cut cells.

Fields use label setting with buckets of width 1 (Dial 1969): no move is shorter than 1, so a cell in the current bucket
can no longer improve, and no heap is needed. A move reaches at most two buckets ahead, so three lists suffice. A length
is kept as two counts, straight and diagonal, so it does not depend on the order of adding.

Imported only when first needed, because importing numba takes about 0.4 s.
"""

import numpy as np

from warehouse_env.kernel import kernel

SQRT2 = float(np.sqrt(2.0))


@kernel
def distance_field(legal, moves, row, column):
    """Return float64[H, W]: length [cells] of the shortest walk of eq. 26 moves to (row, column), inf if there is none.

    legal: bool[H, W, 8], `GridMap.entries` (with `GridMap.legal_moves`: of the walk from there); moves: int64[8, 2],
    odd indices diagonal (length sqrt 2).
    """
    rows, columns = legal.shape[0], legal.shape[1]
    distance = np.full(rows * columns, np.inf)
    straight = np.zeros(rows * columns, np.int32)
    diagonal = np.zeros(rows * columns, np.int32)
    buckets = np.empty((3, rows * columns), np.int32)
    sizes = np.zeros(3, np.int64)
    goal = row * columns + column
    distance[goal] = 0.0
    buckets[0, 0] = goal
    sizes[0] = 1
    level = 0
    while sizes[0] + sizes[1] + sizes[2] > 0:
        now = level % 3
        for i in range(sizes[now]):
            cell = buckets[now, i]
            if distance[cell] < level:  # reached from an earlier bucket after it was put in this one
                continue
            r, c = cell // columns, cell % columns
            for m in range(8):
                if not legal[r, c, m]:
                    continue
                other = cell + moves[m, 0] * columns + moves[m, 1]
                s = straight[cell] + 1 - m % 2
                d = diagonal[cell] + m % 2
                length = s + d * SQRT2
                before = distance[other]
                if length < before:
                    distance[other], straight[other], diagonal[other] = length, s, d
                    target = int(length)
                    if before == np.inf or int(before) != target:  # once a bucket is enough
                        buckets[target % 3, sizes[target % 3]] = other
                        sizes[target % 3] += 1
        sizes[now] = 0
        level += 1
    return distance.reshape((rows, columns))


@kernel
def cut_cells(free):
    """Return bool[H, W]: free cells whose removal disconnects their region (Hopcroft and Tarjan 1973)."""
    rows, columns = free.shape
    order, low = np.zeros(rows * columns, np.int32), np.zeros(rows * columns, np.int32)
    parent, tried = np.full(rows * columns, -1, np.int32), np.zeros(rows * columns, np.uint8)
    cut = np.zeros(rows * columns, np.bool_)
    count = 0
    for root in range(rows * columns):
        if order[root] != 0 or not free[root // columns, root % columns]:
            continue
        count += 1
        order[root] = low[root] = count
        at, branches = root, 0
        while at >= 0:
            k, r, c = tried[at], at // columns, at % columns
            tried[at] += 1
            if k < 4:
                a, b = r + (k == 1) - (k == 3), c + (k == 0) - (k == 2)
                if a < 0 or b < 0 or a >= rows or b >= columns or not free[a, b]:
                    continue
                other = a * columns + b
                if order[other] == 0:
                    count += 1
                    order[other] = low[other] = count
                    parent[other] = at
                    at = other
                elif other != parent[at]:
                    low[at] = min(low[at], order[other])
                continue
            up = parent[at]
            if up == root:
                branches += 1
            elif up >= 0:
                cut[up] |= low[at] >= order[up]
            if up >= 0:
                low[up] = min(low[up], low[at])
            at = up
        cut[root] = branches > 1
    return cut.reshape((rows, columns))
