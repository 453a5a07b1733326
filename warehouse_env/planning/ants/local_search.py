"""Local search on a path: dynamic programming over its nodes with straight-then-diagonal links. Beyond the papers.

An ant finds the right way round the shelves long before the shortest and straightest line along it. So some of its
cells are kept and joined by octile links of at most two segments (diagonal then straight, or the reverse) that obey
eq. 26. Of all such choices this finds the one with the least (length + tolls, turns) exactly, in O(n^2) for n cells. A
detour that saves more tolls than it costs is kept.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, kernel
from warehouse_env.maps.grid_map import MOVES
from warehouse_env.planning.ants.walks import measure, next_best
from warehouse_env.planning.plan import MICRO

_SQRT2 = math.sqrt(2.0)
_BY_SIGNS = np.array([(3, 2, 1), (4, 2, 0), (5, 6, 7)])  # indices into MOVES


class Runs(NamedTuple):
    """Straight runs from every cell in every direction, so that a link is checked and priced in O(1)."""

    free: NDArray[np.int32]  # [C, 8], legal steps from the cell on
    toll: NDArray[np.int64]  # [C, 8], the tolls of all of them


class PathNodes(NamedTuple):
    """The n nodes of a path."""

    cell: NDArray[np.int64]  # [n]
    row: NDArray[np.int64]  # [n]
    column: NDArray[np.int64]  # [n]


class PathStates(NamedTuple):
    """The best link to each state: a node and the move that arrives at it."""

    cost: NDArray[np.float64]  # [n, 8], inf before any link
    sums: NDArray[np.int64]  # [n, 8, 4]: straight steps, diagonal steps, tolls, turns
    origin: NDArray[np.int64]  # [n, 8, 3]: node before, its arriving move (-1 at the start), the link's first move


class Departures(NamedTuple):
    """What a node is left with, by the leaving move."""

    before: NDArray[np.int64]  # [8], the arriving move to go on from; -1 at the start
    base: NDArray[np.int64]  # [8, 4], its sums, with the turn


@kernel
def straight_runs(floor):
    """Measure the legal runs of a floor."""
    cells, columns = floor.neighbour.shape[0], floor.columns
    free = np.zeros((cells, 8), np.int32)
    toll = np.zeros((cells, 8), np.int64)
    for move in range(8):
        # A run's end is known before its beginning if cells are taken against the move.
        backwards = MOVES[move, 0] * columns + MOVES[move, 1] > 0
        for k in range(cells):
            cell = cells - 1 - k if backwards else k
            to = floor.neighbour[cell, move]
            if to != cell:
                free[cell, move] = free[to, move] + 1
                toll[cell, move] = toll[to, move] + floor.toll[cell, move]
    return Runs(free, toll)


@kernel
def improve(floor, runs, elite, walks):
    """Measure all walks, shorten the best `elite` of them, and return the best ant; -1 if none arrived.

    Paths with the same cost and turns count as the same, and only one of them is shortened.
    """
    ants = len(walks.steps)
    measure(floor, walks, 0, ants)
    chosen = np.empty(elite, np.int64)
    count, cost, turns = 0, -1.0, 0
    while count < elite:
        ant = next_best(walks, 0, ants, cost, turns)
        if ant < 0:
            break
        cost, turns = walks.cost[ant], walks.turns[ant]
        chosen[count] = ant
        count += 1
    for ant in chosen[:count]:
        moves = shorten(floor, runs, walks.start[ant], walks.moves[ant, : walks.steps[ant]])
        walks.moves[ant, : len(moves)] = moves
        walks.steps[ant] = len(moves)
        measure(floor, walks, ant, ant + 1)
    return next_best(walks, 0, ants, -1.0, 0)


@kernel
def shorten(floor, runs, start, moves):
    """Return the best choice of nodes and links along the path int8[n - 1] of moves from start, as moves again."""
    n = len(moves) + 1
    nodes = PathNodes(np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int64))
    cell = start
    for step in range(n):
        nodes.cell[step], nodes.row[step], nodes.column[step] = cell, cell // floor.columns, cell % floor.columns
        if step < n - 1:
            cell = floor.neighbour[cell, moves[step]]
    # Sums are whole numbers, so equal costs are equal floats.
    states = PathStates(np.full((n, 8), np.inf), np.zeros((n, 8, 4), np.int64), np.full((n, 8, 3), -1, np.int64))
    departures = Departures(np.full(8, -1, np.int64), np.zeros((8, 4), np.int64))
    for i in range(n - 1):
        if i > 0:
            _choose_arrivals(states.cost[i], states.sums[i], departures)
        _link_onwards(floor, runs, nodes, i, departures, states)
    return _unroll(floor, nodes.cell, states)


@kernel
def _link_onwards(floor, runs, nodes, i, departures, states):
    """Try every link from node i to a later one: the diagonal first, and the straight first."""
    before, base = departures
    cost, sums, origin = states
    node, rows, columns = nodes
    start, row, column = node[i], rows[i], columns[i]
    for j in range(i + 1, len(node)):
        d_row, d_column = rows[j] - row, columns[j] - column
        diagonal = min(abs(d_row), abs(d_column))
        straight = max(abs(d_row), abs(d_column)) - diagonal
        for order in range(2 if straight > 0 and diagonal > 0 else 1):
            steep = abs(d_row) >= abs(d_column)
            first, second = _move(d_row, d_column), _move(d_row if steep else 0, 0 if steep else d_column)
            steps, more = diagonal, straight
            if order == 1 or diagonal == 0:
                first, second, steps, more = second, first, straight, diagonal
            second = second if more > 0 else first
            a, b = base[first, 0] + straight, base[first, 1] + diagonal
            if runs.free[start, first] < steps or a + b * _SQRT2 > cost[j, second]:  # cut off, or worse without tolls
                continue
            corner = start + steps * (MOVES[first, 0] * floor.columns + MOVES[first, 1])
            if runs.free[corner, second] < more:
                continue
            tolls = base[first, 2] + runs.toll[start, first] - runs.toll[corner, first]
            tolls += runs.toll[corner, second] - runs.toll[node[j], second]
            turned = base[first, 3] + (1 if first != second else 0)
            total = (a + b * _SQRT2) + tolls / MICRO
            if total < cost[j, second] or (total == cost[j, second] and turned < sums[j, second, 3]):
                cost[j, second] = total
                sums[j, second, 0], sums[j, second, 1] = a, b
                sums[j, second, 2], sums[j, second, 3] = tolls, turned
                origin[j, second, 0], origin[j, second, 1], origin[j, second, 2] = i, before[first], first


@inline
def _move(d_row, d_column):
    """Return the move whose steps have the signs of these differences."""
    return _BY_SIGNS[1 + np.sign(d_row), 1 + np.sign(d_column)]


@kernel
def _choose_arrivals(cost, sums, departures):
    """Write for each leaving move the arriving move of a node that is best to go on from, and its sums with a turn."""
    before, base = departures
    least = 0
    for move in range(1, 8):
        if cost[move] < cost[least] or (cost[move] == cost[least] and sums[move, 3] < sums[least, 3]):
            least = move
    for leaving in range(8):
        straight_on = cost[leaving] == cost[least] and sums[leaving, 3] <= sums[least, 3] + 1
        before[leaving] = leaving if straight_on else least
        base[leaving] = sums[before[leaving]]
        base[leaving, 3] += 0 if straight_on else 1


@kernel
def _unroll(floor, node, states):
    """Follow the links back from the best state of the last node and write them out as moves."""
    cost, sums, origin = states
    j = len(node) - 1
    arrived = 0
    for move in range(1, 8):
        tied = cost[j, move] == cost[j, arrived] and sums[j, move, 3] < sums[j, arrived, 3]
        if cost[j, move] < cost[j, arrived] or tied:
            arrived = move
    end = sums[j, arrived, 0] + sums[j, arrived, 1]
    moves = np.empty(end, np.int8)
    while j > 0:
        i, before, first = origin[j, arrived, 0], origin[j, arrived, 1], origin[j, arrived, 2]
        d_row = abs(node[j] // floor.columns - node[i] // floor.columns)
        d_column = abs(node[j] % floor.columns - node[i] % floor.columns)
        steps, diagonal = max(d_row, d_column), min(d_row, d_column)
        first_steps = steps if first == arrived else (diagonal if first % 2 else steps - diagonal)
        moves[end - steps : end - steps + first_steps] = first
        moves[end - steps + first_steps : end] = arrived
        end -= steps
        j, arrived = i, before
    return moves
