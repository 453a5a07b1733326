"""Test floors for other footprints: by hand, by brute force, and one sentence if a footprint does not fit."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents import make_policy, policy_config
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.errors import MapWarning
from warehouse_env.maps.endpoints import largest_region
from warehouse_env.maps.fitting import ROOM, fitted, headings_on, load_floor
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import LAYOUTS, make_layout
from warehouse_env.planning import make_planner
from warehouse_env.routes.book import RouteBook
from warehouse_env.routes.goals import face
from warehouse_env.simulation.simulator import Simulator

LARGE = RobotSpec(length=3.0, width=2.0, wheelbase=2.0, front_overhang=0.5)
LONG = RobotSpec(length=1.4, width=0.8, wheelbase=0.9, front_overhang=0.25)
SMALL = RobotSpec(length=0.5, width=0.4, wheelbase=0.34, front_overhang=0.08)


def drawn(*lines: str, cell: float = 1.0) -> GridMap:
    """Return a floor from `#` shelf, `p` pick, `s` station."""
    letters = np.array([list(line) for line in lines])
    picks, stations = (np.argwhere(letters == letter) for letter in "ps")
    return GridMap(letters == "#", cell_size=cell, picks=picks, stations=stations)


@pytest.mark.parametrize("name", LAYOUTS)
def test_default_footprint_fits_every_layout(name: str) -> None:
    grid = make_layout(name)
    assert fitted(grid, RobotSpec()) == (grid, ())
    half = GridMap(grid.occupied, cell_size=0.5, picks=grid.picks, stations=grid.stations)
    assert fitted(half, SMALL)[0] is half


def test_wide_footprint_keeps_to_the_middle() -> None:
    """A robot of 2 m uses the middle row of an aisle of 3 m; places beside the shelf move there."""
    floor, notes = fitted(drawn("............", "............", "p.........s.", "############"), LARGE)
    drawing = ["".join(".x"[int(one)] for one in row) for row in floor.closed]
    assert drawing == ["x" * 12, "x..........x", "x" * 12, "x" * 12]
    assert floor.picks.tolist() == [[1, 1]]
    assert floor.stations.tolist() == [[1, 10]]
    assert notes == ()


@pytest.mark.parametrize(("width", "corners"), [(1.2, False), (1.4, True)])
def test_footprint_keeps_half_its_width_from_shelves(width: float, corners: bool) -> None:
    """A shelf corner is 0.71 m from the next cell's centre; half the width plus the margin is 0.65 or 0.75 m."""
    grid = drawn(".......", ".p.....", ".......", "...#...", ".......", ".....s.", ".......")
    floor, _ = fitted(grid, RobotSpec(length=1.4, width=width))
    row, column = np.abs(np.indices(grid.shape) - 3)
    near = np.maximum(row, column) <= 1 if corners else row + column <= 1
    np.testing.assert_array_equal(floor.closed, near | (np.maximum(row, column) == 3))


def test_unreachable_places_are_noted() -> None:
    grid = drawn("............", "p..........s", "............", "##.#########", "p...........", "..........s.")
    with pytest.warns(MapWarning) as found:
        floor = load_floor(EnvConfig(robot=LARGE, num_agents=1), grid)
    notes = [str(one.message) for one in found]
    assert "aisles are too narrow for bodies of 3 x 2 m: " in notes[0]
    assert "cannot reach 1 of 2 picks and 1 of 2 stations" in notes[1]
    assert (floor.picks.tolist(), floor.stations.tolist()) == ([[1, 1]], [[1, 10]])
    tiny = drawn("p.s", "...")
    assert fitted(tiny, LARGE)[0] is tiny
    assert "bodies of 3 x 2 m can reach no pick, so the floor stays as it is" in fitted(tiny, LARGE)[1][0]
    with pytest.warns(MapWarning, match="too narrow"):
        # Only two endpoints would remain for two robots.
        assert load_floor(EnvConfig(robot=LARGE, num_agents=2), grid) is grid
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_floor(EnvConfig(), grid)


@pytest.mark.parametrize(("length", "width", "gets_there"), [(0.9, 0.6, True), (1.4, 0.8, False)])
def test_footprints_get_stuck_only_where_notes_say_so(length: float, width: float, gets_there: bool) -> None:
    robot = RobotSpec(length=length, width=width)
    grid = drawn("############", "s..........s", "#####.######", "#####p######", "############")
    config = policy_config("greedy", EnvConfig(num_agents=1, planner="astar_turns", robot=robot, layout="pocket"))
    simulator, policy, rng = Simulator(config, grid=grid), make_policy("greedy", config), np.random.default_rng(0)
    observation = simulator.reset([0])
    while simulator.seconds(0) < 80:
        observation = simulator.step(policy.act(observation, rng))
    assert (simulator.episode_metrics()["stuck"] == 0) == gets_there == (fitted(grid, robot)[1] == ())


@pytest.mark.parametrize("planner", ["astar", "astar_turns", "theta_star", "pf_aco:iterations=3"])
def test_plans_leave_tight_floor_and_never_cross_it(planner: str) -> None:
    """From a narrow aisle the route leaves by the nearest mouth and goes round, not on through the aisle."""
    ends, narrow = ["p..............", "...............", "..............."], "####.########..."[:12] + "..."
    grid = drawn(*ends, *[narrow] * 4, *(line.replace("p", "s") for line in ends))
    floor, _ = fitted(grid, RobotSpec(length=1.2, width=1.2))
    assert floor.closed[3:7, 4].all()
    assert not floor.closed[[1, 2, 7, 5], [4, 4, 4, 13]].any()
    for start, goal, mouth in (((5, 4), (1, 1), [7, 4]), ((6, 4), (1, 1), [7, 4]), ((4, 4), (8, 1), [2, 4])):
        cells = make_planner(planner).plan(floor, start, goal, np.random.default_rng(0)).cells.tolist()
        assert cells[0] == list(start)
        assert cells[-1] == list(goal)
        assert not any(floor.closed[row, column] for row, column in cells[cells.index(mouth) :])


def apart(grid: GridMap, cells: np.ndarray) -> np.ndarray:
    """Return the distances [m] from cell centres to the nearest shelf or the rim."""
    walls = np.argwhere(np.pad(grid.occupied, 1, constant_values=True)) - 1
    off = np.maximum(np.abs(walls[None] - cells.reshape(-1, 1, 2)) - 0.5, 0.0)
    return np.asarray(np.hypot(off[..., 0], off[..., 1]).min(axis=1, initial=np.inf)) * grid.cell_size


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([0.25, 0.5, 1.0]), st.sampled_from(["astar_turns", "theta_star"]))
def test_planned_cells_leave_room_for_the_footprint(seed: int, cell: float, planner: str) -> None:
    """Plans between endpoints keep the footprint's clearance; plans from tight floor leave it."""
    rng = np.random.default_rng(seed)
    occupied = rng.random((16, 16)) < 0.03
    body = RobotSpec(length=3.6 * cell, width=2.4 * cell, wheelbase=2.4 * cell, front_overhang=0.6 * cell)
    whole = GridMap(occupied, cell_size=cell)
    floor, _ = fitted(whole, body)
    if floor is whole:
        return
    need = body.width / 2 + ROOM - 1e-6
    tight = np.argwhere(np.zeros_like(occupied) if floor.tight is None else floor.tight)
    roomy = occupied.copy()
    roomy[tuple(tight.T)] = apart(floor, tight) < need
    assert not largest_region(~roomy)[tuple(tight.T)].any()  # too near, or reached only through such cells
    assert (apart(floor, np.argwhere(~floor.closed)) >= need).all()
    ends = floor.endpoints[2]
    start, goal = ends[0], ends[-1]
    cells = make_planner(planner).plan(floor, start, goal, rng).cells
    assert (apart(floor, cells) >= need).all()
    assert fitted(floor, body)[0].key == floor.key
    if len(tight):
        off = tuple(tight[int(rng.integers(len(tight)))].tolist())
        way = floor.closed[tuple(make_planner(planner).plan(floor, off, goal, rng).cells.T)].tolist()
        assert way == sorted(way, reverse=True)  # leaves the tight floor and never enters it


def test_route_reaches_a_given_goal_on_tight_floor() -> None:
    """A footprint may fit beside a shelf off the cell's centre, so a given goal there is opened."""
    floor, _ = fitted(drawn("............", "............", "p.........s.", "############"), LARGE)
    cells = RouteBook(floor, make_planner("astar_turns")).cells((1, 2), (2, 8)).tolist()
    assert (cells[0], cells[-1]) == ([1, 2], [2, 8])
    assert all(row == 1 for row, _ in cells[:-1])


def test_cells_near_a_disc_are_tight() -> None:
    """Cells around a pillar of 0.2 m are tight if they are nearer than half a width plus a margin."""
    ends = {"picks": [[1, 1]], "stations": [[7, 7]]}
    floor, _ = fitted(GridMap(np.zeros((9, 9)), cell_size=0.5, discs=[[2.5, 2.5, 0.2]], **ends), RobotSpec())
    centres = floor.centre(np.stack(np.mgrid[1:8, 1:8], axis=-1))
    apart = np.hypot(*(centres - 2.5).transpose(2, 0, 1)) - 0.2
    assert (floor.closed[1:-1, 1:-1] == (apart < 0.35)).all()


def test_tight_junctions_are_noted() -> None:
    """A footprint of 1.4 x 0.8 m needs 1.39 m to turn, by the circles of its corners about the turn's centre."""
    lines = ["............", "..........s.", "#.#########.", "#.#########.", "p.........p.", "###.#######."]
    (note,) = fitted(drawn(*lines), LONG)[1]
    assert "need aisles of 1.4 m to turn from one into another, and some of 1 m meet, as near (1.5, 1.5) m" in note


def test_faces_of_large_footprints_are_free() -> None:
    """Beside a shelf the robot is parallel and centred in the cell; 1.5 m before a wall only its axle is centred."""
    floor, _ = fitted(drawn("............", "............", "p.........s.", "############"), LARGE)
    along = face(floor, (1, 4), LARGE).poses
    assert [round(x, 6) for x, _, _ in along] == [5.5, 3.5]  # 1 m ahead of the centre, in both headings
    assert face(floor, (1, 1), LARGE).poses == ((1.5, 2.5, math.pi),)
    assert headings_on(floor, (1, 1), LARGE) == [math.pi]
