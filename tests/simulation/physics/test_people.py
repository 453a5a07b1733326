"""People on foot: how they walk, what robots see of them, contacts with them, and that the field knows none."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.simulation.safe_stops import checked as checked  # a fixture
from tests.simulation.worlds import coast, drawn, lay, raw, room, stage
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import Cell
from warehouse_env.simulation.physics.people import AT_GOAL, GIVEN_UP, KEEP, PACE, PATIENCE, RADIUS, RESTS, START
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.traffic_spec import TrafficSpec

STEP = 0.1 * float(PACE)  # [m]
FAR = (18.0, 5.0, 0.0)
STAND, AHEAD, BACK = 5, 15, 0  # discrete actions
GUARDED: dict[str, Any] = {"action_type": "raw", "traffic": TrafficSpec(shield=True)}


def with_people(*where: Any, people: int = 1, **changes: Any) -> Simulator:
    """A stage with people, whose next goals are drawn from a seed; discrete actions unless changed."""
    simulator = stage(*where, people=people, **{"action_type": "discrete", **changes})
    simulator.people.begin(0, [3, 0], simulator.robots[0])
    return simulator


def send(simulator: Simulator, x: float, y: float, goal: Cell, person: int = 0) -> Any:
    """Stand a person of the first world at (x, y) [m], on the way to a cell; return its record."""
    people, grid = simulator.people, simulator.grid
    people.ways[0, person] = grid.distance_to(goal)[::-1]
    o = people.persons[0, person]
    o["x"], o["y"], o["cos"], o["left"] = x, y, 1.0, np.inf
    o["goal_x"], o["goal_y"] = grid.centre(np.array(goal))
    return o


def still(simulator: Simulator, x: float, y: float, person: int = 0) -> Any:
    """Stand a person at (x, y) [m] that rests."""
    o = simulator.people.persons[0, person]
    o["x"], o["y"], o["rest"] = x, y, 1e6
    return o


def drive(simulator: Simulator, action: int, steps: int) -> float:
    """Give all robots an action for some steps; return what contacts cost robot 0."""
    costs = 0.0
    for _ in range(steps):
        simulator.step(np.full((1, simulator.num_agents), action))
        costs += simulator.reward_terms[0, 0, 2]
    return costs


def gap_to(simulator: Simulator, person: int = 0, robot: int = 0) -> float:
    """The gap [m] between a person and a robot, worked out in double precision."""
    o, r, body = simulator.people.persons[0, person], simulator.robots[0, robot], RobotSpec()
    dx, dy = float(o["x"]) - float(r["motion"]["x"]), float(o["y"]) - float(r["motion"]["y"])
    c, s = math.cos(float(r["motion"]["heading"])), math.sin(float(r["motion"]["heading"]))
    ahead, left = dx * c + dy * s + body.rear_reach - body.length / 2, dy * c - dx * s
    outside = max(abs(ahead) - body.length / 2, 0.0), max(abs(left) - body.width / 2, 0.0)
    return math.hypot(*outside) - float(RADIUS)


def test_a_person_walks_straight_to_its_goal_rests_and_wants_another() -> None:
    simulator = with_people(room(10, 20), FAR)
    o = send(simulator, 2.5, 2.5, (7, 9))  # the cell around (9.5, 2.5)
    for k in range(1, 20):
        drive(simulator, STAND, 1)
        assert o["x"] == pytest.approx(2.5 + k * STEP, abs=1e-4)
        assert o["y"] == pytest.approx(2.5, abs=1e-5)
    drive(simulator, STAND, math.ceil((7.0 - AT_GOAL) / STEP) + 1 - 19)
    assert RESTS[0] - 0.1 <= o["rest"] <= RESTS[1]
    here = float(o["x"])
    assert abs(here - 9.5) < AT_GOAL
    drive(simulator, STAND, math.floor(RESTS[0] / 0.1) - 2)
    assert o["x"] == here
    drive(simulator, STAND, math.ceil((RESTS[1] - RESTS[0]) / 0.1) + 20)
    assert math.hypot(o["x"] - here, o["y"] - 2.5) > 0.5


def test_a_person_passes_a_robot_at_a_distance() -> None:
    simulator = with_people(room(10, 20), (6.8, 5.5, 0.0))
    simulator.robots["motion"]["speed"] = 0.0
    o = send(simulator, 2.5, 5.5, (4, 12))
    least = math.inf
    for _ in range(120):
        drive(simulator, STAND, 1)
        least = min(least, gap_to(simulator))
    assert o["rest"] > 0 or abs(o["x"] - 12.5) < 1.0
    assert KEEP - 1e-4 <= least <= KEEP + STEP


def test_where_there_is_no_way_past_a_person_turns_away() -> None:
    lane = drawn(["##########", "..........", "##########"])
    simulator = with_people(lane, (5.75, 1.5, 0.0))
    o = send(simulator, 1.5, 1.5, (1, 9))
    wanted = []
    for _ in range(200):
        drive(simulator, STAND, 1)
        wanted.append(float(o["goal_x"]))
        assert gap_to(simulator) > 0
    first = next(k for k, x in enumerate(wanted) if x != 9.5)
    assert first * 0.1 > PATIENCE
    assert wanted[first] < 5.0  # on its own side


@pytest.mark.usefixtures("checked")
@pytest.mark.parametrize("lane", [["##########", "..........", "##########"], [".........."]])
def test_nobody_comes_so_near_to_a_robot_that_it_may_not_drive_on(lane: list[str]) -> None:
    """However long a robot stands in its way: under the field it could not leave then."""
    simulator = with_people(drawn(lane), (5.75, len(lane) / 2, 0.0), **GUARDED)
    send(simulator, 2.5, len(lane) / 2, (len(lane) // 2, 9))
    least = math.inf
    for _ in range(40):  # it turns away at last
        coast(simulator, 1)
        least = min(least, gap_to(simulator))
    assert KEEP <= least + 1e-4 < KEEP + STEP
    x = float(simulator.robots["motion"]["x"][0, 0])
    for _ in range(5):
        simulator.step(raw(simulator, (1.0, 0.0)))
    assert simulator.robots["motion"]["x"][0, 0] > x + 0.05


def test_how_long_a_person_is_kept_from_walking_is_counted() -> None:
    """Between two robots in an aisle, until one of them is gone."""
    lane = drawn(["############", "............", "############"])
    simulator = with_people(lane, (4.2, 1.5, 0.0), (5.95, 1.5, math.pi))
    o = send(simulator, 5.1, 1.5, (1, 11))
    for steps in range(1, 80):
        drive(simulator, STAND, 1)
        assert o["kept"] == pytest.approx(0.1 * (steps - 1), abs=0.01)  # the first step is where it begins
    assert simulator.episode_metrics()["longest_person_kept_s"] == pytest.approx(7.8, abs=0.01)
    simulator.robots["motion"]["x"][0] = 0.8, 11.8
    drive(simulator, STAND, 20)
    assert o["kept"] == 0
    assert simulator.episode_metrics()["longest_person_kept_s"] == pytest.approx(7.8, abs=0.01)


def test_a_robot_that_runs_into_a_person_is_put_back_and_counted_once() -> None:
    simulator = with_people(room(10, 20), (5.0, 5.0, 0.0, 1.0))
    lay(simulator, (5.0, 5.0), (18.0, 5.0))
    still(simulator, 6.0, 5.0)
    r = simulator.robots[0, 0]
    assert drive(simulator, AHEAD, 15) == -5.0
    assert 0 < gap_to(simulator) < 0.08
    assert r["totals"]["hits_person"] == 1
    assert r["events"]["touching"] == 1
    assert simulator.episode_metrics()["collisions_person"] == 1
    assert simulator.episode_metrics()["collisions_per_km"] == pytest.approx(
        1000 / float(r["totals"]["distance"]), rel=1e-6
    )
    drive(simulator, BACK, 10)  # by more than near_miss_gap, and run into it again
    assert gap_to(simulator) > 0.1
    assert r["totals"]["hits_person"] == 1
    drive(simulator, AHEAD, 25)
    assert r["totals"]["hits_person"] == 2


def test_lidar_sees_people_from_the_bodys_centre() -> None:
    simulator = with_people(room(20, 20), (5.3, 10.0, 0.0), people=2)
    still(simulator, 8.0, 10.0)  # straight ahead of the centre at (5.0, 10.0)
    still(simulator, 5.0, 12.0, person=1)  # abeam
    drive(simulator, STAND, 1)
    rays = simulator.observation[0, 0, simulator.layout.slices["lidar"]].astype(np.float64)
    ranges = 1 / rays - 1
    assert ranges[0] == pytest.approx(3.0 - RADIUS, abs=1e-4)
    assert ranges[8] == pytest.approx(2.0 - RADIUS, abs=1e-4)  # a quarter of 32 rays
    assert ranges[16] == pytest.approx(5.0, abs=1e-4)  # the rim
    assert ranges[1] == pytest.approx(6.0, abs=1e-4)  # the next ray passes the one ahead


@pytest.mark.usefixtures("checked")
@pytest.mark.parametrize("away", [0.4, 2.5])
def test_under_the_field_a_robot_stops_before_a_person(away: float) -> None:
    simulator = with_people(room(10, 20), (5.0, 5.0, 0.0), **GUARDED)
    still(simulator, 5.15 + float(RADIUS) + away, 5.0)
    for _ in range(60):
        simulator.step(raw(simulator, (1.0, 0.0)))
        assert gap_to(simulator) > 0.02
    assert simulator.robots["motion"]["speed"][0, 0] == 0
    # one step of .1 m/s and a stop take .2 s and .01 m: nearer than that nobody may be
    assert 0.2 * PACE < gap_to(simulator) < 0.2 * PACE + 0.1 + 0.05


def test_people_that_turn_away_pass_no_robot() -> None:
    """A robot stands in the doorway between a person and its goal; so it goes the long way round, or elsewhere."""
    grid = drawn(["............", ".####.#####.", "............"])
    simulator = with_people(grid, (5.6, 1.5, 0.0))
    o = simulator.people.persons[0, 0]
    o["x"], o["y"], o["wants"] = 5.5, 2.5, GIVEN_UP
    simulator.people.send_on(simulator.robots)
    way = simulator.people.ways[0, 0]  # rows from the south
    assert not np.isfinite(way[1, 5])
    assert np.isfinite(way[2, 5])


@pytest.mark.usefixtures("checked")
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 2**31 - 1))
def test_whatever_people_and_robots_do_the_field_lets_nobody_be_hit(seed: int) -> None:
    """People who dart about at PACE, through each other and into robots, which get random commands."""
    rng = np.random.default_rng(seed)
    poses = [(x, y, float(rng.uniform(-3, 3))) for x in (3.0, 9.0) for y in (3.0, 9.0)]
    simulator = with_people(drawn(["............"] * 5 + ["....####...."] * 2 + ["............"] * 5), *poses, people=3,
                      **GUARDED)  # fmt: skip
    persons = simulator.people.persons[0]
    persons["x"], persons["y"], persons["rest"] = 6.0, [1.0, 6.0, 11.0], 1e6
    toward = rng.integers(0, 4, 3)
    for _ in range(150):
        simulator.step(rng.uniform(-1, 1, (1, 4, 2)).astype(np.float32) + np.float32([0.4, 0.0]))
        at = simulator.state.pose[0, toward, :2] - np.stack([persons["x"], persons["y"]], axis=-1)
        way = at / np.hypot(*at.T)[:, None].clip(0.1) * STEP
        persons["x"] += way[:, 0]
        persons["y"] += way[:, 1]
        if rng.random() < 0.03:
            toward = rng.integers(0, 4, 3)
    assert simulator.robots["totals"]["hits_person"].sum() == 0
    assert simulator.robots["totals"]["distance"].sum() > 1.0


def test_people_begin_away_from_robots_and_where_they_can_walk() -> None:
    crowded = Simulator(EnvConfig(num_agents=2, people=1, planner="astar"), grid=room(2, 4))
    with pytest.raises(ConfigError, match="people=1"):
        crowded.reset(1)
    simulator = Simulator(EnvConfig(layout="narrow", num_agents=16, people=20, planner="astar"), 2)
    simulator.reset(5)
    persons, robots = simulator.people.persons, simulator.robots
    apart = np.hypot(
        persons["x"][:, :, None] - robots["motion"]["x"][:, None],
        persons["y"][:, :, None] - robots["motion"]["y"][:, None],
    )
    assert apart.min() >= START
    cells = simulator.grid.cell(np.stack([persons["x"], persons["y"]], axis=-1))
    assert not simulator.grid.occupied[cells[..., 0], cells[..., 1]].any()
