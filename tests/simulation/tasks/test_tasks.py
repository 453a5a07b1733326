"""Goals: distinct, alternating, given or drawn, well-formed, and never more robots than places."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.simulation.reference import around, bodies, separation, shelves
from tests.simulation.worlds import drawn, room
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, MapError
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.layouts import LAYOUTS, make_layout
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment
from warehouse_env.simulation.tasks.sampled import OneShotTasks, cut_off, disc_of
from warehouse_env.simulation.tasks.tasks import Tasks
from warehouse_env.work import OrderSpec

KEY = np.array([4, 7, 0], np.uint64)
PICKS, STATIONS = [(0, 0), (0, 1), (0, 2), (0, 3), (0, 4)], [(4, 0), (4, 2), (4, 4)]


def floor(picks: list[Cell], stations: list[Cell]) -> GridMap:
    return GridMap(np.zeros((5, 5), dtype=bool), picks=np.array(picks), stations=np.array(stations), name="five")


def tasks_for(robots: int, picks: list[Cell] = PICKS, stations: list[Cell] = STATIONS) -> Tasks:
    return Tasks(floor(picks, stations), EnvConfig(num_agents=robots))


@settings(max_examples=40)
@given(st.integers(1, 7), st.integers(0, 10**6))
def test_goals_are_distinct_and_never_where_the_robot_is(robots: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    tasks = tasks_for(robots)
    tasks.reset(KEY)
    starts = [tasks.places[k] for k in rng.permutation(8)[:robots]]
    goals = [tasks.next_goal(robot, starts[robot], KEY) for robot in range(robots)]
    for _ in range(60):
        assert len(set(goals)) == robots
        robot = int(rng.integers(robots))
        before = goals[robot]
        goals[robot] = tasks.next_goal(robot, before, KEY)
        assert goals[robot] != before
        assert goals[robot] in PICKS + STATIONS


def test_as_many_robots_as_places_are_an_error() -> None:
    tasks_for(7)
    with pytest.raises(ConfigError, match=r"num_agents=8 .*'five'.* 8 endpoints"):
        tasks_for(8)


def test_robots_that_find_no_room_to_stand_are_an_error() -> None:
    # Nine places in a one-cell aisle would need 0.9 m and 0.15 m of gap each.
    grid = drawn(["#########", ".........", "#########"])
    with pytest.raises(ConfigError, match="num_agents=8 do not fit on map 'drawn'"):
        Simulator(EnvConfig(num_agents=8, planner="astar"), grid=grid).reset(seed=0)


@pytest.mark.parametrize("orders", [None, OrderSpec(per_hour=60.0)])
def test_where_places_lie_too_near_to_each_other_robots_begin_elsewhere_on_the_floor(orders: OrderSpec | None) -> None:
    """With orders they stand there until one comes."""
    picks, stations = np.array([(0, 0), (0, 1), (1, 0), (1, 1), (2, 0)]), np.array([(8, 8), (8, 7), (7, 8)])
    grid = GridMap(np.zeros((9, 9), dtype=bool), cell_size=0.5, picks=picks, stations=stations)
    config = EnvConfig(num_agents=7, planner="astar", arrival="pass" if orders is None else "stop", orders=orders)
    simulator = Simulator(config, grid=grid)
    simulator.reset(seed=3)
    body = bodies(*simulator.state.pose[0].astype(np.float64).T)
    first, second = np.triu_indices(7, 1)
    assert separation(body[first], body[second]).min() > 0.0
    places = set(simulator.grid.endpoints[2])
    goals, starts = ({tuple(cell) for cell in cells.tolist()} for cells in
                     (simulator.state.goal[0], grid.standing(simulator.state.pose[0, :, :2])))  # fmt: skip
    assert starts - places
    assert goals <= (places if orders is None else places | starts)


@pytest.mark.parametrize("name", sorted(LAYOUTS))
def test_starts_touch_nothing_and_goals_stay_distinct(name: str) -> None:
    grid = make_layout(name)
    simulator = Simulator(EnvConfig(num_agents=24, planner="astar", action_repeat=2), 2, grid=grid)
    simulator.reset(seed=5)
    walls = [kind for kind in (shelves(grid.walls), around(grid.discs)) if len(kind)]
    first, second = np.triu_indices(24, 1)
    for world in range(2):
        body = bodies(*simulator.state.pose[world].astype(np.float64).T)
        # 0.15 m to robots, half of it to shelves
        assert separation(body[first], body[second]).min() > 0.0
        assert min(separation(body[:, None], kind[None]).min() for kind in walls) > 0.07
    cruise = np.full((2, 24), simulator.cruise_action)
    for _ in range(150):
        simulator.step(cruise)
        for world in range(2):
            assert len({tuple(goal) for goal in simulator.state.goal[world].tolist()}) == 24
    assert simulator.state.goals.sum() > 0
    endpoints = {tuple(cell) for cell in np.concatenate([grid.picks, grid.stations]).tolist()}
    assert {tuple(goal) for goal in simulator.state.goal.reshape(-1, 2).tolist()} <= endpoints


def test_lifelong_robots_go_on_and_never_terminate() -> None:
    inner = np.argwhere(np.ones((8, 8))) + 3  # not in the corners, where turning round takes its time
    grid = GridMap(np.zeros((14, 14), dtype=bool), picks=inner[::2], stations=inner[1::2])
    simulator = Simulator(EnvConfig(num_agents=1, planner="astar", action_repeat=2, max_steps=400), 2, grid=grid)
    simulator.reset(seed=1)
    cruise = np.full((2, 1), simulator.cruise_action)
    kinds: list[list[bool]] = [[], []]
    stations = {tuple(cell) for cell in simulator.grid.stations.tolist()}
    for step in range(400):
        before = [tuple(goal) for goal in simulator.state.goal[:, 0].tolist()]
        simulator.step(cruise)
        assert not simulator.terminated.any()
        assert simulator.truncated.tolist() == [step == 399] * 2
        for world in np.flatnonzero(simulator.events.arrived[:, 0]).tolist():
            kinds[world].append(before[world] in stations)
            goal = tuple(simulator.state.goal[world, 0].tolist())
            assert goal != before[world]
            # the route begins at the goal just reached and ends at the next one
            ends = simulator.routes[world, 0, [0, int(simulator.state.route_points[world, 0]) - 1]]
            np.testing.assert_allclose(ends, simulator.grid.centre([before[world], goal]), atol=1e-5)
    for kind in kinds:
        assert len(kind) > 4
        assert all(a != b for a, b in zip(kind[1:], kind, strict=False))


def test_one_shot_robots_terminate_where_they_arrived_and_stay() -> None:
    config = EnvConfig(num_agents=3, tasks="one_shot", planner="astar", action_repeat=2)
    simulator = Simulator(config, grid=room(12, 12))
    simulator.reset(seed=3)
    cruise = np.full((1, 3), simulator.cruise_action)
    goal = simulator.state.goal.copy()
    where: dict[int, list[float]] = {}
    for _ in range(200):
        simulator.step(cruise)
        for robot in range(3):
            if simulator.events.arrived[0, robot]:
                assert robot not in where  # once only
                assert simulator.terminated[0, robot]
                where[robot] = simulator.state.pose[0, robot].tolist()
                reached = np.hypot(*(where[robot][:2] - simulator.grid.centre(goal[0, robot])))
                assert reached <= 0.5
            if robot in where:
                assert simulator.state.pose[0, robot].tolist() == where[robot]
                assert simulator.state.speed[0, robot] == 0.0
            assert bool(simulator.terminated[0, robot]) == (robot in where)
    assert len(where) == 3
    assert simulator.state.goals[0].tolist() == [1, 1, 1]
    np.testing.assert_array_equal(simulator.state.goal, goal)


@pytest.mark.parametrize("tasks", ["lifelong", "one_shot"])
def test_a_collision_may_terminate(tasks: str) -> None:
    config = EnvConfig(num_agents=10, planner="astar", action_repeat=2, terminate_on_collision=True, tasks=tasks)  # type: ignore[arg-type]
    simulator = Simulator(config, grid=room(7, 7))
    simulator.reset(seed=3)
    cruise = np.full((1, 10), simulator.cruise_action)
    hit = np.zeros(10, dtype=bool)
    for _ in range(60):
        simulator.step(cruise)
        hit |= (simulator.events.hit_robot[0] > 0) | (simulator.events.hit_shelf[0] > 0)
        assert simulator.terminated[0][hit].all()
        assert (simulator.state.speed[0][hit] == 0).all()
        if tasks == "lifelong":
            np.testing.assert_array_equal(simulator.terminated[0], hit)
    assert hit.any()


POSE = [(2.3, 5.4, 0.3), (8.5, 2.5, math.pi / 2)]
GOAL = [(2, 9), (0, 0)]


def simulator(worlds: int = 1, grid: GridMap | None = None, **changes: object) -> Simulator:
    config = EnvConfig(num_agents=2, planner="astar", action_repeat=2).replace(**changes)
    return Simulator(config, worlds, grid=room(12, 12) if grid is None else grid)


def test_robots_stand_and_go_as_told() -> None:
    sim = simulator(2)
    swapped = Assignment(POSE[::-1], GOAL[::-1])
    sim.reset(1, [Assignment(POSE, GOAL), swapped])
    np.testing.assert_allclose(sim.state.pose[0], POSE, atol=1e-6)
    np.testing.assert_allclose(sim.state.pose[1], POSE[::-1], atol=1e-6)
    assert sim.state.goal[0].tolist() == [list(goal) for goal in GOAL]
    first = sim.routes[0, 0]
    np.testing.assert_allclose(first[0], sim.grid.centre((6, 2)), atol=0.3)
    last = int(sim.state.route_points[0, 0]) - 1
    np.testing.assert_allclose(first[last], sim.grid.centre(GOAL[0]), atol=1e-3)


@pytest.mark.parametrize(
    ("pose", "goal", "says"),
    [
        (POSE, [(2, 9), (2, 9)], "same goal"),
        (POSE, GOAL[:1], "2 poses and 1 goals"),
        ([(1.0, math.nan, 0.0)], GOAL[:1], "pose=.* 3 finite numbers a robot"),
        (POSE, [(0.5, math.nan), (2.0, 3.0)], "goal=.*a cell.*a point, a pose"),
        (POSE, [(1, 2, 3, 4)] * 2, "goal=.*a cell.*a point, a pose"),
        ([(2.3, 5.4, 0.0), (2.5, 5.4, 0.0)], GOAL, "robot 1 touches"),
        ([(0.2, 5.4, 0.0), (8.5, 2.5, 0.0)], GOAL, "robot 0 touches"),
        (POSE, [(50, 1), (0, 0)], "goal of robot 0 .* outside"),
        ([POSE[0], (50.0, 2.0, 0.0)], GOAL, r"pose: \(50, 2\) is not on the floor of 12 x 12 m"),
    ],
)
def test_what_cannot_be_is_an_error(pose: object, goal: object, says: str) -> None:
    with pytest.raises((ConfigError, MapError), match=says):
        simulator().reset(None, [Assignment(pose, goal)])  # type: ignore[arg-type]


def test_an_assignment_must_fit_worlds_and_robots() -> None:
    for worlds, robots, says in ((2, 2, "2 of type Assignment"), (1, 3, "2 robots does not fit num_agents=3")):
        with pytest.raises(ConfigError, match=says):
            simulator(worlds, num_agents=robots).reset(None, [Assignment(POSE, GOAL)])


ONE_SHOT = EnvConfig(tasks="one_shot")
DISC = disc_of(ONE_SHOT, 1.0)


def plain_cut_off(grid: GridMap, starts: np.ndarray, goals: np.ndarray) -> list[bool]:
    """For each robot: occupy the discs of all others' goals, and ask the map for the way."""
    result = []
    for k in range(len(goals)):
        occupied = grid.occupied.copy()
        for j, goal in enumerate(goals):
            cells = goal + DISC
            inside = ((cells >= 0) & (cells < grid.shape)).all(axis=1)
            if j != k:
                occupied[tuple(cells[inside].T)] = True
        if occupied[tuple(starts[k])] or occupied[tuple(goals[k])]:
            result.append(True)
            continue
        left = GridMap(occupied)
        result.append(not np.isfinite(left.distance_to(tuple(goals[k].tolist()))[tuple(starts[k])]))
    return result


def test_the_disc_holds_every_parked_body() -> None:
    # 0.5 m of arrival, 0.808 m from the axle to a rear corner, 0.3 m of the passing body and 0.05 m: 1.658 m.
    assert sorted((DISC**2).sum(axis=1).tolist()) == [0, 1, 1, 1, 1, 2, 2, 2, 2]
    assert len(disc_of(ONE_SHOT, 0.5)) == sum(r * r + c * c < 3.316**2 for r in range(-4, 5) for c in range(-4, 5))


@settings(max_examples=60)
@given(st.integers(0, 10**6))
def test_cut_off_is_what_a_plain_search_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = GridMap(rng.random((9, 12)) < 0.3)
    free = grid.free_cells
    chosen = rng.permutation(len(free))
    count = int(rng.integers(2, 5))
    starts, goals = free[chosen[:count]], free[chosen[count : 2 * count]]
    assert cut_off(grid, starts, goals, DISC).tolist() == plain_cut_off(grid, starts, goals)


@pytest.mark.parametrize(("layout", "robots"), [("paper46", 32), ("narrow", 16), ("single_lane", 8), ("open", 16)])
def test_tasks_are_well_formed(layout: str, robots: int) -> None:
    grid = make_layout(layout)
    tasks = OneShotTasks(grid, ONE_SHOT.replace(num_agents=robots))
    for seed in range(3):
        key = np.array([seed, 0, 0], np.uint64)
        tasks.reset(key)
        starts = tasks.starts(key)[:robots]
        goals = tasks.first_goals(starts, key)
        assert len(set(goals)) == robots
        assert all(start != goal for start, goal in zip(starts, goals, strict=True))
        assert tasks.cut_off() == 0
        assert not any(plain_cut_off(grid, np.array(starts), np.array(goals)))


def test_a_floor_too_small_says_so() -> None:
    # Nine goals whose discs cover no other goal are every second cell of 5 x 5; all about the middle one is shared.
    tasks = OneShotTasks(drawn(["....."] * 5), ONE_SHOT.replace(num_agents=9))
    key = np.zeros(3, np.uint64)
    tasks.reset(key)
    goals = tasks.first_goals(tasks.starts(key)[:9], key)
    assert tasks.cut_off() > 0
    assert len(set(goals)) == 9


def test_lifelong_robots_park_nowhere() -> None:
    simulator = Simulator(EnvConfig(num_agents=2, planner="astar"), grid=drawn(["......"] * 6))
    simulator.reset(seed=0)
    assert np.isnan(simulator.episode_metrics()["cut_off"])
