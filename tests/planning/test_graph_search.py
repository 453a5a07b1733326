"""The exact searches against hand-counted maps, a plain search, and an exhaustive search for turns."""

from __future__ import annotations

import heapq
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning import make_planner, min_turns, path_length, turns, validate

EXACT = ("dijkstra", "astar", "astar_turns")
RNG = np.random.default_rng(0)


def fewest_turns(grid: GridMap, cell: Cell, goal: Cell, heading: int, left: float) -> float:
    """Walk every shortest path; `left` is what may still be driven."""
    if cell == goal:
        return 0
    best = math.inf
    for move in np.flatnonzero(grid.legal_moves[cell]).tolist():
        to = (cell[0] + int(MOVES[move, 0]), cell[1] + int(MOVES[move, 1]))
        rest = left - (math.sqrt(2) if move % 2 else 1)
        if grid.distance_to(goal)[to] <= rest + 1e-9:
            turned = 0 if heading in (-1, move) else 1
            best = min(best, turned + fewest_turns(grid, to, goal, move, rest))
    return best


def test_min_turns_equals_an_exhaustive_search() -> None:
    rng = np.random.default_rng(2)
    tried = 0
    while tried < 25:
        occupied = rng.random((6, 7)) < 0.2
        occupied[0, 0] = occupied[5, 6] = False
        grid = GridMap(occupied)
        distance = float(grid.distance_to((5, 6))[0, 0])
        if math.isinf(distance):
            continue
        assert min_turns(grid, (0, 0), (5, 6)) == fewest_turns(grid, (0, 0), (5, 6), -1, distance)
        tried += 1


def cheapest(grid: GridMap, cost: NDArray[np.float64], start: Cell, goal: Cell) -> float:
    """A plain Dijkstra in floats; cost float64[H, W, 8]."""
    best, heap = {start: 0.0}, [(0.0, start)]
    while heap:
        total, cell = heapq.heappop(heap)
        for move in np.flatnonzero(grid.legal_moves[cell]).tolist():
            to = (cell[0] + int(MOVES[move, 0]), cell[1] + int(MOVES[move, 1]))
            new = total + (math.sqrt(2) if move % 2 else 1.0) + float(cost[(*cell, move)])
            if new < best.get(to, math.inf):
                best[to] = new
                heapq.heappush(heap, (new, to))
    return best.get(goal, math.inf)


def priced(cells: NDArray[np.int64], cost: NDArray[np.float64]) -> float:
    steps = np.diff(cells, axis=0)
    moves = [int(np.flatnonzero((step == MOVES).all(axis=1))[0]) for step in steps]
    return path_length(cells) + sum(float(cost[(*cell, m)]) for cell, m in zip(cells[:-1].tolist(), moves, strict=True))


def test_random_maps_with_and_without_costs_are_searched_exactly() -> None:
    rng = np.random.default_rng(3)
    for number in range(60):
        occupied = rng.random((8, 9)) < 0.25
        occupied[0, 0] = occupied[7, 8] = False
        grid = GridMap(occupied)
        cost = rng.random((8, 9, 8)) * (rng.random((8, 9, 8)) < 0.7) * (number % 3)
        expected = cheapest(grid, cost, (0, 0), (7, 8))
        for name in EXACT:
            plan = make_planner(name).plan(grid, (0, 0), (7, 8), RNG, cost if cost.any() else None)
            if math.isinf(expected):
                assert not plan.found
                continue
            validate(grid, plan.cells, (0, 0), (7, 8))
            assert priced(plan.cells, cost) == pytest.approx(expected, abs=1e-4)  # tolls are whole millionths


def test_equal_costs_tie_whatever_the_order_of_their_tolls() -> None:
    # Where the diagonal is driven does not matter for the cost, but sums of these floats differ in the last bit with
    # the order of adding, so a search that adds floats may pay a second turn for nothing.
    grid, tolls = GridMap(np.zeros((2, 6))), (0.07, 0.07, 0.03, 0.06)
    cost = np.zeros((2, 6, 8))
    cost[0, 0:4, 0] = cost[1, 1:5, 0] = tolls
    cells = make_planner("astar_turns").plan(grid, (0, 0), (1, 5), RNG, cost).cells
    assert path_length(cells) == 4 + math.sqrt(2)
    assert turns(cells) == 1


def test_a_detour_that_saves_enough_climbing_by_hand() -> None:
    # Over the hill: 4 cells and 2 m up and down. Around it: two diagonals more, 2 * (sqrt(2) - 1) longer.
    height = np.zeros((3, 5), np.float32)
    height[0, 2] = 1.0
    grid = GridMap(np.zeros((3, 5), dtype=bool), height=height)
    around = 4 + 2 * (math.sqrt(2) - 1)
    for name in EXACT:
        for gentleness, wanted in ((0.0, 4), (0.4, 4), (0.42, around)):
            plan = make_planner(name, gentleness=gentleness).plan(grid, (0, 0), (0, 4), RNG)
            assert path_length(plan.cells) == pytest.approx(wanted), (name, gentleness)
