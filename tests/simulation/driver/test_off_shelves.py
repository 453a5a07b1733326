"""What the follower asks before it drives on: where that is exact, nothing touches a shelf, and nobody stays wedged."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.simulation.reference import REAR, WHEELBASE, WIDTH, bodies, separation, shelves
from tests.simulation.worlds import drawn, put, raw, stage
from warehouse_env.config import EnvConfig
from warehouse_env.maps.layouts import make_layout
from warehouse_env.simulation.driver.off_shelves import may_drive
from warehouse_env.simulation.physics.kinematics import approach, braking
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment

AISLE = drawn(["#" * 12, "." * 12, "#" * 12])  # of one cell, from y = 1 to y = 2


def drive_and_stop(simulator: Simulator, speed: float, steer: float) -> int:
    """Take a physics step towards a command, then brake fully; return how often a shelf was hit."""
    r, p = simulator.robots[0, 0], simulator._params[0]
    dt = p["time_step"]
    to_speed = approach(r["motion"]["speed"], np.float32(speed), p["max_acceleration"] * dt)
    to_steer = approach(r["motion"]["steer"], np.float32(steer), p["max_steer_rate"] * dt)
    simulator.step(
        raw(simulator, (float(to_speed - r["motion"]["speed"]) / dt, float(to_steer - r["motion"]["steer"]) / dt))
    )
    while abs(r["motion"]["speed"]) > 1e-6:
        simulator.step(raw(simulator, (float(braking(r["motion"]["speed"], p)), 0.0)))
    return int(r["totals"]["hits_shelf"])


def test_what_may_be_driven_touches_no_shelf_and_little_else_is_refused() -> None:
    rng = np.random.default_rng(0)
    counts = np.zeros((2, 2), int)  # [may it be driven, does it touch]
    coarse = 0
    for _ in range(300):
        heading = rng.uniform(-0.25, 0.25)
        simulator = stage(AISLE, (6.0, 1.5, heading, rng.uniform(0.0, 0.5), rng.uniform(-1.0, 1.0)))
        robot = simulator.config.robot
        half = robot.length / 2 * abs(math.sin(heading)) + robot.width / 2 * math.cos(heading)
        back = robot.rear_reach - robot.length / 2
        simulator.robots["motion"]["y"] = (
            2.0 - half + back * math.sin(heading) - rng.uniform(1e-5, 1e-3)
        )  # a corner at the shelf
        speed, steer = rng.uniform(-0.5, 0.5), rng.uniform(-1.0, 1.0)
        around = simulator._floor
        r, p = simulator.robots[0, 0], simulator._params[0]
        may = may_drive(r, np.float32(speed), np.float32(steer), np.float32(1.7e-4), p, around)
        loose = may_drive(r, np.float32(speed), np.float32(steer), np.float32(0.03), p, around)
        touches = drive_and_stop(simulator, speed, steer) > 0
        counts[int(may), int(touches)] += 1
        coarse += loose and not may
    assert counts[1, 1] == 0  # what may be driven touches nothing
    assert counts[1, 0] > 60
    assert counts[0, 1] > 60
    assert counts[0, 0] < 15  # refused although it touches nothing: within GRAZE
    assert coarse == 0  # a margin asks for more


@pytest.mark.parametrize(("overlap", "touches"), [(8e-3, True), (-1e-4, False)])
@pytest.mark.parametrize("substep", [0, 1])
def test_a_corner_that_is_passed_between_two_samples_is_not_driven(overlap: float, touches: bool, substep: int) -> None:
    """The right rear corner of a body that turns left swings past a shelf's corner half-way through a substep."""
    grid, corner = drawn([".....", "...#.", ".....", ".....", "....."]), np.array([3.0, 3.0])  # the shelf north-east
    speed, steer, dt = 0.3, -math.pi / 3, 0.05
    radius = WHEELBASE / math.tan(math.pi / 3)  # of the axle's turn
    far = math.hypot(REAR, WIDTH / 2 + radius)  # from the centre of the turn to the corner of the body
    centre = corner - (far - overlap) * math.sqrt(0.5)
    half_way = math.pi / 4 - math.atan2(-WIDTH / 2 - radius, -REAR)  # the heading where the corners meet
    headings = half_way + speed / radius * dt * (np.arange(12) - 0.5 - substep)
    x, y = (centre[:, None] + radius * np.stack([np.sin(headings), -np.cos(headings)])).tolist()
    simulator = stage(grid, (x[0], y[0], float(headings[0]), speed, steer))
    apart = separation(bodies(x, y, headings)[:, None], shelves(grid.occupied)[None]).min()
    assert apart > 5e-5  # at every sample
    r, p = simulator.robots[0, 0], simulator._params[0]
    may = may_drive(r, np.float32(speed), np.float32(steer), np.float32(1.7e-4), p, simulator._floor)
    assert may != touches
    assert drive_and_stop(simulator, speed, steer) == touches


@pytest.mark.parametrize(
    ("floor", "pose", "goal"),
    [
        (83, (28.339151, 15.833553, 2.0613728), (30, 4)),  # only arcs of less than .1 m are free there
        (67, (8.256474, 11.171541, -0.75123733), (40, 40)),  # a corner .1 mm off a shelf
        (4, (38.406998, 18.282705, -0.043283675), (4, 4)),
    ],
)
def test_who_stands_wedged_a_tenth_of_a_millimetre_off_a_shelf_gets_out(
    floor: int, pose: tuple[float, float, float], goal: tuple[int, int]
) -> None:
    grid = make_layout("aisles", seed=floor)
    free = np.argwhere(~grid.occupied)
    goal = tuple(free[np.abs(free - goal).sum(axis=1).argmin()].tolist())
    simulator = Simulator(EnvConfig(num_agents=1, planner="astar", action_repeat=2), grid=grid)
    simulator.reset_to([Assignment(np.array([pose]), np.array([goal]))], [1])
    put(simulator, 0, pose)
    cruise = np.full((1, 1), simulator.cruise_action)
    for _ in range(100):  # 20 s
        simulator.step(cruise)
    r = simulator.robots[0, 0]
    assert r["totals"]["hits_shelf"] == 0
    assert math.hypot(r["motion"]["x"] - pose[0], r["motion"]["y"] - pose[1]) > 2.0
