"""Routes from the final pheromone: valid, different, near the best, the same for the same seed."""

from __future__ import annotations

import numpy as np
import pytest

from tests.planning.ants.test_warm import GOAL, SMALL, START, fresh, two_ways
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.planning import path_length, validate
from warehouse_env.planning.ants.aco import Aco
from warehouse_env.planning.ants.pf_aco import PfAco
from warehouse_env.traffic.alternatives import differences
from warehouse_env.traffic.diverse import routes


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
