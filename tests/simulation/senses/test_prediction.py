"""The share of the next seconds that each command is free of conflicts, against robots that really drive."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.simulation.reference import OFFSET, Points, bodies, rectangle, separation
from tests.simulation.worlds import drawn, lay, room, stage, write
from warehouse_env.config import SensorSpec
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.senses import on_routes
from warehouse_env.simulation.simulator import Simulator

SPEEDS, SIDES = (-0.4, 0.0, 0.5, 1.3), (0.0, 0.6, -0.6, 1.2, -1.2)  # the commands
BACK, STAND, SLOWLY, FAST = range(4)
TIMES = 0.2 * np.arange(1, 13)  # [s] looked at


ROOM = room(40, 40)


def scene(own: tuple[float, ...], *others: tuple[float, ...], grid: GridMap = ROOM, y: float = 20.0) -> Simulator:
    """The own robot with a route due east along y from x = 10, then north; others anywhere."""
    options: dict[str, Any] = {"speed_levels": SPEEDS, "sensor": SensorSpec(predictions=True)}
    simulator = stage(grid, own, *others, action_type="discrete", **options)
    lay(simulator, (10.0, y), (17.0, y), (17.0, 30.0))
    write(simulator.robots[0, 0], position=own[0] - 10.0, lateral=own[1] - y, bearing=-own[2])
    simulator._observe()
    return simulator


def predictions(simulator: Simulator) -> NDArray[np.float64]:
    """[speed level, lateral offset], shares of 2.4 s."""
    return simulator.observation[0, 0, simulator.layout.slices["predictions"]].astype(np.float64).reshape(4, 5)


def drive(simulator: Simulator, command: int) -> Points:
    """The own body [12, 4, 2] at TIMES under a command, while the others stand; restarts where it began."""
    simulator, poses = copy.deepcopy(simulator), []
    actions = np.full((1, simulator.num_agents), STAND * len(SIDES))
    actions[0, 0] = command
    for _ in TIMES:
        for _ in range(2):
            simulator.step(actions)
        poses.append(simulator.robots[0, 0]["motion"][["x", "y", "heading"]].tolist())
    return bodies(*np.array(poses, np.float64).T)


def grown(body: Points, margin: float) -> Points:
    """A rectangle with a margin around it."""
    ahead, left = body[0] - body[1], body[0] - body[3]
    ahead, left = ahead / np.linalg.norm(ahead), left / np.linalg.norm(left)
    return body + margin * np.array([ahead + left, left - ahead, -ahead - left, ahead - left])


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_predictions_agree_with_what_commands_do_beside_robots_that_stand(seed: int) -> None:
    rng = np.random.default_rng(seed)
    own = (12.0 + rng.uniform(0, 4), 20 + rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), rng.choice([0.0, 0.7, 1.3]))
    others = [(own[0] + x, own[1] + y, rng.uniform(-3, 3)) for x, y in ((3.2, rng.uniform(-1, 1)), (-2, -1), (1, 2.2))]
    simulator = scene(own, *others)
    got, there = predictions(simulator), bodies(*np.array(others).T)
    for speed in range(len(SPEEDS)):
        apart = [
            float(separation(grown(body, 0.03 + 0.05 * t), there).min())
            for body, t in zip(drive(simulator, speed * len(SIDES)), TIMES.tolist(), strict=True)
        ]
        slack = 0.04 + 0.09 * TIMES
        surely = next((k for k in range(12) if apart[k] < -slack[k]), 12)
        perhaps = next((k for k in range(12) if apart[k] < slack[k]), 12)
        assert perhaps / 12 - 1e-6 <= got[speed, 0] <= surely / 12 + 1e-6


def test_an_offset_leads_past_a_robot_on_the_route_but_not_where_there_is_no_room() -> None:
    ahead = (15.0, 20.0, 0.0)
    got = predictions(scene((12.0, 20.0, 0.0), ahead))
    assert got[FAST, 0] < 1
    assert got[FAST, 3] == got[FAST, 4] == 1
    aisle = drawn(["#" * 40] * 19 + ["." * 40] + ["#" * 40] * 20)  # y from 20 to 21
    got = predictions(scene((12.0, 20.5, 0.0), (15.0, 20.5, 0.0), grid=aisle, y=20.5))
    assert (got[FAST] == got[FAST, 0]).all()
    assert got[FAST, 0] < 1


def plan(simulator: Simulator, robot: int, which: str = "plans") -> Points:
    """Where others think that a robot's body [12, 4, 2] will be, if it goes on, or in its "stops"."""
    plans = getattr(simulator._scratch.step.sights, which)[robot].astype(np.float64)
    return np.array([rectangle(x, y, math.atan2(s, c), 0.45, 0.3) for x, y, c, s in plans])


def test_a_neighbour_is_expected_along_its_route() -> None:
    """It drives round the bend, where its nose comes near the other."""
    own, other = (16.0, 20.0, 0.0, 0.5), (17.3, 20.6, math.pi / 2)
    drives, simulator = drive(scene(own), SLOWLY * len(SIDES)), scene(own, other)
    np.testing.assert_allclose(plan(simulator, 0), drives, atol=0.15)
    seen = simulator.observation[0, 1, simulator.layout.slices["predictions"]].reshape(4, 5)
    meets = next(k for k in range(12) if separation(drives[k], bodies(*other)) < 0.03 + 0.05 * TIMES[k])
    assert abs(seen[STAND, 0] * 12 - meets) <= 1


@pytest.mark.parametrize("side", range(len(SIDES)))
def test_a_neighbour_is_expected_at_the_lateral_offset_that_it_wants(side: int) -> None:
    simulator = scene((12.0, 20.0, 0.0, 0.5), (30.0, 30.0, 0.0))
    write(simulator.robots[0, 0], wanted_speed=SPEEDS[SLOWLY], wanted_offset=SIDES[side])
    simulator._observe()
    np.testing.assert_allclose(plan(simulator, 0), drive(simulator, SLOWLY * len(SIDES) + side), atol=0.1)


def test_a_neighbour_without_a_route_stops_unless_it_backs() -> None:
    simulator = scene((12.0, 20.0, 0.0), (14.0, 22.0, 2.0, 1.0), (30.0, 30.0, 1.0, -0.4))
    stopped = bodies(14.0 + 0.5 * math.cos(2.0), 22.0 + 0.5 * math.sin(2.0), 2.0)
    np.testing.assert_allclose(plan(simulator, 1)[6:], np.broadcast_to(stopped, (6, 4, 2)), atol=1e-3)
    way = -0.4 * TIMES
    backs = bodies(30.0 + way * math.cos(1.0), 30.0 + way * math.sin(1.0), np.full(12, 1.0))
    np.testing.assert_allclose(plan(simulator, 2), backs, atol=1e-3)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_a_robot_that_brakes_stands_where_others_expect(seed: int) -> None:
    """It holds its steering, whatever lateral offset the command names."""
    rng = np.random.default_rng(seed)
    own = (14.0, 20 + rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), rng.uniform(0.1, 1.5))
    simulator = scene(own, (30.0, 30.0, 0.0))
    write(simulator.robots[0, 0], steer=rng.uniform(-1, 1), wanted_speed=1.3)
    simulator._observe()
    expected = plan(simulator, 0, "stops")
    drives = drive(simulator, STAND * len(SIDES) + int(rng.integers(len(SIDES))))
    np.testing.assert_allclose(expected, drives, atol=5e-3)


@pytest.mark.parametrize("speed", [-0.5, -0.3, -0.1, 0.2, 0.5, 1.0, 1.4])
@pytest.mark.parametrize("steer", [-0.6, -0.3, 0.0, 0.4])
def test_a_robot_that_brakes_in_a_manoeuvre_stands_where_others_expect(speed: float, steer: float) -> None:
    simulator = reverses(scene((14.0, 20.0, 0.0, speed), (30.0, 30.0, 0.0)))
    write(simulator.robots[0, 0], steer=steer, wanted_speed=1.3)
    simulator._observe()
    np.testing.assert_allclose(plan(simulator, 0, "stops"), drive(simulator, STAND * len(SIDES)), atol=5e-3)


def test_a_command_conflicts_if_the_robot_could_not_stop_before_another_that_brakes_now() -> None:
    """The other passes in time if it goes on, but would come to rest in the way."""
    simulator = scene((12.0, 20.0, 0.0, 1.3), (13.5, 20.17, math.pi / 2, 1.3))
    lay(simulator, (13.5, 17.0), (13.5, 25.0), robot=1)
    write(simulator.robots[0, 1], position=3.17, wanted_speed=1.3)
    simulator._observe()
    goes, passes = plan(simulator, 0), plan(simulator, 1)
    assert all(separation(goes[k], passes[k][None]) > 0.03 + 0.05 * TIMES[k] for k in range(12))
    got = predictions(simulator)
    assert got[FAST, 0] < 1
    assert got[STAND, 0] == 1


def reverses(simulator: Simulator) -> Simulator:
    """The own robot in a manoeuvre that leads back to the right, then on."""
    simulator.arcs[0, 0, :2] = (-1.2, -0.6), (1.0, 0.3)
    r = simulator.robots[0, 0]
    write(r, arcs=2, arc=0, arc_x=r["motion"]["x"], arc_y=r["motion"]["y"], arc_heading=r["motion"]["heading"])
    write(r, arc_left=-1.2, arc_margin=0.01, arc_planned=0.01)
    simulator._observe()
    return simulator


def test_a_command_forwards_follows_the_manoeuvre_even_backwards() -> None:
    own, behind = (12.0, 20.0, 0.0), (10.4, 20.0 + OFFSET, math.pi / 2)
    straight, back = scene(own, behind), reverses(scene(own, behind))
    assert (predictions(straight)[FAST] == 1).all()
    share = predictions(back)[FAST]
    assert (share == share[0]).all()  # whatever the offset
    assert 0 < share[0] < 1
    body = drive(reverses(scene(own)), FAST * len(SIDES))
    reached = next(k for k in range(12) if separation(body[k], bodies(*behind)) < 0.03 + 0.05 * TIMES[k])
    assert abs(share[0] * 12 - reached) <= 2  # it steers first


@pytest.mark.parametrize("turn", [-40.0, -1.5, -1.3, 0.0, 0.4, 1.39, 1.41, 300.0])
def test_a_robot_may_turn_by_any_angle(turn: float) -> None:
    """One that steers by almost a right angle turns on the spot several times within a step."""
    c, s = math.cos(0.3), math.sin(0.3)
    got = on_routes.turned(np.float32(c), np.float32(s), np.float32(turn))
    expected = [wave(0.3 + share * turn) for share in (0.5, 1.0) for wave in (math.cos, math.sin)]
    np.testing.assert_allclose(got, expected, atol=1e-4)


def beside(gap: float) -> NDArray[np.float64]:
    """What a robot sees whose front is `gap` [m] before another's side."""
    return predictions(scene((12.0, 20.0, 0.0), (12.15 + gap + 0.3, 20.0 + OFFSET, math.pi / 2)))


@pytest.mark.parametrize("gap", [0.0, 0.02, 0.2])
def test_a_near_robot_bars_the_commands_that_lead_nearer(gap: float) -> None:
    got = beside(gap)
    assert (got[[BACK, STAND]] == 1).all()
    assert (got[[SLOWLY, FAST], 0] < 0.5).all()


def test_a_command_that_starts_a_search_is_free() -> None:
    other = (11.0, 20.5, 0.0)
    simulator = scene((12.0, 20.0, math.pi), other)  # faces away from its route
    assert (predictions(simulator)[FAST] == 1).all()
    simulator = reverses(scene((12.0, 20.0, 0.0), (10.7, 20.0 + OFFSET, math.pi / 2)))
    assert (predictions(simulator)[FAST] < 1).all()
    write(simulator.robots[0, 0], waiting_time=3.0)  # so it would search around others
    simulator._observe()
    assert (predictions(simulator)[FAST] == 1).all()
    write(simulator.robots[0, 0], search_wait=1.0)  # but not yet
    simulator._observe()
    assert (predictions(simulator)[FAST] < 1).all()


def test_a_neighbour_that_has_been_told_to_drive_is_expected_to() -> None:
    own = (12.0, 20.0, 0.0)
    simulator = scene(own)
    stands = plan(simulator, 0)
    write(simulator.robots[0, 0], wanted_speed=1.3)
    simulator._observe()
    np.testing.assert_allclose(stands, np.broadcast_to(bodies(*own), stands.shape), atol=1e-3)
    np.testing.assert_allclose(plan(simulator, 0), drive(scene(own), FAST * len(SIDES)), atol=0.1)


def test_a_manoeuvre_is_foreseen_to_its_end_and_on_along_the_route() -> None:
    simulator = reverses(scene((12.0, 20.0, 0.0)))
    simulator.arcs[0, 0, :2] = (-0.4, -0.6), (0.3, 0.0)
    write(simulator.robots[0, 0], arc_left=-0.4, wanted_speed=1.3)
    simulator._observe()
    drives = drive(simulator, FAST * len(SIDES))
    np.testing.assert_allclose(plan(simulator, 0), drives, atol=0.25)
    assert drives[:, :, 0].max() > drives[0, :, 0].max() + 0.1  # it has turned back


def test_a_manoeuvre_is_expected_to_go_on_where_a_shelf_keeps_the_follower_from_its_route() -> None:
    aisle = drawn(["#" * 40] * 19 + ["." * 40] + ["#" * 40] * 20)  # y from 20 to 21
    simulator = scene((12.0, 20.66, 0.0, 0.5), grid=aisle, y=20.9)
    simulator.arcs[0, 0, :1] = (3.0, 0.0)
    r = simulator.robots[0, 0]
    write(r, arcs=1, arc=0, arc_x=12.0, arc_y=20.66, arc_heading=0.0, arc_left=3.0, wanted_speed=1.3)
    write(r, arc_margin=0.01, arc_planned=0.01)
    simulator._observe()
    drives = drive(simulator, FAST * len(SIDES))
    assert abs(drives[-1, :, 1].mean() - 20.66) < 0.02
    np.testing.assert_allclose(plan(simulator, 0), drives, atol=0.05)


def test_a_robot_is_expected_to_stop_where_the_follower_stops_before_a_shelf() -> None:
    aisle = drawn(["#" * 40] * 19 + ["." * 40] + ["#" * 40] * 20)  # y from 20 to 21
    own = (12.0, 20.6, 0.35, 1.0)
    simulator = scene(own, (13.9, 20.5, 0.0), grid=aisle, y=20.5)
    assert (predictions(simulator)[FAST] == 1).all()
    assert plan(simulator, 0)[..., 0].max() < 13
    assert drive(simulator, FAST * len(SIDES))[..., 0].max() < 13


@pytest.mark.parametrize("gap", [0.002, 0.012])
def test_no_part_of_a_very_small_gap_may_be_lost(gap: float) -> None:
    simulator = scene((12.0, 20.0, 0.0), (12.0, 20.6 + gap, 0.0))
    assert 0 <= simulator._scratch.step.sights.gaps[0] <= gap


@pytest.mark.parametrize(("gap", "free"), [(0.3, True), (0.1, False)])
def test_commands_must_keep_a_gap_that_grows_with_time(gap: float, free: bool) -> None:
    passed = (13.5, 20.6 + gap, 0.0)  # beside the route; gaps reach .15 m
    got = predictions(scene((12.0, 20.0, 0.0, 1.3), passed))
    assert (got[FAST, 0] == 1) == free
