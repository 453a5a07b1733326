"""Warm replanning: tempered pheromone, the way round what was moved, and ahead of a colony that begins anew."""

from __future__ import annotations

import math

import numpy as np

from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.planning import validate
from warehouse_env.planning.ants.pf_aco import PfAco
from warehouse_env.planning.ants.warm import replan, tempered

SMALL = PfAco(ants=20, iterations=30)
START, GOAL = (4, 3), (41, 42)


def fresh(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def two_ways() -> GridMap:
    """A block with a street of equal length on either side."""
    occupied = np.zeros((7, 13), dtype=bool)
    occupied[1:6, 1:12] = True
    return GridMap(occupied)


def test_tempering_by_hand() -> None:
    level = tempered(np.array([[16.0, 1.0]]), 0.25)
    np.testing.assert_allclose(level, [[1.0, 0.5]])
    np.testing.assert_array_equal(tempered(np.array([[16.0, 1.0]]), 0.0), [[1.0, 1.0]])


def blocked(grid: GridMap, *cells: Cell) -> GridMap:
    occupied = grid.occupied.copy()
    for cell in cells:
        occupied[cell] = True
    return GridMap(occupied)


def test_replanning_finds_the_other_side_of_the_block() -> None:
    grid = two_ways()
    plan, pheromone = replan(SMALL, grid, (3, 0), (3, 12), fresh(), None)
    row = int(plan.cells[6, 0])
    now, _ = replan(SMALL, blocked(grid, (row, 6)), (3, 0), (3, 12), fresh(1), pheromone)
    validate(blocked(grid, (row, 6)), now.cells, (3, 0), (3, 12))
    assert now.cells[6, 0] == 6 - row
    assert len(now.elapsed) == len(now.best_by_iteration)


def test_a_warm_colony_without_local_search_is_ahead_from_the_first_iteration() -> None:
    grid, system = make_layout("paper46"), PfAco(local_search=False)
    ahead = []
    for seed in range(5):
        plan, pheromone = replan(system, grid, START, GOAL, fresh(seed), None)
        changed = blocked(grid, tuple(plan.cells[len(plan.cells) // 2].tolist()))
        warm, _ = replan(system, changed, START, GOAL, fresh(seed + 50), pheromone)
        cold, _ = replan(system, changed, START, GOAL, fresh(seed + 50), None)
        assert warm.found
        ahead.append(cold.best_by_iteration[9] - warm.best_by_iteration[9])
    assert all(math.isfinite(length) for length in ahead)
    assert np.mean(ahead) > 1.0
