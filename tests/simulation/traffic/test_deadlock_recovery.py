"""Robots that get away: a ring dissolved by the one with the least right, and those astray who get another route."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from tests.simulation.reference import separation
from tests.simulation.rights import World, rectangles
from tests.simulation.worlds import drawn, give_line, put, room
from warehouse_env.config import EnvConfig
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment
from warehouse_env.simulation.traffic import deadlock_recovery, waits
from warehouse_env.simulation.traffic.off_route import far_off
from warehouse_env.simulation.traffic.right_of_way import NOBODY

AISLE = drawn(["#" * 16, "." * 16, "#" * 16])


def ring(ages: Sequence[int] = (5, 2, 9)) -> World:
    """Three robots, each of whose ways the next one bars."""
    world = World((10.0, 10.0, 0.0), (11.6, 10.2, math.pi / 2), (10.6, 11.6, -2.4), ages=ages).decide()
    world.robots["traffic"]["yields_to"] = [1, 2, 0]
    world.robots["clocks"]["waiting_time"] = 3.0
    return world


def resolve(world: World) -> list[int]:
    """Let them make room; return who has a manoeuvre."""
    sim = world.simulator
    if waits.look(world.robots, waits.scratch(len(world.robots))):
        deadlock_recovery.resolve_deadlocks(0, 1, sim.worlds, sim.search_setup, sim._scratch.search)
    return [int(k) for k in np.flatnonzero(world.robots["manoeuvre"]["arcs"])]


def test_the_one_with_the_least_right_leaves_the_others_paths() -> None:
    world = ring()
    assert resolve(world) == [1]
    assert world.robots["traffic"]["retreating"].tolist() == [0, 1, 0]
    assert world.robots["traffic"]["pause"][1] == waits.LEAVES
    world.decide()
    end = rectangles(world.path(1))[-1:]
    for other in (0, 2):
        assert float(separation(end, rectangles(world.path(other))).min()) > 0.0


def test_of_equals_it_is_always_the_last() -> None:
    assert resolve(ring(ages=(5, 5, 5))) == [2]


def test_a_robot_behind_a_permanently_standing_one_looks_for_a_way_round_it() -> None:
    world = World((10.0, 10.0, 0.0), (11.5, 10.0, 0.0), ages=[5, 0]).decide()
    world.robots["traffic"]["yields_to"] = [1, NOBODY]
    world.robots["clocks"]["waiting_time"] = 3.9
    resolve(world)
    assert world.robots["traffic"]["pause"].tolist() == [0.0, 0.0]
    world.robots["clocks"]["waiting_time"] = 4.1
    resolve(world)  # it searches, and whether or not it finds a way, not again for a while
    assert world.robots["traffic"]["pause"].tolist() == [waits.PAUSE, 0.0]
    assert world.robots["traffic"]["retreating"].tolist() == [0, 0]


def test_a_robot_that_waits_for_itself_leaves_its_place() -> None:
    """It lets a person out of an aisle: there is one way."""
    world = World((6.0, 1.5, 0.0), grid=AISLE, people=1).decide()
    person = world.simulator.people.persons[0, 0]
    person["x"], person["y"] = 7.0, 1.5
    world.robots["traffic"]["yields_to"], world.robots["clocks"]["waiting_time"] = 0, 3.0
    assert resolve(world) == [0]
    assert world.robots["traffic"]["retreating"].tolist() == [1]
    world.decide()
    ways = rectangles(world.path(0))[..., 0]
    assert ways.max() < 6.15 + 1e-3
    assert ways[-1].max() < 6.15 - 0.9  # a body's length back


def test_a_retreating_robot_drives_around_people() -> None:
    """There is as much room before the robot as behind it; it leaves its place to where nobody is."""
    for beside in (-1.0, 1.0):
        world = World((10.15, 10.0, 0.0), people=1).decide()
        person = world.simulator.people.persons[0, 0]
        person["x"], person["y"] = 9.85 + 1.2 * beside, 10.0
        world.robots["traffic"]["yields_to"], world.robots["clocks"]["waiting_time"] = 0, 3.0
        assert resolve(world) == [0]
        world.decide()
        gaps = np.abs(rectangles(world.path(0))[..., 0] - person["x"]).min()
        assert gaps > 0.25 + 0.35


def shut_in() -> World:
    """In an aisle of one cell one faces a parked robot, and two more wait right behind it, nose to tail."""
    poses = [(10.1, 1.5, math.pi), (9.6, 1.5, 0.0), (8.6, 1.5, 0.0), (7.6, 1.5, 0.0)]
    world = World(*poses, ages=[0, 9, 8, 7], grid=AISLE).decide()
    world.robots["traffic"]["yields_to"] = [NOBODY, 0, 1, 2]
    world.robots["clocks"]["waiting_time"] = 5.0
    world.robots["task"]["alive"][0] = 0
    return world


def test_behind_one_that_is_shut_in_the_last_backs_off_first() -> None:
    world = shut_in()
    assert resolve(world) == [3]
    assert world.robots["traffic"]["retreating"].tolist() == [0, 0, 0, 1]
    world.decide()
    assert rectangles(world.path(3))[-1, :, 0].max() < 7.6 - 1.0  # off the floor behind the one before it
    assert resolve(world) == [3]  # which now waits for that


WINDING = drawn(
    [
        "####################",
        "#...################",
        "#......###...#######",
        "#...##.###.#.#######",
        "######.###.#.##...##",
        "######.....#......##",
        "##############....##",
        "####################",
    ]
)
WEST, EAST = (2, 2), (4, 15)  # in the rooms at both ends of its passage of one cell
IN_THE_PASSAGE = {  # robots as (row, column, heading in quarter turns, goal)
    "two on a straight": [(5, 8, 0, EAST), (5, 10, 2, WEST)],
    "two at a bend": [(3, 10, 1, EAST), (2, 12, 2, WEST)],
    "two, and one that waits behind a bend": [(5, 7, 0, EAST), (5, 10, 2, WEST), (3, 10, 3, (1, 2))],
}


def meet(meeting: str) -> Simulator:
    """Drive at full speed along the routes for three minutes, under right of way."""
    starts, goals = [], []
    for row, column, quarters, goal in IN_THE_PASSAGE[meeting]:
        heading = math.pi / 2 * quarters
        x, y = WINDING.centre((row, column))
        starts.append((x + 0.3 * math.cos(heading), y + 0.3 * math.sin(heading), heading))
        goals.append(goal)
    rights = {"traffic": "rules"}
    config = EnvConfig(num_agents=len(starts), action_repeat=2, planner="astar", max_steps=10**6, **rights)
    sim = Simulator(config, grid=WINDING)
    sim.reset(1, [Assignment(np.array(starts), np.array(goals))])
    for _ in range(900):
        sim.step(np.full((1, len(starts)), int(sim.cruise_action)))
    return sim


@pytest.mark.parametrize("meeting", IN_THE_PASSAGE)
def test_robots_that_meet_in_a_winding_one_cell_passage_get_out(meeting: str) -> None:
    """Room is several metres and bends away: no short search gets there, and who waits behind stands on the way."""
    robots = meet(meeting).robots
    assert robots["totals"]["longest_standing"].max() < 60.0
    assert robots["totals"]["goals"].sum() > 0
    assert not robots["totals"]["hits_robot"].any()
    assert not robots["totals"]["hits_shelf"].any()


WALL = "#" * 20
ROOMS = drawn(["." * 32] + [f"......{WALL}......"] * 5)  # joined by an aisle of one cell, from y = 5 to y = 6
GOAL = (5, 30)
STILL = np.array([[EnvConfig().speed_levels.index(0.0) * len(EnvConfig().lateral_offsets)]])


def simulator_at(x: float, y: float, heading: float, reroute: bool = False) -> Simulator:
    """One robot that was given a route in the eastern room and is somewhere else now."""
    config = EnvConfig(
        num_agents=1, planner="astar", tasks="one_shot", action_repeat=2, traffic="routes" if reroute else "none"
    )
    simulator = Simulator(config, grid=ROOMS)
    simulator.reset([1], [Assignment(np.array([[27.5, 4.5, -1.5]]), np.array([GOAL]))])
    put(simulator, 0, (x, y, heading))
    return simulator


@pytest.mark.parametrize("reroute", [False, True])
def test_a_robot_far_off_its_route_gets_another_and_arrives(reroute: bool) -> None:
    simulator = simulator_at(2.5, 0.8, math.pi, reroute)
    for _ in range(500):
        simulator.step(np.full((1, 1), simulator.cruise_action))
    assert simulator.robots["totals"]["reroutes"][0, 0] >= 1
    assert simulator.robots["task"]["alive"][0, 0] == 0  # it is there


@pytest.mark.parametrize("reroute", [False, True])
@pytest.mark.parametrize("believed", [(-0.4, 3.0), (32.4, 3.0), (2.5, -0.4), (2.5, 6.4), (10.0, 3.0)])
def test_a_robot_that_believes_to_be_off_the_floor_or_in_a_shelf_gets_a_route(
    believed: tuple[float, float], reroute: bool
) -> None:
    simulator = simulator_at(*believed, 0.0, reroute)
    simulator.robots["clocks"]["standing_time"] = simulator.robots["clocks"]["waiting_time"] = 9.0
    assert simulator.dispatcher.reroute(simulator.steps) == [0]
    line = simulator.routes[0, 0, : simulator.robots["on_route"]["points"][0, 0]]
    np.testing.assert_allclose(line[-1], simulator.grid.centre(np.array(GOAL)), atol=1e-3)


def test_astray_in_the_cell_of_its_goal_it_goes_on_to_its_centre() -> None:
    simulator = simulator_at(30.05, 0.95, -1.5)  # in the goal's cell, but too far from its centre to have arrived
    give_line(simulator, 0, [[2.0, 5.5], [2.5, 5.5]])
    for _ in range(10):
        simulator.step(STILL)
    assert simulator.robots["on_route"]["points"][0, 0] == 2
    for _ in range(100):
        simulator.step(np.full((1, 1), simulator.cruise_action))
    assert simulator.robots["totals"]["reroutes"][0, 0] >= 1
    assert simulator.robots["task"]["alive"][0, 0] == 0


def test_driving_and_near_robots_keep_their_routes() -> None:
    simulator = simulator_at(28.0, 5.0, 0.5)
    for _ in range(20):
        simulator.step(STILL)
    assert simulator.robots["totals"]["reroutes"][0, 0] == 0
    put(simulator, 0, (26.6, 0.6, 0.5, 0.5))  # far, but it drives
    simulator.robots["clocks"]["standing_time"] = 9.0
    simulator.step(STILL)
    assert simulator.robots["totals"]["reroutes"][0, 0] == 0
    for _ in range(10):
        simulator.step(STILL)
    assert simulator.robots["totals"]["reroutes"][0, 0] == 1  # it has come to a halt there


@pytest.mark.parametrize(("offset", "cell", "far"), [(1.2, 1.0, 1.5), (3.0, 1.0, 3.3), (0.6, 4.0, 4.0)])
def test_an_offset_and_the_way_from_a_cells_centre_are_not_astray(offset: float, cell: float, far: float) -> None:
    config = EnvConfig(lateral_offsets=(0.0, offset, -offset))
    assert far_off(config, cell) == pytest.approx(far)


def test_a_robot_at_a_wide_offset_keeps_its_route() -> None:
    config = EnvConfig(num_agents=1, planner="astar", lateral_offsets=(0.0, 2.5), keep_right=0.0)
    simulator = Simulator(config, grid=room(12, 24))
    simulator.reset([1], [Assignment(np.array([[2.5, 3.5, 0.0]]), np.array([(8, 21)]))])
    put(simulator, 0, (8.0, 6.0, 0.0))  # 2.5 m to the left of its route along y = 3.5
    simulator.robots["on_route"]["position"] = 5.5
    stop = np.full((1, 1), config.speed_levels.index(0.0) * 2 + 1)
    for _ in range(30):
        simulator.step(stop)
    assert simulator.robots["totals"]["reroutes"][0, 0] == 0
