"""The ant colony system and the shunting network: equations by hand, and what they reach."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.planning.ants.colonies import EAST, SOUTH_EAST, walked
from warehouse_env.maps.generators import random_floor
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning.ants.acs import ShaaAcs, draw_towards_best
from warehouse_env.planning.ants.floor import make_floor
from warehouse_env.planning.ants.shunting import rise, settle
from warehouse_env.planning.plan import path_length, validate

DIAGONAL = 10.0 ** (1 - math.sqrt(2))


def open_floor(rows: int, columns: int) -> GridMap:
    return GridMap(np.zeros((rows, columns), dtype=bool))


def test_only_the_best_path_is_marked() -> None:
    floor = make_floor(open_floor(2, 3), (1, 2))
    pheromone = np.full((6, 8), 0.5)
    draw_towards_best(floor, pheromone, walked(floor, [EAST, SOUTH_EAST]), 0.1)
    marked = 0.9 * 0.5 + 0.1 / (1 + math.sqrt(2))
    assert pheromone[0, EAST] == pytest.approx(marked)
    assert pheromone[1, SOUTH_EAST] == pytest.approx(marked)
    assert (pheromone == 0.5).sum() == 46


def test_evaporation_rises_from_first_to_last_iteration() -> None:
    assert [ShaaAcs(iterations=4).evaporates(i) for i in range(4)] == pytest.approx([0.1, 0.2, 0.3, 0.4])
    assert ShaaAcs(iterations=1).evaporates(0) == 0.1


def states(grid: GridMap, goal: tuple[int, int], planner: ShaaAcs) -> np.ndarray:
    floor = make_floor(grid, goal)
    strongest = planner.excitation == "strongest"
    activity = settle(floor, planner.network_weights(floor), planner.decay, planner.source, strongest)
    return np.ldexp(activity.mantissa, activity.exponent.clip(-1000).astype(np.int32)).reshape(grid.shape)


@pytest.mark.parametrize("weights", ["length", "inverse"])
@pytest.mark.parametrize("excitation", ["strongest", "sum"])
def test_the_network_rests(weights: str, excitation: str) -> None:
    # Every state against its own equation, x = S / (A + S), by plain loops over the neighbours.
    grid = random_floor(9, 9, 0.2, 3)
    goal = tuple(grid.free_cells[0].tolist())
    x = states(grid, goal, ShaaAcs(weights=weights, excitation=excitation))
    near = {"length": DIAGONAL, "inverse": math.sqrt(0.5)}[weights]
    for row, column in grid.free_cells.tolist():
        arriving = [100.0] if (row, column) == goal else [0.0]
        for d_row in (-1, 0, 1):
            for d_column in (-1, 0, 1):
                to = (row + d_row, column + d_column)
                inside = 0 <= to[0] < 9 and 0 <= to[1] < 9
                if (
                    to != (row, column)
                    and inside
                    and not grid.occupied[[to[0], row, to[0]], [to[1], to[1], column]].any()
                ):
                    arriving.append((near if d_row and d_column else 1.0) * x[to])
        excited = max(arriving) if excitation == "strongest" else sum(arriving)
        assert x[row, column] == pytest.approx(excited / (10 + excited), rel=2e-3)


def test_activity_reaches_beyond_the_range_of_floats() -> None:
    floor = make_floor(open_floor(1, 2000), (0, 0))
    for planner in (ShaaAcs(), ShaaAcs(excitation="sum")):
        activity = settle(floor, planner.network_weights(floor), 10.0, 100.0, planner.excitation == "strongest")
        assert activity.exponent[-1] < -6000
        ratio = rise(floor, activity)
        assert ratio[1500, 4] == pytest.approx(10.0, rel=0.02 if planner.excitation == "strongest" else 0.1)
    plan = ShaaAcs(ants=1, iterations=1).plan(open_floor(1, 2000), (0, 1999), (0, 0), np.random.default_rng(0))
    assert path_length(plan.cells) == 1999


@pytest.mark.parametrize("local_search", [True, False])
def test_it_is_optimal_on_cluttered_floors(local_search: bool) -> None:
    for seed in range(6):
        grid = random_floor(40, 40, 0.3, seed)
        start, goal = (tuple(grid.free_cells[k].tolist()) for k in (0, -1))
        plan = ShaaAcs(local_search=local_search).plan(grid, start, goal, np.random.default_rng(seed))
        validate(grid, plan.cells, start, goal)
        assert path_length(plan.cells) == pytest.approx(grid.distance_to(goal)[start])
