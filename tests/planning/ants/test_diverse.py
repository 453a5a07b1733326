"""Routes from the final pheromone and warm replanning: valid, different, near the best, the same for the same seed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.planning import path_length, validate
from warehouse_env.planning.alternatives import differences
from warehouse_env.planning.ants.aco import Aco
from warehouse_env.planning.ants.diverse import replan, routes, tempered
from warehouse_env.planning.ants.pf_aco import PfAco

SMALL = PfAco(ants=20, iterations=30)
START, GOAL = (4, 3), (41, 42)


def fresh(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def two_ways() -> GridMap:
    """A block with a street of equal length on either side."""
    occupied = np.zeros((7, 13), dtype=bool)
    occupied[1:6, 1:12] = True
    return GridMap(occupied)


def test_routes_are_valid_different_and_near_the_best() -> None:
    grid = make_layout("paper46")
    found = routes(SMALL, grid, START, GOAL, 5, fresh())
    assert len(found) == 5
    optimum = float(grid.distance_to(GOAL)[START])
    for path in found:
        validate(grid, path, START, GOAL)
        assert path_length(found[0]) - 1e-9 <= path_length(path) <= 1.1 * path_length(found[0]) + 1e-9
    assert path_length(found[0]) == pytest.approx(optimum)
    apart = differences(found, grid.shape)
    assert (apart[~np.eye(5, dtype=bool)] > 0).all()
    assert apart[0].max() > 0.4


def test_both_sides_of_a_block_are_found() -> None:
    found = routes(SMALL, two_ways(), (3, 0), (3, 12), 4, fresh(), slack=0.0)
    assert len(found) == 2
    rows = {tuple(np.unique(path[:, 0]).tolist()) for path in found}
    assert rows == {(0, 1, 2, 3), (3, 4, 5, 6)}


def test_the_same_seed_gives_the_same_routes() -> None:
    grid = make_layout("narrow")
    first, again = (routes(SMALL, grid, START, GOAL, 4, fresh(3)) for _ in range(2))
    assert [path.tolist() for path in first] == [path.tolist() for path in again]


def test_a_cost_map_bends_the_routes() -> None:
    grid = two_ways()
    cost = np.zeros(grid.shape)
    cost[0, 2:11] = 1.0
    (only,) = routes(SMALL, grid, (3, 0), (3, 12), 4, fresh(), cost, slack=0.1)
    assert only[:, 0].max() == 6


@pytest.mark.parametrize("system", [SMALL, Aco(ants=5, iterations=5, dead_end="die")])
def test_odd_tasks(system: PfAco | Aco) -> None:
    occupied = np.zeros((5, 5), dtype=bool)
    occupied[:, 2] = True
    assert routes(system, GridMap(occupied), (0, 0), (0, 4), 3, fresh()) == []
    (home,) = routes(system, GridMap(occupied), (0, 0), (0, 0), 3, fresh())
    assert home.tolist() == [[0, 0]]
    (corridor,) = routes(system, GridMap(np.zeros((1, 6), dtype=bool)), (0, 0), (0, 5), 3, fresh())
    assert len(corridor) == 6


def test_bad_numbers_are_refused() -> None:
    grid = two_ways()
    with pytest.raises(ConfigError, match="temper"):
        tempered(np.ones((4, 8)), 2.0)
    with pytest.raises(ConfigError, match="k=0"):
        routes(SMALL, grid, (3, 0), (3, 12), 0, fresh())
    with pytest.raises(ConfigError, match="pheromone of shape"):
        replan(SMALL, grid, (3, 0), (3, 12), fresh(), np.ones((4, 8)))


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


def test_replanning_of_a_cut_off_goal_says_so() -> None:
    grid = two_ways()
    _, pheromone = replan(SMALL, grid, (3, 0), (3, 12), fresh(), None)
    plan, _ = replan(SMALL, blocked(grid, (0, 6), (6, 6)), (3, 0), (3, 12), fresh(), pheromone)
    assert not plan.found


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
