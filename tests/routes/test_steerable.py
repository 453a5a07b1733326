"""Routes that a rear-steer robot can drive: bounded curvature, clearance of whole segments, on every layout."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.planning.test_smoothing import some_path
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import LAYOUTS, make_layout
from warehouse_env.planning import make_planner
from warehouse_env.routes.book import RouteBook
from warehouse_env.routes.lanes import drivable_line
from warehouse_env.routes.steerable import most_curvature, narrowest, rounded, sharpest, without_knees
from warehouse_env.simulation.physics.kinematics import drive
from warehouse_env.simulation.simulator import Simulator

ROBOT = RobotSpec()
WIDTH = 0.35  # [m] half the robot's width and the margin
FLOAT32 = 2e-4  # what rounding way-points to float32 may do to clearance [m] and curvature [1/m]


def solid_of(grid: GridMap) -> NDArray[np.uint8]:
    return np.pad(grid.occupied[::-1], 1, constant_values=True).astype(np.uint8)


def book(grid: GridMap, robot: RobotSpec | None = ROBOT, keep_right: float = 0.5) -> RouteBook:
    return RouteBook(grid, make_planner("astar"), keep_right=keep_right, smooth_for=robot)


def test_the_bound_is_the_circle_that_the_simulated_robot_drives() -> None:
    steer = np.float32(-0.85 * ROBOT.max_steering)  # rear wheels to the right: it turns left
    speed, dt = np.float32(0.5), np.float32(0.05)
    x = y = heading = np.float32(0.0)
    places = []
    for _ in range(400):
        x, y, heading = drive(x, y, heading, speed, speed, steer, steer, np.float32(ROBOT.wheelbase), dt)
        places.append((float(x), float(y)))
    centre = np.mean([np.min(places, axis=0), np.max(places, axis=0)], axis=0)
    radius = np.hypot(*(np.array(places) - centre).T)
    assert radius == pytest.approx(1 / most_curvature(ROBOT), abs=2e-3)
    assert most_curvature(ROBOT) < math.tan(ROBOT.max_steering) / ROBOT.wheelbase
    assert most_curvature(ROBOT) > 2.0  # the arc of half a cell, by which any corner of an aisle of 1 m can be taken


def test_curvature_of_a_circle_and_of_a_corner_by_hand() -> None:
    angle = np.linspace(0, 1, 9)
    assert sharpest(0.7 * np.column_stack([np.cos(angle), np.sin(angle)])) == pytest.approx(1 / 0.7)
    assert sharpest(np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)])) == pytest.approx(math.sqrt(2))
    assert sharpest(np.array([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)])) == 0


@pytest.mark.parametrize(
    ("path", "kept"),
    [
        ([(2, 0), (2, 1), (1, 1)], [(2, 0), (1, 1)]),  # a corner on open floor
        ([(2, 0), (2, 1), (1, 0)], [(2, 0), (1, 0)]),  # there and back
        ([(4, 2), (4, 3), (4, 4), (3, 4), (2, 4)], [(4, 2), (4, 3), (4, 4), (3, 4), (2, 4)]),  # round the shelf
        ([(0, 0), (0, 1), (0, 0), (0, 1), (0, 2)], [(0, 0), (0, 1), (0, 2)]),
        ([(0, 0)], [(0, 0)]),
    ],
)
def test_knees_are_left_out(path: list[tuple[int, int]], kept: list[tuple[int, int]]) -> None:
    occupied = np.zeros((6, 6), dtype=bool)
    occupied[3, 3] = True
    assert [tuple(cell) for cell in without_knees(np.array(path), GridMap(occupied)).tolist()] == kept


def test_corners_become_arcs() -> None:
    quarter = rounded(np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)]))
    arc = quarter[1:-1]
    np.testing.assert_allclose(np.hypot(*(arc - [0.5, 0.5]).T), 0.5, atol=1e-12)
    np.testing.assert_allclose(arc[[0, -1]], [(0.5, 0.0), (1.0, 0.5)], atol=1e-12)
    eighth = rounded(np.array([(0.0, 0.0), (1.0, 0.0), (2.0, 1.0)]))
    assert sharpest(eighth[1:-1]) == pytest.approx(math.tan(math.pi / 8) / 0.5, rel=1e-3)
    straight = np.array([(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)])
    np.testing.assert_array_equal(rounded(straight), straight[[0, 2]])


def check(route: NDArray[np.float32], grid: GridMap, robot: RobotSpec = ROBOT) -> None:
    line = route.astype(np.float64)
    assert sharpest(line) <= most_curvature(robot) + 10 * FLOAT32
    assert narrowest(line, solid_of(grid), grid.cell_size, 0.5) >= 0.5 * robot.width + 0.05 - FLOAT32
    steps = np.hypot(*np.diff(line, axis=0).T)
    assert steps.max() < 0.3
    assert steps.min() > 0.2


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 10_000), share=st.floats(0, 0.45), keep=st.sampled_from([0.0, 0.5]), size=st.floats(1.0, 1.6)
)
def test_any_path_becomes_drivable(seed: int, share: float, keep: float, size: float) -> None:
    grid, cells = some_path(seed, share)
    grid = GridMap(grid.occupied, cell_size=size)
    known = book(grid, keep_right=keep)
    known.cells = lambda start, goal, behind=None: cells  # type: ignore[method-assign]
    start, goal = tuple(cells[0].tolist()), tuple(cells[-1].tolist())
    route = known.route(start, goal)
    np.testing.assert_allclose(route[[0, -1]], grid.centre([start, goal]), atol=1e-4)
    if len(cells) > 2:
        check(route, grid)


@pytest.mark.parametrize("name", LAYOUTS)
def test_routes_of_every_layout(name: str) -> None:
    grid = make_layout(name)
    smooth, plain = book(grid), book(grid, None)
    ends = np.concatenate([grid.picks, grid.stations])
    rng = np.random.default_rng(1)
    no_arrows = np.zeros_like(solid_of(grid))
    for _ in range(25):
        start, goal = (tuple(ends[k].tolist()) for k in rng.choice(len(ends), 2, replace=False))
        route, lane = smooth.route(start, goal), plain.route(start, goal)
        cells = plain.cells(start, goal)
        np.testing.assert_array_equal(lane, drivable_line(grid.centre(cells), solid_of(grid), no_arrows, 1.0, 0.5))
        np.testing.assert_allclose(route[[0, -1]], grid.centre([start, goal]), atol=1e-4)
        if len(lane) > 2:
            check(route, grid)
        driven, planned = (np.hypot(*np.diff(line, axis=0).T).sum() for line in (route, lane))
        assert 0.8 * planned - 0.5 < driven < 1.05 * planned + 1.0


def test_lanes_stay_to_the_right() -> None:
    grid = GridMap(np.array([[mark == "#" for mark in line] for line in ("#" * 30, *["." * 30] * 3, "#" * 30)]))
    middle = book(grid).route((2, 1), (2, 28))[30:80, 1]
    np.testing.assert_allclose(middle, 1.75, atol=0.05)  # as far right as in test_routes


def test_small_cells_give_a_line_all_the_same() -> None:
    grid, cells = some_path(7, 0.2)
    grid = GridMap(grid.occupied, cell_size=0.4)
    ends = tuple(cells[0].tolist()), tuple(cells[-1].tolist())
    route = book(grid).route(*ends)
    assert np.isfinite(route).all()
    np.testing.assert_allclose(route[[0, -1]], grid.centre(list(ends)), atol=1e-4)


def test_environments_ask_for_it_by_one_field() -> None:
    plain, smooth = (
        Simulator(EnvConfig(layout="single_lane", num_agents=4, planner="astar", smooth_routes=flag))
        for flag in (False, True)
    )
    for simulator in (plain, smooth):
        simulator.reset(3)
    assert plain.robots["spacing"].max() > 0.4
    for robot in range(4):
        count = int(smooth.robots[0, robot]["points"])
        check(smooth.routes[0, robot, :count], smooth.grid)
    with pytest.raises(ConfigError, match="smooth_routes='yes' must be True or False"):
        EnvConfig(smooth_routes="yes")  # type: ignore[arg-type]
