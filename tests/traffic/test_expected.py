"""Tasks as lifelong robots get them, the map of their traffic, and a planner that carries a cost map."""

from __future__ import annotations

import numpy as np

from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.planning import make_planner, path_length, validate
from warehouse_env.traffic.expected import WithCost, endpoint_tasks, expected_traffic

RNG = np.random.default_rng(0)


def test_tasks_go_to_and_fro_between_picks_and_stations() -> None:
    grid = make_layout("single_lane")
    picks, stations = ({tuple(cell) for cell in cells.tolist()} for cells in (grid.picks, grid.stations))
    tasks = endpoint_tasks(grid, 50, np.random.default_rng(1))
    assert len(tasks) == 50
    for number, (start, goal) in enumerate(tasks):
        assert (start in picks and goal in stations) if number % 2 else (start in stations and goal in picks)
    assert len({start for start, _ in tasks[1::2]}) == 25  # picks come again only when all have been
    assert tasks == endpoint_tasks(grid, 50, np.random.default_rng(1))


def test_traffic_grows_with_the_robots_and_makes_one_way_streets() -> None:
    grid = make_layout("narrow")
    few, many = (expected_traffic(grid, robots, 4.0) for robots in (8, 32))
    assert many.shape == (*grid.shape, 8)
    assert many.sum() > 3 * few.sum()
    assert (many == expected_traffic(grid, 32, 4.0)).all()
    flat = expected_traffic(grid, 32, 4.0, directed=False)
    assert flat.shape == grid.shape
    east, west = many[:, :-1, 0], many[:, 1:, 4]
    used = np.maximum(east, west) > 0.2
    one_way = (np.minimum(east, west) < 0.25 * np.maximum(east, west))[used]
    assert one_way.mean() > 0.5


def test_a_planner_with_a_cost_map() -> None:
    occupied = np.zeros((5, 9), dtype=bool)
    occupied[1:4, 1:8] = True
    grid, cost, astar = GridMap(occupied), np.zeros((5, 9)), make_planner("astar")
    cost[0, 4] = 5.0
    planner = WithCost(astar, cost)
    plan = planner.plan(grid, (1, 0), (1, 8), RNG)
    validate(grid, plan.cells, (1, 0), (1, 8))
    assert plan.cells[:, 0].max() == 4
    cost_more = np.zeros((5, 9, 8))
    cost_more[4, 4] = 9.0
    assert path_length(planner.plan(grid, (1, 0), (1, 8), RNG, cost_more).cells) == 10
    assert planner.name == "astar"
    assert planner.key == WithCost(astar, cost.copy()).key != WithCost(astar, 2 * cost).key
    assert planner.key != astar.key
