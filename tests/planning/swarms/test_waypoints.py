"""The code of way-points: the walker by hand, and that every code of every map is a valid path."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.simulation.worlds import drawn
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning.ants.colony import cells_of
from warehouse_env.planning.ants.floor import make_floor
from warehouse_env.planning.plan import path_length, validate
from warehouse_env.planning.swarms.waypoints import Paths


def paths_of(grid: GridMap, start: Cell, goal: Cell, cost: np.ndarray | None = None) -> Paths:
    floor = make_floor(grid, goal, 0.0, cost)
    return Paths(grid, floor, start[0] * floor.columns + start[1])


def decoded(grid: GridMap, start: Cell, goal: Cell, *points: tuple[float, float]) -> list[Cell]:
    paths = paths_of(grid, start, goal)
    paths.cost(np.array(points, dtype=np.float64)[None])
    return [tuple(cell) for cell in cells_of(make_floor(grid, goal), paths.best, 0).tolist()]


OPEN = drawn(["....."] * 4)
WALL = drawn([".....", ".###.", "...#.", "....."])


def test_the_walk_goes_by_its_points_and_diagonally_while_it_can() -> None:
    assert decoded(OPEN, (0, 0), (0, 4), (2.4, 1.6)) == [(0, 0), (1, 1), (2, 2), (1, 3), (0, 4)]
    assert decoded(OPEN, (0, 0), (3, 1), (0.0, 0.0)) == [(0, 0), (1, 1), (2, 1), (3, 1)]


def test_a_point_on_a_shelf_or_outside_counts_as_the_nearest_cell_that_can_be_reached() -> None:
    assert decoded(WALL, (0, 0), (0, 4), (1.0, 2.0)) == decoded(WALL, (0, 0), (0, 4), (0.0, 2.0))
    assert decoded(OPEN, (0, 0), (0, 4), (99.0, -7.0)) == decoded(OPEN, (0, 0), (0, 4), (3.0, 0.0))
    island = GridMap(np.array([list("..#."), list("..##"), list("....")]) == "#")
    assert (0, 3) not in decoded(island, (0, 0), (2, 3), (0.0, 3.0))


def test_cost_is_length_and_tolls_of_each_code_and_the_best_is_kept() -> None:
    toll = np.zeros((4, 5))
    toll[0, 2] = 5.0
    paths = paths_of(OPEN, (0, 0), (0, 4), toll)
    straight, around = [(0.0, 2.0)], [(1.0, 2.0)]
    cost = paths.cost(np.array([straight, around], dtype=np.float64))
    assert cost == pytest.approx([4.0 + 5.0, 2.0 + 2.0 * math.sqrt(2.0)])
    assert paths.best.cost[0] == cost[1]
    assert paths.cost(np.array([straight], dtype=np.float64)) == pytest.approx([9.0])
    assert paths.best.cost[0] == cost[1]


@given(seed=st.integers(0, 10_000), share=st.floats(0.0, 0.5), rows=st.integers(1, 9), columns=st.integers(2, 9))
def test_every_code_of_every_map_is_a_valid_path_without_loops(
    seed: int, share: float, rows: int, columns: int
) -> None:
    rng = np.random.default_rng(seed)
    occupied = rng.random((rows, columns)) < share
    start, goal = (0, 0), (rows - 1, columns - 1)
    occupied[start] = occupied[goal] = False
    grid = GridMap(occupied)
    paths = paths_of(grid, start, goal)
    optimum = float(grid.distance_to(goal)[start])
    assert paths.reachable == math.isfinite(optimum)
    if not paths.reachable:
        return
    codes = rng.uniform(-2.0, 11.0, (4, 3, 2))
    for code in codes:
        cost = paths_of(grid, start, goal).cost(code[None])
        again = paths.cost(code[None])
        assert cost == again >= optimum - 1e-9
    cells = cells_of(make_floor(grid, goal), paths.best, 0)
    validate(grid, cells, start, goal)
    assert len({tuple(cell) for cell in cells.tolist()}) == len(cells)
    assert path_length(cells) == paths.best.length[0] == paths.cost(codes).min()
