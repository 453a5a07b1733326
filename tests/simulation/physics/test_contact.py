"""Contacts by hand: put-back, what is counted and how often, near misses, chains. Nose 0.15 m and tail 0.75 m off."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.simulation.reference import FRONT, REAR, bodies, polygon_distance
from tests.simulation.worlds import coast, raw, room, stage
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
