"""Where there is room: how far it is off others' paths, by hand; what the follower asks to keep off shelves."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.simulation.driver import test_manoeuvre
from tests.simulation.reference import REAR, WHEELBASE, WIDTH, bodies, separation, shelves
from tests.simulation.worlds import drawn, put, raw, room, stage
from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.simulation.driver.bodies import CENTRE_X, CENTRE_Y, COS, arc_is_free
from warehouse_env.simulation.driver.manoeuvre import ARCS, TOO_NEAR
from warehouse_env.simulation.driver.off_shelves import may_drive
from warehouse_env.simulation.driver.room_field import (
    BARRED,
    UNKNOWN,
    apart_of,
    room_at,
    write_room,
    write_way,
)
from warehouse_env.simulation.driver.scratch import BODY, POINTS
from warehouse_env.simulation.physics.geometry import pose_at
from warehouse_env.simulation.physics.kinematics import approach, braking
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment

MIDDLE = POINTS // 2
APART = np.float32(apart_of(test_manoeuvre.PARAMETERS[0]))
STEP = 0.2
ROUNDING = 1e-4
AISLE = drawn(["#" * 12, "." * 12, "#" * 12])  # of one cell, from y = 1 to y = 2
BENT = drawn(["#" * 12, "#......#####", "######.#####", "######.#####", "######.....#", "#" * 12])


def field(
    grid: GridMap,
    centre: tuple[float, float],
    avoid: NDArray[np.float32] = test_manoeuvre.NOBODY,
    bodies: NDArray[np.float32] = test_manoeuvre.NOBODY,
    parameters: NDArray[np.void] = test_manoeuvre.PARAMETERS,
) -> NDArray[np.float32]:
    """The field around a body that heads east and has its centre there."""
    x, y = np.float32(centre[0] + parameters[0]["offset"]), np.float32(centre[1])
    write_room(
        pose_at(x, y, np.float32(0.0)), test_manoeuvre.around(grid, avoid, bodies, parameters), test_manoeuvre.SCRATCH
    )
    return test_manoeuvre.SCRATCH.room.copy()


def centred(*poses: tuple[float, float, float]) -> NDArray[np.float32]:
    """Bodies of the default size with their centres there."""
    return np.array([test_manoeuvre.sized((x, y, math.cos(turn), math.sin(turn))) for x, y, turn in poses], np.float32)


def along(x: float, y: float, count: int) -> NDArray[np.float32]:
    """A path east, from there on."""
    return centred(*((x + 0.25 * k, y, 0.0) for k in range(count)))


def at(found: NDArray[np.float32], dx: float, dy: float) -> float:
    """How far it is from so many metres east and north of the middle."""
    return float(found[MIDDLE + round(dy / STEP), MIDDLE + round(dx / STEP)])


def test_beside_a_path_it_is_as_far_as_two_half_widths_and_what_is_kept_off() -> None:
    """0.3 + 0.3 + 0.2 m from the middle of it; the disc on a point is smaller by 0.14."""
    found = field(room(20, 20), (10.0, 10.0), along(0.5, 10.0, 80))
    assert at(found, 0, 0) == pytest.approx(0.8, abs=ROUNDING)
    assert at(found, 0, 0.6) == at(found, 0, -0.6) == pytest.approx(0.2, abs=ROUNDING)
    assert at(found, 3, 0.8) == 0.0


def test_in_an_aisle_it_is_as_far_as_its_mouth_round_the_corner() -> None:
    path = np.concatenate([along(1.5, 4.5, 21), centred(*((6.5, 4.5 - 0.25 * k, 1.57) for k in range(13)))])
    found = field(BENT, (2.5, 4.5), path)
    # 4 m east and 3 m south along the path, then 0.8 m off it to the east; the corners may be cut by a metre
    assert 7.8 - 2.0 < at(found, 0, 0) < 7.8
    assert at(found, 2, 0) == pytest.approx(at(found, 0, 0) - 2.0, abs=ROUNDING)
    assert at(found, 0, 1) == BARRED  # a shelf


def test_bodies_bar_the_way() -> None:
    path, west, east = along(4.0, 1.5, 20), (4.5, 1.5, 0.0), (8.5, 1.5, 0.0)
    free = field(AISLE, (6.0, 1.5), path)
    # the first body of the path reaches west to 3.55, and the disc is off from 0.5 m less 0.14 before that on
    assert at(free, 0, 0) == pytest.approx(6.0 - 3.0, abs=ROUNDING)
    barred = field(AISLE, (6.0, 1.5), path, centred(west))
    assert at(barred, 0, 0) == pytest.approx(9.6 - 6.0, abs=ROUNDING)  # out by the other end
    assert at(barred, -1.6, 0) == BARRED
    assert at(field(AISLE, (6.0, 1.5), path, centred(west, east)), 0, 0) == UNKNOWN


def test_beyond_the_rim_there_may_be_room() -> None:
    grid, rim = drawn(["#" * 40, "." * 40, "#" * 40]), MIDDLE * STEP
    found = field(grid, (20.0, 1.5), along(0.5, 1.5, 160))
    assert at(found, 0, 0) == pytest.approx(rim, abs=ROUNDING)
    assert at(found, 3, 0) == pytest.approx(rim - 3.0, abs=ROUNDING)
    x0, y0 = np.float32(20.0), np.float32(1.5)
    assert room_at(np.float32(20.0 + rim + 0.1), y0, x0, y0, found, APART) == 0.0
    assert room_at(np.float32(22.9), np.float32(1.45), x0, y0, found, APART) == pytest.approx(rim - 3.0, abs=ROUNDING)


@pytest.mark.parametrize("seed", range(4))
def test_no_manoeuvre_off_a_path_is_shorter(seed: int) -> None:
    """What the exact body drives is no shorter than the field says, but for 8%, and ends where that is 0."""
    rng, planned = np.random.default_rng(seed), 0
    for _ in range(25):
        shelves = rng.random((14, 14)) < 0.12
        shelves[5:9, 5:9] = False
        grid, heading = GridMap(shelves), rng.uniform(-math.pi, math.pi)
        pose = (*rng.uniform(6.2, 7.8, 2), heading)
        ways = np.arange(-2.0, 2.0, 0.25)[:, None] * [math.cos(heading), math.sin(heading), 0.0]
        avoid = test_manoeuvre.rectangles(*(np.array(pose) + ways))
        bodies = test_manoeuvre.rectangles(
            *((x, y, turn) for x, y, turn in rng.uniform((4, 4, -3), (10, 10, 3), (2, 3)))
        )
        bodies = bodies[np.hypot(bodies[:, CENTRE_X] - pose[0], bodies[:, CENTRE_Y] - pose[1]) > 1.5]
        arcs = test_manoeuvre.plan(grid, pose, avoid=avoid, bodies=bodies)
        if arcs is None or len(arcs) in (0, ARCS):
            continue
        planned += 1
        values = [np.float32(value) for value in pose]
        write_room(pose_at(*values), test_manoeuvre.around(grid, avoid, bodies), test_manoeuvre.SCRATCH)
        found = test_manoeuvre.SCRATCH.room
        centres = np.array([test_manoeuvre.body(each)[:2] for each in test_manoeuvre.driven(pose, arcs)], np.float32)
        says = np.array([room_at(x, y, *centres[0], found, APART) for x, y in centres])
        assert says[-1] == 0.0
        to_go = np.append(np.hypot(*np.diff(centres, axis=0).T)[::-1].cumsum()[::-1], 0.0)
        assert (says <= to_go / math.cos(math.pi / 8) + ROUNDING).all()
    assert planned > 10


def way_of(grid: GridMap, centre: tuple[float, float], avoid: NDArray[np.float32], most: int = 16) -> Any:
    way = np.zeros((most, BODY), np.float32)
    found = field(grid, centre, avoid)
    return way[: write_way(np.float32(centre[0]), np.float32(centre[1]), found, test_manoeuvre.PARAMETERS[0], way)]


def test_the_way_out_follows_a_bend() -> None:
    path = np.concatenate([along(1.5, 4.5, 21), centred(*((6.5, 4.5 - 0.25 * k, 1.57) for k in range(13)))])
    way = way_of(BENT, (2.5, 4.5), path)
    assert way[0, :2] == pytest.approx((2.9, 4.5), abs=STEP + ROUNDING)  # at once towards the inner side of the bend
    assert way[0, COS] > 0.7
    x, y = way[:, CENTRE_X], way[:, CENTRE_Y]
    assert ((y > 4.0) | ((x > 6.0) & (x < 7.0)) | (y < 2.0)).all()  # within the passage
    assert (np.hypot(np.diff(x), np.diff(y)) < 2 * math.sqrt(2) * STEP + ROUNDING).all()
    assert y[-1] < 2.4
    assert way_of(BENT, (2.5, 4.5), path, 3) == pytest.approx(way[:3])


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
        floor = simulator._floor
        r, p = simulator.robots[0, 0], simulator._params[0]
        may = may_drive(r, np.float32(speed), np.float32(steer), np.float32(1.7e-4), p, floor)
        loose = may_drive(r, np.float32(speed), np.float32(steer), np.float32(0.03), p, floor)
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


@given(st.floats(-1e-3, 1e-3), st.floats(0.1, 0.9), st.floats(0.6, math.pi / 3))
def test_however_narrow_the_margin_a_search_sees_a_corner_that_is_passed(
    overlap: float, share: float, steer: float
) -> None:
    """The right rear corner of a body that turns left by .1 rad passes a shelf's corner at a share of its way."""
    grid, corner, turn = drawn([".....", "...#.", ".....", ".....", "....."]), np.array([3.0, 3.0]), 0.1
    radius = WHEELBASE / math.tan(steer)
    centre = corner - (math.hypot(REAR, WIDTH / 2 + radius) - overlap) * math.sqrt(0.5)
    first = math.pi / 4 - math.atan2(-WIDTH / 2 - radius, -REAR) - share * turn
    headings = first + np.linspace(0.0, turn, 4001)
    x, y = centre[:, None] + radius * np.stack([np.sin(headings), -np.cos(headings)])
    apart = separation(bodies(x, y, headings)[:, None], shelves(grid.occupied)[None]).min()
    pose = pose_at(np.float32(x[0]), np.float32(y[0]), np.float32(first))
    area = test_manoeuvre.around(grid)
    free = arc_is_free(pose, np.float32(1.0 / radius), np.float32(radius * turn), TOO_NEAR, area)
    assert free or apart < 2.0 * TOO_NEAR
    assert not free or apart > 0.0


@given(st.sampled_from([1e-5, 5e-5, 5e-4]), st.integers(-40, 40))
def test_a_robot_at_the_margin_of_a_shelf_may_leave(margin: float, rounded: int) -> None:
    area = test_manoeuvre.around(drawn([".......", ".#.....", "......."]))  # a shelf behind its tail
    x = np.float32(2.0 + REAR + margin)
    x += rounded * np.spacing(x)
    pose = pose_at(x, np.float32(1.5), np.float32(0.0))
    assert arc_is_free(pose, np.float32(0.0), np.float32(0.06), np.float32(margin), area)


@pytest.mark.parametrize(
    ("floor", "pose", "goal"),
    [
        ("aisles:seed=83", (28.339151, 15.833553, 2.0613728), (30, 4)),  # only arcs of less than .1 m are free there
        ("aisles:seed=67", (8.256474, 11.171541, -0.75123733), (40, 40)),  # a corner .1 mm off a shelf
        ("aisles:seed=4", (38.406998, 18.282705, -0.043283675), (4, 4)),
        ("aisles:seed=709", (15.793388, 6.1104198, -0.25221914), (4, 4)),  # a corner passes another unseen
        ("aisles:seed=712", (5.8533993, 23.750538, 2.330247), (4, 4)),  # a corner at the margin
        ("single_lane", (10.312093, 30.265598, -1.4772751), (22, 38)),  # which 6,000 nodes do not free
    ],
)
def test_a_robot_wedged_beside_a_shelf_gets_out(
    floor: str, pose: tuple[float, float, float], goal: tuple[int, int]
) -> None:
    grid = make_layout(floor)
    free = np.argwhere(~grid.occupied)
    goal = tuple(free[np.abs(free - goal).sum(axis=1).argmin()].tolist())
    simulator = Simulator(EnvConfig(num_agents=1, planner="astar", action_repeat=2), grid=grid)
    simulator.reset([1], [Assignment(np.array([pose]), np.array([goal]))])
    put(simulator, 0, pose)
    cruise = np.full((1, 1), simulator.cruise_action)
    for _ in range(100):  # 20 s
        simulator.step(cruise)
    r = simulator.robots[0, 0]
    assert r["totals"]["hits_shelf"] == 0
    assert math.hypot(r["motion"]["x"] - pose[0], r["motion"]["y"] - pose[1]) > 2.0
