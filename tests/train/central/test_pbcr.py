"""Motion primitives against the simulator, their checks by hand, and no contact when they are driven."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from numpy.typing import NDArray

from train.central import CENTRAL, central_config
from train.central.pbcr import PERIOD, SPEEDS, STEERINGS
from train.central.primitives import DT, MARGIN, POSES, Given, decide_all, drive, meet, meets_shelf
from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.physics.floor import Floor, floor_of
from warehouse_env.simulation.simulator import Simulator

LIMITS, BODY = np.array([1.0, 1.5, 0.6, 0.3]), np.array([0.45, 0.3])
COMMANDS = np.array([(speed, steer) for speed in SPEEDS for steer in STEERINGS])
Floats = NDArray[np.float64]


def motion_of(x: float, y: float, heading: float, speed: float = 0.0, goal_speed: float = 0.0) -> Floats:
    """Return the motion that goes for `goal_speed` straight ahead for 0.2 s, and then stops."""
    motion = np.empty((POSES, 4))
    drive(np.array([x, y, heading]), speed, 0.0, goal_speed, 0.0, round(0.2 / DT), LIMITS, motion)
    return motion


def room(rows: int, columns: int) -> Floor:
    """Return an empty floor with a rim of shelves."""
    return floor_of(GridMap(np.zeros((rows, columns), np.bool_)))


def chosen(poses: Floats, speeds: Floats, floor: Floor, keys: Floats) -> NDArray[np.int64]:
    """Return the primitives that robots with straight wheels choose, the first of them first."""
    straight, order, period = np.zeros(len(poses)), np.arange(len(poses)), round(PERIOD / DT)
    choice: NDArray[np.int64] = decide_all(
        Given(poses, speeds, straight, COMMANDS, keys, floor, BODY, LIMITS, period), order
    )
    return choice


def test_a_motion_is_what_the_simulator_drives() -> None:
    """A second of each command, and the stop after it, whose last command is a weaker one."""
    config = EnvConfig(layout="open", num_agents=1, planner="astar", action_type="raw", action_repeat=2)
    assert pytest.approx(config.time_step / config.substeps) == DT  # it looks for contacts then
    simulator, motion = Simulator(config), np.empty((POSES, 4))
    simulator.reset(1)
    for goal_speed, goal_steer in ((0.93, 0.3), (1.3, -0.9), (-0.37, 0.9)):
        state = simulator.state
        speed, steer = float(state.speed[0, 0]), float(state.steer[0, 0])
        drive(state.pose[0, 0].astype(float), speed, steer, goal_speed, goal_steer, round(1.0 / DT), LIMITS, motion)
        change, turn = np.clip([goal_speed - speed, goal_steer - steer], -LIMITS[:2], LIMITS[:2])
        for seconds in np.arange(0.2, 2.5, 0.2):
            stop = np.clip(-float(simulator.state.speed[0, 0]) / 0.2, -1.0, 1.0)
            simulator.step(np.array([[[change, turn / 1.5] if seconds < 1.1 else [stop, 0.0]]], np.float32))
            x, y, heading = simulator.state.pose[0, 0].astype(float)
            expected = [x - 0.3 * np.cos(heading), y - 0.3 * np.sin(heading), np.cos(heading), np.sin(heading)]
            assert motion[round(seconds / DT) - 1] == pytest.approx(expected, abs=1e-4)
        assert simulator.state.speed[0, 0] == pytest.approx(0.0, abs=1e-6)
    assert simulator.events.touching[0, 0] == 0


def test_a_motion_ends_where_full_braking_ends() -> None:
    """1.2 m/s kept for 0.2 s, then braking at 1 m/s^2: 0.24 + 0.72 m."""
    motion = motion_of(0.0, 0.0, 0.0, 1.2, 1.2)
    assert motion[-1, 0] == pytest.approx(-0.3 + 0.24 + 0.72)


def test_bodies_meet_within_the_margin() -> None:
    standing = motion_of(0.0, 0.0, 0.0)
    assert not meet(standing, motion_of(0.93, 0.0, 0.0), 0.45, 0.3, MARGIN)  # 3 cm bumper to bumper
    assert meet(standing, motion_of(0.91, 0.0, 0.0), 0.45, 0.3, MARGIN)
    assert not meet(standing, motion_of(0.0, 0.63, 0.0), 0.45, 0.3, MARGIN)
    assert meet(standing, motion_of(0.0, 0.61, 0.0), 0.45, 0.3, MARGIN)
    assert meet(motion_of(-1.5, 0.0, 0.0, 1.2, 1.2), standing, 0.45, 0.3, MARGIN)  # stops 0.96 m further on
    assert not meet(motion_of(-2.0, 0.0, 0.0, 1.2, 1.2), standing, 0.45, 0.3, MARGIN)


def test_bodies_meet_shelves_within_the_margin() -> None:
    floor = room(3, 5)
    assert not meets_shelf(motion_of(2.0, 1.5, 0.0), 0.45, 0.3, MARGIN, floor)
    assert meets_shelf(motion_of(2.0, 0.31, 0.0), 0.45, 0.3, MARGIN, floor)  # 1 cm beside the rim
    assert not meets_shelf(motion_of(2.0, 0.33, 0.0), 0.45, 0.3, MARGIN, floor)
    # its nose comes to 4.15 + 0.96 of 5 m
    assert meets_shelf(motion_of(4.0, 1.5, 0.0, 1.2, 1.2), 0.45, 0.3, MARGIN, floor)


def test_who_stands_beside_the_rim_may_drive_along_it() -> None:
    """It stands 1 cm from it, nearer than MARGIN; its favourite leads straight ahead."""
    straight = 2
    assert COMMANDS[straight].tolist() == [1.3, 0.0]
    keys = np.abs(np.arange(len(COMMANDS)) - straight)[None].astype(float)
    pose = np.array([[2.0, 0.31, 0.0]])
    assert chosen(pose, np.zeros(1), room(3, 8), keys) == [straight]
    assert chosen(pose, np.zeros(1), room(3, 3), keys) != [straight]  # its nose would come to 3.15 m


def test_nobody_counts_on_a_place_that_is_not_left() -> None:
    """The first asks both others to make room: one drives off through its place, one cannot, so it stops after all."""
    poses = np.array([[4.4, 1.8, 1.6], [3.7, 2.1, -1.7], [4.2, 3.0, -1.7]])
    speeds, motions = np.array([0.4, 0.3, 0.3]), np.empty((3, POSES, 4))
    choice = chosen(poses, speeds, room(5, 5), np.tile(np.arange(len(COMMANDS), dtype=float), (3, 1)))
    assert choice[0] == choice[2] == -1
    for i in range(3):
        goal, period = ((0.0, 0.0), 0) if choice[i] < 0 else (COMMANDS[choice[i]], round(PERIOD / DT))
        drive(poses[i], speeds[i], 0.0, *goal, period, LIMITS, motions[i])
    assert not any(meet(one, two, *BODY, 0.0) for one, two in combinations(motions, 2))


def test_many_robots_drive_without_a_contact() -> None:
    config = central_config("central_pbcr", EnvConfig(layout="open", num_agents=12, planner="astar"))
    simulator, planner = Simulator(config), CENTRAL["central_pbcr"].make(config)
    simulator.reset(2)
    for _ in range(200):
        simulator.step(planner.act_on(simulator, [np.random.default_rng(0)]))
    row = simulator.episode_metrics(0)
    assert row["goals"] > 0
    assert row["collisions_robot"] == row["collisions_shelf"] == 0


def test_robots_of_a_full_floor_do_not_rock_in_their_places() -> None:
    config = central_config("central_pbcr", EnvConfig(layout="paper46", num_agents=32, planner="astar"))
    simulator, planner = Simulator(config), CENTRAL["central_pbcr"].make(config)
    simulator.reset(500)
    for _ in range(300):
        simulator.step(planner.act_on(simulator, [np.random.default_rng(0)]))
    assert (simulator.robots["clocks"]["standing_time"] > 10.0).sum() <= 12  # within a metre of one place
