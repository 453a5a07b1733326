"""Robots that stop at their goals, at rest or in a pose: shots and searches that end exactly there, and arrivals."""

from __future__ import annotations

import hashlib
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.simulation.driver.test_manoeuvre import SCRATCH, around, driven, query
from tests.simulation.worlds import drawn, plain_python, room
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.observation import GOAL, observation_layout
from warehouse_env.simulation.driver.arrival import RESTS, STILL, speed_before
from warehouse_env.simulation.driver.shots import shoot
from warehouse_env.simulation.physics.kinematics import approach
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import every_kind
from warehouse_env.simulation.tasks.assignment import Assignment
from warehouse_env.traffic_spec import TrafficSpec

START = Assignment([(2.5, 5.5, 0.0)], [(6, 9)])


def simulator(**changes: object) -> Simulator:
    config = EnvConfig(num_agents=1, planner="astar", keep_right=0.0, max_steps=10**6).replace(**changes)
    sim = Simulator(config, grid=room(12, 12))
    sim.reset(1, [START])
    return sim


POINT = (9.3, 5.2)


@pytest.mark.parametrize("arrival", ["pass", "stop", "pose"])
@pytest.mark.parametrize("goal", [POINT, (*POINT, 1.0), (*POINT, float("nan"))])
def test_goals_may_be_points_and_poses_whenever_a_robot_has_arrived(arrival: str, goal: tuple[float, ...]) -> None:
    sim = simulator(arrival=arrival)
    sim.reset(1, [Assignment([(2.5, 5.5, 0.0)], [goal])])
    last = int(sim.state.route_points[0, 0]) - 1
    np.testing.assert_allclose(sim.routes[0, 0, last], POINT, atol=1e-6)
    assert sim.state.goal[0, 0].tolist() == [6, 9]
    off, _ = drive(sim)
    assert off <= (0.05 if arrival == "pose" else 0.5)


def drive(sim: Simulator, steps: int = 300) -> tuple[float, float]:
    """Cruise up to the first arrival; return the metres off the goal and the speed [m/s] at which it came."""
    goal = sim.robots[0, 0]["task"][["goal_x", "goal_y"]].copy()
    for _ in range(steps):
        sim.step(np.full((1, 1), sim.cruise_action))
        if sim.arrivals:
            r = sim.robots[0, 0]
            return float(np.hypot(r["motion"]["x"] - goal["goal_x"], r["motion"]["y"] - goal["goal_y"])), abs(
                float(r["motion"]["speed"])
            )
    raise AssertionError("nobody arrives")


@pytest.mark.parametrize(("heading", "arrives"), [(float("nan"), True), (0.0, False)])
def test_a_robot_that_stops_at_a_pose_stands_as_exactly_as_with_poses(heading: float, arrives: bool) -> None:
    sim = simulator(arrival="stop")
    sim.reset(1, [Assignment([(8.9, 5.5, 0.0)], [(9.2, 5.5)])])
    sim.robots["task"]["goal_heading"] = heading
    sim.step(np.full((1, 1), sim.config.speed_levels.index(0.0) * len(sim.config.lateral_offsets)))
    assert (len(sim.arrivals) == 1) == arrives


def test_in_passing_a_robot_arrives_at_speed_and_else_it_stands_at_the_end_of_its_route() -> None:
    off, speed = drive(simulator())
    assert 0.3 < off <= 0.5
    assert speed > 1.0
    off, speed = drive(simulator(arrival="stop"))
    assert off < 0.1
    assert speed <= STILL


@given(st.floats(0.0, 5.0), st.floats(0.0, 1.5), st.floats(0.3, 3.0))
def test_a_robot_that_brakes_before_an_end_stops_there_and_never_beyond(way: float, speed: float, brake: float) -> None:
    p = every_kind(EnvConfig(), 1.0)
    p["max_acceleration"] = brake
    most = brake * 0.1
    nothing = np.float32(0.0)
    speed = min(speed, float(speed_before(np.float32(way), nothing, nothing, p[0])))  # from which it can stop
    for _ in range(400):
        wanted = nothing if way <= RESTS else speed_before(np.float32(way), nothing, np.float32(speed), p[0])
        after = float(approach(np.float32(speed), wanted, most))
        way, speed = way - 0.05 * (speed + after), after
        assert way > -0.005
    assert speed == 0.0
    assert way <= RESTS + 1e-6


def test_the_observation_tells_the_goal_where_robots_stop_and_is_the_same_before_it() -> None:
    passing = EnvConfig(traffic=TrafficSpec(shield=True))
    one, two = observation_layout(passing), observation_layout(passing.replace(arrival="stop"))
    assert two.size == one.size + GOAL
    assert {name: two.slices[name] for name in one.slices} == one.slices
    sim = simulator(arrival="stop")
    np.testing.assert_allclose(sim.observation[0, 0, -GOAL:], [7.0 / 5.0, 0.0, 0.0, 0.0, 0.0], atol=1e-6)
    braked = False
    while not braked:
        sim.step(np.full((1, 1), sim.cruise_action))
        braked = bool(sim.observation[0, 0, -1])
    r = sim.robots[0, 0]
    assert float(r["task"]["goal_x"] - r["motion"]["x"]) == pytest.approx(
        float(r["motion"]["speed"]) ** 2 / 1.8, abs=0.25
    )


ROBOT = EnvConfig().robot
WALL = drawn(["......", ".####.", "......", "......"])
Pose = tuple[float, float, float]


def shot(grid: GridMap, start: Pose, goal: Pose) -> NDArray[np.float32] | None:
    asked, arcs = query(start, np.array([(*goal, 0.0)], np.float32), around(grid), exact=True), SCRATCH.shot
    count, _ = shoot(
        asked.pose, asked.steer, asked.near, np.float32(0.03), np.float32(np.inf), asked.around, arcs
    )  # fmt: skip
    return arcs[:count].copy() if count >= 0 else None


def ends_at(poses: NDArray[np.float64], goal: Pose) -> None:
    x, y, heading = poses[-1]
    assert math.hypot(x - goal[0], y - goal[1]) < 0.01
    assert abs(math.remainder(heading - goal[2], 2 * math.pi)) < 0.005


places = st.tuples(st.floats(3.0, 9.0), st.floats(3.0, 9.0), st.floats(-3.1, 3.1))


@given(places, places)
@settings(max_examples=200)
def test_on_open_floor_a_shot_leads_from_any_pose_to_any(start: Pose, goal: Pose) -> None:
    arcs = shot(room(12, 12), start, goal)
    assert arcs is not None
    ends_at(driven(start, arcs), goal)
    assert (np.abs(arcs[:, 1]) < ROBOT.max_steering).all()


def test_straight_ahead_is_one_arc_and_behind_a_wall_is_none() -> None:
    arcs = shot(WALL, (1.0, 0.9, 0.0), (4.0, 0.9, 0.0))
    assert arcs is not None
    np.testing.assert_allclose(arcs, [[3.0, 0.0]], atol=1e-4)
    assert shot(WALL, (3.0, 1.2, 0.0), (3.0, 3.5, 0.0)) is None


HARD: dict[str, tuple[Pose, Pose]] = {
    "ahead": ((1.5, 0.8, 0.0), (4.5, 0.8, 0.0)),
    "the other way round": ((1.5, 0.8, 0.0), (4.5, 0.8, math.pi)),
    "beside": ((3.0, 0.8, 0.0), (3.0, 1.3, 0.0)),
    "behind": ((4.5, 1.0, 0.0), (2.0, 1.0, 0.0)),
    "beyond the wall, facing back": ((2.5, 1.2, 0.0), (3.2, 3.5, math.pi)),
    "in the same cell, turned": ((2.6, 1.2, 0.0), (2.4, 1.3, 1.2)),
}


def arrive(start: Pose, goal: Pose, backs: int = 0, **changes: object) -> tuple[Simulator, float]:
    """Drive from one pose to another at full speed; return the simulator and the seconds that it took.

    backs: of ten steps, how many ask for backing instead.
    """
    config = EnvConfig(num_agents=1, planner="astar", arrival="pose", tasks="one_shot").replace(**changes)
    sim = Simulator(config, grid=WALL)
    sim.reset(1, [Assignment([start], [goal])])
    for step in range(900):
        sim.step(np.full((1, 1), 0 if step % 10 < backs else sim.cruise_action))
        if sim.arrivals:
            return sim, sim.seconds(0)
    raise AssertionError(f"not there: {sim.state.pose[0, 0]}")


@pytest.mark.parametrize(("radius", "degrees"), [(0.05, 5.0), (0.01, 1.0)])
@pytest.mark.parametrize("case", HARD)
def test_a_robot_stands_at_the_pose_when_it_has_arrived(case: str, radius: float, degrees: float) -> None:
    start, goal = HARD[case]
    sim, seconds = arrive(start, goal, pose_radius=radius, pose_angle=math.radians(degrees))
    x, y, heading = sim.state.pose[0, 0].tolist()
    assert math.hypot(x - goal[0], y - goal[1]) <= radius
    assert abs(math.remainder(heading - goal[2], 2 * math.pi)) <= math.radians(degrees)
    assert abs(float(sim.state.speed[0, 0])) <= 0.01
    assert seconds < 40.0
    assert sim.robots["totals"]["hits_shelf"].sum() == 0


@pytest.mark.parametrize("case", ["beside", "behind", "in the same cell, turned"])
def test_a_robot_goes_on_docking_though_its_policy_backs_now_and_then(case: str) -> None:
    sim, seconds = arrive(*HARD[case], backs=4)
    assert seconds < 60.0
    assert sim.robots["totals"]["hits_shelf"].sum() == 0


@pytest.mark.parametrize("heading", [(), (0.0,), (math.pi,)])
@pytest.mark.parametrize("robot", [RobotSpec(), RobotSpec(length=1.4, width=0.8, wheelbase=0.9, front_overhang=0.25)])
def test_goals_behind_a_robot_are_reached_at_any_distance(robot: RobotSpec, heading: tuple[float, ...]) -> None:
    """With any heading, robots stood 6 cm off for good at 15 of these 123 distances, and at 18 of 144 beside them."""
    far = [(6.0 - 0.01 * k, 6.0) for k in range(6, 129)]
    aside = [(6.0 - d * math.cos(a), 6.0 + d * math.sin(a)) for d in np.arange(0.1, 1.6, 0.1) for a in (-0.17, 0.08)]
    config = EnvConfig(num_agents=1, planner="astar", arrival="pose", tasks="one_shot", robot=robot)
    sim = Simulator(config, len(far + aside), grid=room(12, 12))
    sim.reset(1, [Assignment([(6.0, 6.0, 0.0)], [(*goal, *heading)]) for goal in far + aside])
    for _ in range(300):
        sim.step(np.full((sim.num_worlds, 1), sim.cruise_action))
    late = [goal for goal, alive in zip(far + aside, sim.state.alive[:, 0], strict=True) if alive]
    assert not late


@pytest.mark.parametrize("told", [(0, 1), (0, 8)])
def test_where_a_robot_cannot_turn_round_it_stands_at_a_face_the_way_it_faces(told: tuple[int, int]) -> None:
    """Backwards along an aisle of one cell: the body has its middle in the goal's cell, so its axle is .3 m ahead."""
    sim = Simulator(EnvConfig(num_agents=1, planner="astar", arrival="pose", tasks="one_shot"), grid=drawn(["." * 10]))
    sim.reset(1, [Assignment([(5.0, 0.5, 0.0)], [told])])
    for _ in range(400):
        sim.step(np.full((1, 1), sim.cruise_action))
        if sim.arrivals:
            break
    x, y, heading = sim.state.pose[0, 0].tolist()
    assert (x, y) == pytest.approx((told[1] + 0.8, 0.5), abs=0.05)
    assert heading == pytest.approx(0.0, abs=0.01)
    assert sim.robots["task"]["goal_heading"][0, 0] == pytest.approx(0.0, abs=1e-6)


def test_lifelong_robots_stand_beside_the_shelves_that_they_are_sent_to() -> None:
    config = EnvConfig(num_agents=4, planner="astar", arrival="pose", layout="narrow", max_steps=10**6)
    sim = Simulator(config)
    sim.reset(seed=31_000_000)
    goals = 0
    for _ in range(1200):
        before = sim.robots[0]["task"][["goal_x", "goal_y", "goal_heading"]].copy()
        sim.step(np.full((1, 4), sim.cruise_action))
        for _, robot, *_ in sim.arrivals:
            goals += 1
            x, y, heading = sim.state.pose[0, robot].tolist()
            goal_x, goal_y, goal_heading = before[robot].tolist()
            assert math.hypot(x - goal_x, y - goal_y) <= 0.05
            if not math.isnan(goal_heading):
                assert abs(math.remainder(heading - goal_heading, 2 * math.pi)) <= math.radians(5.0)
                assert abs(math.sin(2 * goal_heading)) < 1e-5  # along the grid
    assert goals > 8


def bits_of_docking() -> str:
    """A digest of all that a robot does which docks."""
    config = EnvConfig(num_agents=1, planner="astar", arrival="pose", tasks="one_shot")
    sim, digest = Simulator(config, grid=room(8, 8)), hashlib.blake2b()
    sim.reset(1, [Assignment([(2.5, 4.5, 0.3)], [(4.2, 3.1, 2.0)])])
    for _ in range(30):
        sim.step(np.full((1, 1), sim.cruise_action))
        digest.update(sim.robots.tobytes() + sim.observation.tobytes())
    assert sim.robots["manoeuvre"]["docks"].all()
    return digest.hexdigest()


@pytest.mark.nightly
def test_docking_is_the_same_in_plain_python() -> None:
    program = "from tests.simulation.driver.test_docking import bits_of_docking; print(bits_of_docking())"
    assert plain_python(program) == [bits_of_docking()]
