"""Test exact searches and cost-to-go fields against hand-counted maps, plain searches and relaxation."""

from __future__ import annotations

import heapq
import math

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.planning import make_planner, min_turns, path_length, turns, validate
from warehouse_env.planning.cost_to_go import UNIT, UNREACHABLE, Box, CostToGo, cost_field

EXACT = ("dijkstra", "astar", "astar_turns")
RNG = np.random.default_rng(0)


def fewest_turns(grid: GridMap, cell: Cell, goal: Cell, heading: int, left: float) -> float:
    """Return the fewest turns of all shortest paths; `left` is the remaining length."""
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
    """Return the least cost by a plain Dijkstra in floats; cost float64[H, W, 8]."""
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


def test_searches_are_exact_on_random_maps_and_costs() -> None:
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


def test_equal_costs_tie_in_any_order_of_tolls() -> None:
    # The place of the diagonal does not change the cost, but float sums differ in the last bit with their order. A
    # search that adds floats may therefore take a needless second turn.
    grid, tolls = GridMap(np.zeros((2, 6))), (0.07, 0.07, 0.03, 0.06)
    cost = np.zeros((2, 6, 8))
    cost[0, 0:4, 0] = cost[1, 1:5, 0] = tolls
    cells = make_planner("astar_turns").plan(grid, (0, 0), (1, 5), RNG, cost).cells
    assert path_length(cells) == 4 + math.sqrt(2)
    assert turns(cells) == 1


def test_detour_must_save_enough_climbing() -> None:
    # Over the hill: 4 cells and 2 m up and down. Around it: two diagonals more, 2 * (sqrt(2) - 1) longer.
    height = np.zeros((3, 5), np.float32)
    height[0, 2] = 1.0
    grid = GridMap(np.zeros((3, 5), dtype=bool), height=height)
    around = 4 + 2 * (math.sqrt(2) - 1)
    for name in EXACT:
        for gentleness, wanted in ((0.0, 4), (0.4, 4), (0.42, around)):
            plan = make_planner(name, gentleness=gentleness).plan(grid, (0, 0), (0, 4), RNG)
            assert path_length(plan.cells) == pytest.approx(wanted), (name, gentleness)


def relaxed(steps: np.ndarray, goal: tuple[int, int]) -> np.ndarray:
    """Return costs by relaxing all moves until nothing changes (Bellman and Ford)."""
    rows, columns, _ = steps.shape
    cost = np.full((rows + 2, columns + 2), np.inf)
    cost[goal[0] + 1, goal[1] + 1] = 0
    while True:
        before = cost.copy()
        for move, (d_row, d_column) in enumerate(MOVES):
            there = cost[1 + d_row : rows + 1 + d_row, 1 + d_column : columns + 1 + d_column]
            through = np.where(steps[:, :, move] > 0, steps[:, :, move] + there, np.inf)
            cost[1:-1, 1:-1] = np.minimum(cost[1:-1, 1:-1], through)
        if np.array_equal(cost, before):
            return cost[1:-1, 1:-1]


def as_costs(field: np.ndarray) -> np.ndarray:
    return np.where(field == UNREACHABLE, np.inf, field)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 14), st.integers(2, 14), st.sampled_from([0.0, 0.2, 0.5]))
def test_fields_are_exact_for_any_moves_and_costs(seed: int, rows: int, columns: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    open_floor = GridMap(np.zeros((rows, columns), bool), picks=[(0, 0)], stations=[(0, 1)])
    legal = open_floor.legal_moves & (rng.random((rows, columns, 8)) >= share)
    steps = np.where(legal, rng.integers(UNIT, 4 * UNIT, legal.shape), 0).astype(np.int32)
    goal = int(rng.integers(rows)), int(rng.integers(columns))
    field = cost_field(steps, *goal, 0, 0, rows, columns)
    np.testing.assert_array_equal(as_costs(field), relaxed(steps, goal))


def test_box_costs_are_never_below_those_of_the_whole_floor() -> None:
    floor = CostToGo(make_layout("aisles:seed=3"))
    goal = tuple(floor.grid.stations[0].tolist())
    whole, box = floor.field(goal, floor.whole()), Box(0, 0, 24, 30)
    if not (goal[0] < 24 and goal[1] < 30):
        box = Box(goal[0] // 2, goal[1] // 2, *floor.grid.shape)
    part = floor.field(goal, box)
    assert part.shape == (box.bottom - box.top, box.right - box.left)
    np.testing.assert_array_less(whole[box.top : box.bottom, box.left : box.right], part.astype(np.int64) + 1)


def test_field_falls_back_to_the_whole_floor() -> None:
    occupied = np.zeros((300, 200), bool)
    occupied[:250, 105] = True
    floor = CostToGo(GridMap(occupied, picks=[(0, 0)], stations=[(0, 1)], one_way=np.eye(300, 200, -250, np.uint8)))
    assert ((floor.steps > 0) == floor.grid.legal_moves).all()
    assert floor.around((10, 100), (30, 100))[1] == floor.box((10, 100), (30, 100)) == Box(0, 0, 128, 192)
    field, box = floor.around((10, 100), (10, 110))
    assert box == floor.whole()
    assert field[10, 100] < UNREACHABLE
