"""Manoeuvres: hand-made cases, and that whatever is found can be driven by the exact body, pose by pose."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.simulation.worlds import drawn, room
from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.driver import manoeuvre
from warehouse_env.simulation.driver.bodies import SearchArea
from warehouse_env.simulation.driver.scratch import BODY, GOAL, MOST, SearchScratch, make_search_scratch
from warehouse_env.simulation.driver.turning import turning_metrics
from warehouse_env.simulation.physics.floor import floor_of
from warehouse_env.simulation.physics.footprint import body_touches_shelf
from warehouse_env.simulation.physics.geometry import Rectangle, pose_at, rectangles_touch, separation
from warehouse_env.simulation.state import every_kind
from warehouse_env.traffic_spec import TrafficSpec

ROBOT = EnvConfig().robot
PARAMETERS = every_kind(EnvConfig(), 1.0)
NOBODY = np.zeros((0, BODY), dtype=np.float32)
NOWHERE = np.zeros((0, 4), dtype=np.float32)
SCRATCH = make_search_scratch(1)
NEAR = 0.005  # [m]
AISLE = drawn(["#" * 12, "." * 12, "." * 12, "#" * 12])  # two cells wide, from y = 1 to y = 3


def around(
    grid: GridMap,
    avoid: NDArray[np.float32] = NOBODY,
    bodies: NDArray[np.float32] = NOBODY,
    parameters: NDArray[np.void] = PARAMETERS,
) -> SearchArea:
    rooms = np.empty(len(bodies), np.float32)
    return SearchArea(bodies, rooms, avoid, floor_of(grid), turning_metrics(parameters)[0], parameters[0])


def query(
    pose: tuple[float, float, float],
    goals: NDArray[np.float32],
    surroundings: SearchArea,
    most: int = MOST,
    exact: bool = False,
    scratch: SearchScratch = SCRATCH,
) -> manoeuvre.Query:
    """What is searched from a pose; goals float32[K, 4]: poses, and the seconds from there on; none: to make room."""
    near = np.empty((len(goals), GOAL), np.float32)
    for k, goal in enumerate(goals):
        manoeuvre.put_goal(near, k, *goal)
    kind = (
        manoeuvre.EXACTLY
        if exact
        else manoeuvre.ROUGHLY
        if len(goals)
        else manoeuvre.FAR_OFF
        if most == MOST
        else manoeuvre.OFF
    )
    start = pose_at(*(np.float32(value) for value in pose))
    return manoeuvre.Query(start, np.float32(0.0), kind, near, near[:0], surroundings, manoeuvre.TRIES, most, scratch)


def plan(
    grid: GridMap,
    pose: tuple[float, float, float],
    goals: NDArray[np.float32] = NOWHERE,
    avoid: NDArray[np.float32] = NOBODY,
    bodies: NDArray[np.float32] = NOBODY,
    most: int = MOST,
    parameters: NDArray[np.void] = PARAMETERS,
) -> NDArray[np.float64] | None:
    """The arcs [K, 2] (signed length [m], steering [rad]), or None."""
    arcs = np.zeros((manoeuvre.ARCS, 2), dtype=np.float32)
    count, _ = manoeuvre.search(query(pose, goals, around(grid, avoid, bodies, parameters), most), arcs, None)
    return None if count < 0 else arcs[:count].astype(np.float64)


def found(*asked: Any, **options: Any) -> NDArray[np.float64]:
    """The arcs of `plan`, which must find some."""
    arcs = plan(*asked, **options)
    assert arcs is not None
    return arcs


def driven(pose: tuple[float, float, float], arcs: NDArray[np.float64], fine: float = 0.01) -> NDArray[np.float64]:
    """Poses [K, 3] every `fine` metres of the arcs, on exact circles: eq. (2) of paper 000 in double precision."""
    x, y, heading = pose
    poses = [pose]
    for length, steer in arcs:
        bend = -math.tan(steer) / ROBOT.wheelbase
        count = math.ceil(abs(length) / fine)
        for k in range(1, count + 1):
            at = length * k / count
            if abs(bend) < 1e-9:
                poses.append((x + at * math.cos(heading), y + at * math.sin(heading), heading))
            else:
                turned = heading + at * bend
                dx, dy = math.sin(turned) - math.sin(heading), math.cos(heading) - math.cos(turned)
                poses.append((x + dx / bend, y + dy / bend, turned))
        x, y, heading = poses[-1]
    return np.array(poses)


def body(pose: Any) -> tuple[float, float, float, float]:
    """Centre and heading (cos, sin) of the body at an axle pose."""
    x, y, heading = pose
    c, s = math.cos(heading), math.sin(heading)
    back = ROBOT.rear_reach - ROBOT.length / 2
    return x - back * c, y - back * s, c, s


def touches_shelf(grid: GridMap, pose: Any, wide: float = 0.0) -> bool:
    floor = floor_of(grid)
    values = [np.float32(value) for value in (*body(pose), ROBOT.length / 2 + wide, ROBOT.width / 2 + wide)]
    return bool(body_touches_shelf(Rectangle(*values), floor))


def clear_of_shelves(grid: GridMap, pose: Any, arcs: NDArray[np.float64]) -> NDArray[np.float64]:
    """The poses of `driven`, none of which touches a shelf."""
    poses = driven(pose, arcs)
    assert not any(touches_shelf(grid, at) for at in poses)
    return poses


def touch(one: Any, other: Any) -> bool:
    half = (ROBOT.length / 2, ROBOT.width / 2)
    return bool(rectangles_touch(Rectangle(*one[:4], *half), Rectangle(*other[:4], *half)))


def apart(one: Any, other: Any) -> float:
    half = (ROBOT.length / 2, ROBOT.width / 2)
    return float(separation(*(Rectangle(*map(np.float32, (*body[:4], *half))) for body in (one, other))))


def goals_at(*poses: tuple[float, float, float]) -> NDArray[np.float32]:
    return np.array([(*pose, 0.0) for pose in poses], dtype=np.float32)


def rectangles(*poses: tuple[float, float, float]) -> NDArray[np.float32]:
    return np.array([sized(body(pose)) for pose in poses], dtype=np.float32)


def sized(one: tuple[float, float, float, float], length: float = 0.9, width: float = 0.6) -> tuple[float, ...]:
    """A body with its size, as searches take it."""
    return (*one, length / 2, width / 2, math.hypot(length, width) / 2)


@pytest.mark.parametrize("ahead", [3.0, -0.9, 2.4])
def test_straight_ahead_and_straight_back_are_driven_in_one_go(ahead: float) -> None:
    arcs = found(room(9, 12), (5.0, 4.5, 0.0), goals_at((5.0 + ahead, 4.5, 0.0)))
    assert (arcs[:, 0] * ahead > 0.0).all()
    assert arcs[:, 0].sum() == pytest.approx(ahead, abs=0.16)


def test_at_the_goal_there_is_nothing_to_drive() -> None:
    arcs = found(room(9, 12), (5.0, 4.5, 0.1), goals_at((5.05, 4.45, 0.0)))
    assert len(arcs) == 0


def test_nothing_is_found_where_nothing_is() -> None:
    # between walls 1 m apart and 2 m long the body cannot turn round, and behind the wall it cannot come
    grid = GridMap(np.array([[mark == "#" for mark in "#...#..#"]]))
    assert plan(grid, (2.5, 0.5, 0.0), goals_at((2.5, 0.5, math.pi))) is None
    assert plan(grid, (2.5, 0.5, 0.0), goals_at((5.9, 0.5, 0.0))) is None


def test_the_soonest_goal_counts_with_the_time_from_there_on() -> None:
    near, far = (6.5, 4.5, 0.0, 9.0), (8.0, 4.5, 0.0, 0.0)
    arcs = found(room(9, 12), (4.0, 4.5, 0.0), np.array([near, far], dtype=np.float32))
    assert arcs[:, 0].sum() == pytest.approx(4.0, abs=0.3)
    arcs = found(room(9, 12), (4.0, 4.5, 0.0), np.array([(*near[:3], 0.0), (*far[:3], 9.0)], dtype=np.float32))
    assert arcs[:, 0].sum() == pytest.approx(2.5, abs=0.3)


@settings(max_examples=60, deadline=None)
@given(x=st.floats(2.0, 10.0), y=st.floats(1.1, 2.9), heading=st.floats(-math.pi, math.pi), back=st.booleans())
def test_in_an_aisle_of_two_cells_it_turns_whatever_way_it_stands(
    x: float, y: float, heading: float, back: bool
) -> None:
    pose = (x, y, heading)
    if touches_shelf(AISLE, pose, NEAR):
        return
    goal = (max(x - 2.5, 2.0), 2.0, math.pi) if back else (min(x + 2.5, 10.0), 2.0, 0.0)
    arcs = found(AISLE, pose, goals_at(goal))
    poses = clear_of_shelves(AISLE, pose, arcs)
    if len(arcs) < manoeuvre.ARCS:
        off = poses[-1] - goal
        along, left = off[0] * math.cos(goal[2]), off[1] * math.cos(goal[2])
        assert abs(along) < 0.16
        assert abs(left) < 0.11
        assert abs(math.remainder(off[2], 2 * math.pi)) < 0.21


def test_it_leaves_a_dead_end_backwards() -> None:
    grid = drawn(["########", "#....###", "####.###", "#......#", "#......#", "########"])
    pose = (1.9, 4.5, math.pi)  # nose to the end of a lane of one cell, 3 m long
    assert not touches_shelf(grid, pose)
    arcs = found(grid, pose, goals_at((6.0, 2.0, 0.0)))
    clear_of_shelves(grid, pose, arcs)
    assert arcs[0, 0] < 0.0


def test_it_drives_round_standing_bodies() -> None:
    grid = room(7, 12)
    wall = rectangles((5.2, 3.5, 0.0), (5.2, 2.8, 0.0), (5.2, 4.2, 0.0))
    arcs = found(grid, (3.0, 3.5, 0.0), goals_at((8.0, 3.5, 0.0)), bodies=wall)
    poses = driven((3.0, 3.5, 0.0), arcs)
    assert not any(touch(body(at), other) for at in poses for other in wall.tolist())
    assert abs(poses[-1][0] - 8.0) < 0.16


def test_a_way_round_one_that_stands_crosswise_is_soon_found() -> None:
    grid, pose = drawn(["#" * 20, *["." * 20] * 3, "#" * 20]), (8.0, 2.5, 0.0)
    parked = rectangles((9.1, 2.7, 1.5))
    arcs = found(grid, pose, goals_at(*((9.5 + 0.4 * k, 2.5, 0.0) for k in range(8))), bodies=parked, most=1000)
    poses = driven(pose, arcs)
    assert not any(touch(body(at), parked[0]) for at in poses)
    assert poses[-1][0] > 9.3


def test_it_gets_off_a_shelf_beside_which_it_stands_too_near() -> None:
    grid = drawn(["#" * 24, "." * 24, "#" * 24])  # one cell wide, from y = 1 to y = 2
    pose = (20.0, 1.3018, -0.009)  # 2 mm beside the shelf, and its nose leads into it: only straight back is free
    arcs = found(grid, pose, goals_at((8.0, 1.5, 0.0)), most=300)
    poses = clear_of_shelves(grid, pose, arcs)
    assert poses[-1][1] > 1.4


def test_beside_a_body_no_arc_comes_nearer_than_the_field_allows() -> None:
    """The gap that the widest axis shows shrinks and grows again within centimetres, where corners pass sides."""
    parameters, grid = every_kind(EnvConfig(traffic=TrafficSpec(shield=True)), 1.0), room(12, 12)
    rng, planned = np.random.default_rng(5), 0
    margin, pose = float(parameters["field_margin"][0]), (6.0, 6.0, 0.0)
    for _ in range(12000):
        other = body((*rng.uniform(4.5, 7.0, 2), rng.uniform(-math.pi, math.pi)))
        if not margin + 3e-4 < apart(body(pose), other) < margin + 0.006:
            continue
        arcs = plan(
            grid,
            pose,
            goals_at((7.0, 8.0, 1.5), (7.0, 4.0, -1.5)),
            bodies=np.array([sized(other)], np.float32),
            parameters=parameters,
        )
        if arcs is None or len(arcs) == 0:
            continue
        planned += 1
        assert min(apart(body(at), other) for at in driven(pose, arcs[:1], fine=0.001)) > margin
    assert planned > 20


@pytest.mark.parametrize("heading", [0.0, 0.4, 0.9, 2.56, -2.0])
def test_along_a_parallel_body_that_is_as_near_as_the_field_allows_it_drives_straight(heading: float) -> None:
    parameters = every_kind(EnvConfig(traffic=TrafficSpec(shield=True)), 1.0)
    pose, beside = (6.0, 6.0, heading), ROBOT.width + float(parameters["field_margin"][0]) + 7e-4
    other = (6.0 - beside * math.sin(heading), 6.0 + beside * math.cos(heading), heading)
    goal = (6.0 + 1.2 * math.cos(heading), 6.0 + 1.2 * math.sin(heading), heading)
    arcs = found(room(12, 12), pose, goals_at(goal), bodies=rectangles(other), parameters=parameters)
    assert arcs[:, 1].tolist() == [0.0]


def test_it_makes_room_for_the_path_of_another() -> None:
    path = rectangles(*((0.5 + 0.25 * k, 2.0, 0.0) for k in range(40)))
    pose = (6.0, 2.0, 0.0)
    grid = drawn(["#" * 12, "." * 12, "." * 12, "#####...####", "#" * 12])  # a bay to the south
    arcs = plan(grid, pose, avoid=path)
    assert arcs is None or not any(touch(body(driven(pose, arcs)[-1]), other) for other in path.tolist())
    path[:, 1] = 3.5  # in the northern lane instead
    arcs = found(grid, (6.0, 3.0, 0.0), avoid=path)
    poses = driven((6.0, 3.0, 0.0), arcs)
    assert not any(touch(body(poses[-1]), other) for other in path.tolist())
    assert not any(touches_shelf(grid, at) for at in poses)
    assert np.abs(arcs[:, 0]).sum() < 4.0


def test_a_robot_that_stands_clear_need_not_move() -> None:
    arcs = found(room(9, 12), (5.0, 2.0, 0.0), avoid=rectangles((5.0, 5.0, 0.0)))
    assert len(arcs) == 0


def test_the_turning_metric_by_hand() -> None:
    metric = turning_metrics(PARAMETERS)[0]
    middle = metric.shape[1] // 2
    assert metric[0, middle, middle] == 0.0
    assert metric[0, middle, middle - 15] == pytest.approx(3.0 / 0.8, abs=0.2)  # 3 m behind the goal, along its line
    assert metric[0, middle, middle + 15] == pytest.approx(3.0 / 0.45, abs=0.4)  # past it: back
    mirrored = metric[(-np.arange(36)) % 36][:, ::-1]
    assert np.median(np.abs(mirrored - metric)) < 0.2  # left and right are alike but for the cells' edges
    assert metric[18, middle, middle] > 2.0  # a turn on the spot takes its time


def test_a_search_reads_nothing_that_another_one_left_behind() -> None:
    """Poses of both kinds: found within few nodes, and cut off there."""
    grid, rng = drawn([*["." * 12] * 3, "..####..##..", *["." * 12] * 3]), np.random.default_rng(3)
    used, counts = make_search_scratch(1), []
    for _ in range(40):
        pose = tuple(rng.uniform((1.2, 1.2, -math.pi), (10.8, 5.8, math.pi)))
        goal = goals_at(tuple(rng.uniform((1.2, 1.2, -math.pi), (10.8, 5.8, math.pi))))
        for most in (300, MOST):
            found = []
            for scratch in (used, make_search_scratch(1)):
                arcs, asked = np.zeros((manoeuvre.ARCS, 2), dtype=np.float32), query(pose, goal, around(grid), most)
                count = manoeuvre.search_once(asked._replace(scratch=scratch), asked.near, 1, arcs, None)
                found.append((count, arcs.tolist()))
            assert found[0] == found[1]
            counts.append(count)
    assert manoeuvre.CUT_OFF in counts
    assert max(counts) > 0


def test_a_body_is_gone_round_by_its_own_size() -> None:
    """Beside a small one that stands in the aisle there is room to pass; beside a large one there is none."""
    pose, other = (2.0, 2.0, 0.0), (6.0, 1.3, 1.0, 0.0)
    for length, width, passes in ((0.5, 0.4, True), (2.0, 1.9, False)):
        arcs = plan(AISLE, pose, goals_at((9.0, 2.0, 0.0)), bodies=np.array([sized(other, length, width)], np.float32))
        assert (arcs is not None) == passes
