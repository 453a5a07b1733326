"""Contacts by hand: put-back, counts, near misses, chains (nose .15 m, tail .75 m off); the body against shelves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.simulation.reference import (
    FRONT,
    OFFSET,
    REAR,
    WHEELBASE,
    bodies,
    polygon_distance,
    rectangle,
    separation,
    shelves,
)
from tests.simulation.worlds import coast, drawn, raw, room, stage
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.physics.edges import Edges
from warehouse_env.simulation.physics.floor import Floor, floor_of
from warehouse_env.simulation.physics.footprint import body_touches_shelf, clearance_at, sweep_is_free
from warehouse_env.simulation.physics.geometry import Pose, Rectangle
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import field_of

EAST, NORTH, WEST = 0.0, math.pi / 2, math.pi
STILL = (0.0, 0.0)


def totals(simulator: Simulator, name: str) -> list[int]:
    return field_of(simulator.robots[0], name).tolist()


def x_of(simulator: Simulator, robot: int = 0) -> float:
    return float(simulator.robots[0, robot]["motion"]["x"])


def pressed(gap: float, speed: float, acceleration: float, steps: int) -> tuple[int, float]:
    """(contact episodes, gap left [m]) of a robot that presses on along a line, by contact.py's definition."""
    dt, count = 0.05, 0
    for _ in range(2 * steps):
        faster = min(max(speed + acceleration * dt, -0.5), 1.5)
        way = 0.5 * (speed + faster) * dt
        if way >= gap:  # put back: the rest of the gap, under near_miss_gap, is the same episode's
            speed, count = 0.0, 1
        else:
            gap, speed = gap - way, faster
    return count, gap


@pytest.mark.parametrize(("gap", "speed"), [(0.3107, 1.0), (0.4231, 1.5), (0.0317, 0.0), (0.3337, 0.4)])
def test_pressing_on_follows_the_definition_of_an_episode(gap: float, speed: float) -> None:
    wall = stage(room(5, 12), (12.0 - FRONT - gap, 2.5, EAST, speed))
    robot = stage(room(5, 12), (4.0, 2.5, EAST, speed), (4.0 + FRONT + REAR + gap, 2.5, EAST))
    for _ in range(60):
        wall.step(raw(wall, (1.0, 0.0)))
        robot.step(raw(robot, (1.0, 0.0), STILL))
    count, left = pressed(gap, speed, 1.0, 60)
    assert totals(wall, "hits_shelf") == [count]
    assert totals(robot, "hits_robot") == [count, count]
    assert 12.0 - FRONT - x_of(wall) == pytest.approx(left, abs=1e-5)
    assert x_of(robot, 1) - REAR - FRONT - x_of(robot, 0) == pytest.approx(left, abs=1e-5)


def test_a_second_bump_after_a_second_apart_counts_again() -> None:
    simulator = stage(room(5, 12), (4.0, 2.5, EAST, 0.5), (4.0 + FRONT + REAR + 0.02, 2.5, EAST))
    coast(simulator, 1)
    assert totals(simulator, "hits_robot") == [1, 1]
    for _ in range(6):
        simulator.step(raw(simulator, (-1.0, 0.0), STILL))
    for _ in range(30):
        simulator.step(raw(simulator, (1.0, 0.0), STILL))
        if simulator.events.hit_robot[0, 0]:
            break
    assert totals(simulator, "hits_robot") == [2, 2]


@pytest.mark.parametrize(("aside", "near"), [(0.08, 1), (0.12, 0)])
@pytest.mark.parametrize("repeat", [1, 2])
def test_a_near_miss_is_a_close_pass_without_a_touch(aside: float, near: int, repeat: int) -> None:
    simulator = stage(room(5, 14), (3.0, 2.0, EAST, 1.0), (9.0, 2.6 + aside, WEST, 1.0), action_repeat=repeat)
    gap = []
    for _ in range(44 // repeat):
        coast(simulator, 1)
        gap.append(float(simulator.events.gap[0, 0]))
        one, two = (bodies(*r["motion"][["x", "y", "heading"]].tolist()) for r in simulator.robots[0])
        now = min(polygon_distance(one, two), 0.5)
        assert gap[-1] == pytest.approx(now, abs=1e-5) or (repeat == 2 and gap[-1] < now)
    assert totals(simulator, "near_misses") == [near, near]
    assert totals(simulator, "hits_robot") == [0, 0]
    assert min(gap) == pytest.approx(aside, abs=1e-5)
    row = simulator.episode_metrics()
    assert row["near_misses"] == float(near)
    assert row["min_clearance_m"] == pytest.approx(aside, abs=1e-5)


def test_standing_close_is_a_near_miss_only_once_it_is_over() -> None:
    simulator = stage(room(5, 14), (4.0, 2.5, EAST), (4.0 + FRONT + REAR + 0.05, 2.5, EAST))
    coast(simulator, 20)
    assert totals(simulator, "near_misses") == [0, 0]
    for _ in range(10):
        simulator.step(raw(simulator, STILL, (1.0, 0.0)))
    assert totals(simulator, "near_misses") == [1, 1]


def test_a_chain_of_three_stands_where_it_stood() -> None:
    # C stands, B and A come up behind it, 2 cm apart at 1 m/s: B would touch C, and A the put-back B.
    xs = [3.0, 3.0 + 0.92, 3.0 + 1.84]
    simulator = stage(room(5, 12), (xs[0], 2.5, EAST, 1.0), (xs[1], 2.5, EAST, 1.0), (xs[2], 2.5, EAST))
    held = simulator.state.pose.copy()
    coast(simulator, 1)
    np.testing.assert_array_equal(simulator.state.pose, held)
    assert totals(simulator, "speed") == [0.0] * 3
    assert totals(simulator, "hits_robot") == [1, 2, 1]
    assert simulator.episode_metrics()["collisions_robot"] == 2.0
    # C drives off, and the others after it
    for _ in range(12):
        simulator.step(raw(simulator, (0.3, 0.0), (0.6, 0.0), (1.0, 0.0)))
    assert totals(simulator, "hits_robot") == [1, 2, 1]
    assert (simulator.state.pose[0, :, 0] > held[0, :, 0] + 0.2).all()


def test_a_touch_in_the_first_of_two_physics_steps_is_kept() -> None:
    simulator = stage(room(5, 12), (4.0, 2.5, EAST, 1.0), (4.0 + FRONT + REAR + 0.02, 2.5, EAST), action_repeat=2)
    coast(simulator, 1)
    assert simulator.events.hit_robot[0].tolist() == [1, 1]
    assert simulator.events.touching[0].tolist() == [1, 1]
    assert simulator.robots["clocks"]["contact_time"][0].tolist() == [pytest.approx(0.2)] * 2
    coast(simulator, 1)
    assert totals(simulator, "hits_robot") == [1, 1]
    assert simulator.robots["clocks"]["contact_time"][0].tolist() == [0.0, 0.0]


F = np.float32
MAP = drawn(["........", ".##...#.", "......#.", ".#......", ".....##.", "..#....."])
ROWS, COLUMNS = MAP.shape
WALLS = shelves(MAP.occupied)
FLOOR = floor_of(MAP)
inside = st.tuples(st.floats(0.0, COLUMNS), st.floats(0.0, ROWS))


def touches(cx: float, cy: float, heading: float, half_length: float = 0.45, half_width: float = 0.3) -> bool:
    body = Rectangle(*map(F, (cx, cy, math.cos(heading), math.sin(heading), half_length, half_width)))
    return bool(body_touches_shelf(body, FLOOR))


@given(inside, st.floats(-math.pi, math.pi))
def test_body_against_shelves_agrees_with_polygons(centre: tuple[float, float], heading: float) -> None:
    apart = float(separation(rectangle(*centre, heading, 0.45, 0.3), WALLS).min())
    assume(abs(apart) > 5e-6)
    assert touches(*centre, heading) == (apart < 0)


@given(inside)
def test_clearance_is_a_lower_bound_and_not_far_below(point: tuple[float, float]) -> None:
    x, y = (float(F(v)) for v in point)
    if not (x < COLUMNS and y < ROWS):
        return
    # distance of a point to axis-aligned boxes
    low, high = WALLS.min(axis=1), WALLS.max(axis=1)
    outside = np.maximum(np.maximum(low - (x, y), (x, y) - high), 0.0)
    distance = float(np.hypot(outside[:, 0], outside[:, 1]).min())
    known = float(clearance_at(F(x), F(y), FLOOR))
    assert known <= distance + 1e-6
    # at most a sample's diagonal (1 m / 8), and a count of 1 cm, too low
    assert known >= min(distance, 2.55) - 0.125 * math.sqrt(2) - 0.01 - 1e-6


def test_there_is_no_clearance_outside_the_map() -> None:
    for x, y in ((-0.1, 1.0), (1.0, -0.1), (8.01, 1.0), (1.0, 6.01), (1e3, 1e3)):
        assert clearance_at(F(x), F(y), FLOOR) == 0.0


def is_free(axle: tuple[float, float], heading: float, steering: float, distance: float, floor: Floor = FLOOR) -> bool:
    """Whether the body keeps 3 cm from shelves as it drives `distance` with that steering."""
    p = stage(MAP, (4.5, 3.5, 0.0))._params[0]
    bend = -math.tan(steering) / WHEELBASE
    start = Pose(*(F(v) for v in (*axle, heading, math.cos(heading), math.sin(heading))))
    return bool(sweep_is_free(start, F(bend), F(distance), F(0.03), p, floor))


@given(inside, st.floats(-math.pi, math.pi), st.floats(-1.04, 1.04), st.floats(-1.5, 1.5))
def test_a_free_sweep_touches_nothing_on_its_way(
    axle: tuple[float, float], heading: float, steering: float, distance: float
) -> None:
    free = is_free(axle, heading, steering, distance)
    bend = -math.tan(steering) / WHEELBASE
    x, y = axle
    along = np.linspace(0.0, distance, 60)[1:]
    turned = heading + along * bend
    chord = along * np.sinc(along * bend / 2 / math.pi)
    xs, ys = x + chord * np.cos(heading + along * bend / 2), y + chord * np.sin(heading + along * bend / 2)
    poses = np.array(
        [
            rectangle(a - OFFSET * math.cos(t), b - OFFSET * math.sin(t), t, 0.45, 0.3)
            for a, b, t in zip(xs, ys, turned, strict=True)
        ]
    )
    # the start itself is not judged, so look from the first checked pose on (12 cm or 0.06 rad on at most)
    apart = separation(poses[:, None], WALLS[None]).min(axis=1)
    first = np.abs(along) >= min(0.12, 0.06 / max(abs(bend), 1e-9))
    if free and first.any():
        assert apart[first].min() > 0.0
    if not free:  # some pose on the way comes within the margin, and its corners' growth
        assert apart.min() < 0.03 * math.sqrt(2) + 0.03


@given(inside, st.floats(-math.pi, math.pi), st.floats(-1.04, 1.04), st.floats(-1.5, 1.5))
def test_poses_passed_over_would_have_been_free(
    axle: tuple[float, float], heading: float, steering: float, distance: float
) -> None:
    """A sweep that knows of no room, and so looks at every pose, gives the same answer."""
    unknown = FLOOR._replace(clearance=np.zeros_like(FLOOR.clearance))
    known, every = (is_free(axle, heading, steering, distance, floor) for floor in (FLOOR, unknown))
    assert known == every


def listed(grid: GridMap, row: int, column: int, lidar_range: float = 6.0) -> set[tuple[str, float, float, float]]:
    """(x or y, line, low, high) of the edges that a cell's lidar looks at; row 0 is the northernmost."""
    edges: Edges = floor_of(grid, lidar_range).edges
    first = edges.first[grid.shape[0] - row, column + 1]
    return {("x" if n < first[1] else "y", *map(float, edges.edges[edges.seen[n]])) for n in range(first[0], first[2])}


def test_a_row_of_shelves_is_one_edge_and_hides_what_is_behind_it() -> None:
    grid = drawn(["......", "......", ".####.", "......", "......"])
    seen = listed(grid, 0, 2)
    assert ("y", 3.0, 1.0, 5.0) in seen  # the row's north side, four cells in one
    assert ("y", 2.0, 1.0, 5.0) not in seen  # its south side faces away
    assert ("y", 0.0, 0.0, 6.0) not in seen  # all lines from here to the wall behind cross the row
    assert ("y", 0.0, 0.0, 6.0) in listed(grid, 0, 0)  # past the row's end it can be seen
    assert listed(grid, 2, 2) == set()  # nobody looks out of a shelf


def test_a_range_beyond_the_floor_sees_no_more_than_one_across_it() -> None:
    """Each edge is held against those in front of it, not against all: else this takes minutes."""
    occupied: NDArray[np.bool_] = np.random.default_rng(0).random((40, 40)) < 0.4
    grid = GridMap(occupied, name="scattered")
    across, beyond = floor_of(grid, 60.0).edges, floor_of(grid, 1e6).edges
    for one, other in zip(across, beyond, strict=True):
        np.testing.assert_array_equal(one, other)
