"""Right of way only where a robot has stood for a while: `right_of_way_after`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.simulation.rights import World, simulator_with_right
from tests.simulation.worlds import give_line, room, stage, write
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import NOBODY
from warehouse_env.simulation.traffic.local_activation import AROUND
from warehouse_env.simulation.traffic.waits import CALM, LONGER
from warehouse_env.traffic_spec import TrafficSpec

DECISION = 0.2  # [s]


def rules_act(world: World, after: float) -> bool:
    """Activate the rules around robots that have stood for `after` [s]; return whether they act on any robot."""
    world.simulator._params["right_of_way_after"] = after
    return world.activate_rules()


def three(beside: float) -> World:
    """Three robots: the second `beside` [m] from the first, the third far from both."""
    return World((4.0, 4.0, 0.0), (4.0, 4.0 + beside, 0.0), (20.0, 20.0, math.pi))


def test_rules_act_on_a_robot_that_has_stood_for_long_and_around_it() -> None:
    for beside, after, near in ((4.9, 1.0, True), (5.1, 1.0, False), (7.9, 3.0, True), (8.1, 3.0, False)):
        assert min(LONGER * after, AROUND) in (5.0, 8.0)  # [m]: a metre a second, 8 m at most
        world = three(beside)
        world.robots["shield"]["vetoed_by"][0] = 2  # which drives
        world.robots["clocks"]["waiting_time"][0] = 3.0
        world.robots["clocks"]["standing_time"][0] = LONGER * after - 0.1
        assert not rules_act(world, after)
        world.robots["clocks"]["standing_time"][0] = LONGER * after
        assert rules_act(world, after)
        assert (world.robots["traffic"]["rules_active"] > 0).tolist() == [True, near, False]


def held(holders: list[int]) -> World:
    """Five robots that have stood for 3 s, 5 m apart, each vetoed by the robot named, or by NOBODY."""
    world = World(*((4.0, 2.0 + 5.0 * k, 0.0) for k in range(5)), grid=room(8, 28))
    world.robots["clocks"]["standing_time"] = world.robots["clocks"]["waiting_time"] = 3.0
    world.robots["shield"]["vetoed_by"] = holders
    return world


def test_rules_act_on_wait_cycles_and_on_the_head_of_a_queue() -> None:
    for holders, expected in (
        ([1, 0, NOBODY, NOBODY, 3], [True, True, True, True, False]),  # two wait for each other, two for nobody
        ([2, 0, 1, 4, 2], [True, True, True, False, False]),  # a wait cycle of three, and two that queue for it
        ([1, 2, 3, 4, NOBODY], [False] * 4 + [True]),
        ([4, 0, 1, 2, 3], [True] * 5),
    ):
        world = held(holders)
        assert not rules_act(world, 3.1)
        assert rules_act(world, 3.0) == any(expected)
        assert (world.robots["traffic"]["rules_active"] > 0).tolist() == expected, holders


def test_rules_act_around_a_robot_that_waits_for_a_parked_one() -> None:
    world = held([1, NOBODY, NOBODY, 2, NOBODY])
    world.robots["task"]["alive"][[1, 4]] = 0
    world.robots["clocks"]["waiting_time"][2] = world.robots["clocks"]["standing_time"][2] = 0.0  # it drives
    assert not rules_act(world, 3.1)
    assert rules_act(world, 3.0)
    assert (world.robots["traffic"]["rules_active"] > 0).tolist() == [True, False, False, False, False]


def test_rules_act_on_a_robot_that_stands_for_nobody_but_not_around_it() -> None:
    for waited, expected in ((3.0, [True, False, False]), (0.0, [False] * 3)):
        world = three(2.0)
        world.robots["clocks"]["standing_time"][0], world.robots["clocks"]["waiting_time"][0] = 3.0, waited
        assert rules_act(world, 3.0) == any(expected)
        assert (world.robots["traffic"]["rules_active"] > 0).tolist() == expected


def test_a_moving_robot_breaks_the_wait_cycle() -> None:
    world = held([1, 2, 0, NOBODY, NOBODY])
    world.robots["clocks"]["waiting_time"][1:] = world.robots["clocks"]["standing_time"][1:] = 0.0
    assert not rules_act(world, 3.0)


def test_two_robots_nose_to_nose_are_a_wait_cycle_without_a_veto() -> None:
    world = World((8.0, 10.0, 0.0), (9.6, 10.0, math.pi), (20.0, 20.0, 0.0))
    world.robots["clocks"]["standing_time"][:2] = world.robots["clocks"]["waiting_time"][:2] = 3.0
    assert rules_act(world, 3.0)
    assert (world.robots["traffic"]["rules_active"] > 0).tolist() == [True, True, False]


def test_rules_act_everywhere_if_there_is_no_waiting_time() -> None:
    world = three(2.0)
    assert rules_act(world, 0.0)
    assert (world.robots["traffic"]["rules_active"] > 0).all()


def test_it_lasts_until_it_has_been_calm_for_a_while() -> None:
    world = three(2.0)
    world.robots["clocks"]["standing_time"][0] = LONGER * 3.0
    rules_act(world, 3.0)
    world.robots["clocks"]["standing_time"] = 0.0
    decisions = 0
    while rules_act(world, 3.0):
        decisions += 1
    assert decisions == pytest.approx(float(CALM) / DECISION, abs=1)
    assert (world.robots["traffic"]["yields_to"] == NOBODY).all()


def test_a_robot_without_rules_keeps_its_command_and_offset() -> None:
    world = World((8.0, 10.0, 0.0, 1.0), (10.0, 8.0, math.pi / 2, 1.0), ages=[100, 0])
    world.simulator._params["right_of_way_after"] = 3.0
    aside = np.array([[int(world.simulator.cruise_action) + 1] * 2])
    world.decide(aside)
    told = world.simulator._commands[0, 0]
    assert told[0, 1] != 0.0
    assert world.robots["traffic"]["side"].tolist() == told[:, 1].tolist()


@pytest.mark.parametrize("command", [0, 5])  # back, stand: the offset is 0
def test_a_robot_under_rules_completes_its_manoeuvre_against_its_policy(command: int) -> None:
    settings = {"traffic": TrafficSpec(shield=True, right_of_way=True, right_of_way_after=3.0), "action_repeat": 2}
    simulator = stage(room(10, 20), (10.0, 5.0, 0.0), action_type="discrete", **settings)
    give_line(simulator, 0, [[10.0 + k, 5.0] for k in range(6)])
    r = simulator.robots[0, 0]
    simulator.arcs[0, 0, 0] = -1.5, 0.0
    write(r, arcs=1, arc_margin=0.01, arc_left=-1.5, arc_x=10.0, arc_y=5.0, arc_heading=0.0, retreating=1, pause=5.0)
    for _ in range(30):
        r["traffic"]["rules_active"] = 10.0
        simulator.step(np.array([[command]]))
        if r["manoeuvre"]["arcs"] == 0:
            break
    assert r["motion"]["x"] == pytest.approx(8.5, abs=0.05)


def driven(simulator: Simulator, steps: int, seed: int = 5) -> tuple[bytes, bytes]:
    """All poses and observations of an episode of random commands, as bytes."""
    simulator.reset(seed=seed)
    rng, poses, seen = np.random.default_rng(seed), [], []
    for _ in range(steps):
        commands = rng.integers(0, simulator.action_space.n, (1, simulator.num_agents))
        simulator.step(np.where(rng.random(commands.shape) < 0.7, int(simulator.cruise_action), commands))
        poses.append(simulator.state.pose.tobytes())
        seen.append(simulator.observation.tobytes())
    return b"".join(poses), b"".join(seen)


def test_if_nobody_stands_for_long_it_is_as_if_it_were_not_there() -> None:
    without = driven(simulator_with_right(24, "narrow", right_of_way=False), 300)
    assert driven(simulator_with_right(24, "narrow", right_of_way_after=1e4), 300) == without
    assert driven(simulator_with_right(24, "narrow", right_of_way_after=2.0), 300) != without


def test_a_jam_that_the_field_leaves_is_dissolved() -> None:
    """Robots that only drive on block each other for good; with right of way after 5 s they come through."""
    goals = {False: 0.0, True: 0.0}
    for right in goals:
        switches: dict[str, Any] = {"right_of_way_after": 5.0} if right else {"right_of_way": False}
        simulator = simulator_with_right(32, "narrow", max_steps=1500, routes=False, **switches)
        cruise = np.full((1, 32), int(simulator.cruise_action))
        for seed in (10, 11):
            simulator.reset(seed=seed)
            for _ in range(1500):
                simulator.step(cruise)
            row = simulator.episode_metrics()
            assert row["collisions_robot"] == row["collisions_shelf"] == 0
            assert row["stuck"] < 0.1 if right else row["stuck"] > 0.5
            goals[right] += row["goals"]
    assert goals[True] > 3 * goals[False]


@pytest.mark.parametrize(("kept", "active"), [(1.4, [False, False]), (1.6, [True, False]), (5.5, [True, True])])
def test_rules_act_around_a_person_kept_from_walking(kept: float, active: list[bool]) -> None:
    world = World((4.0, 4.0, 0.0), (4.0, 9.5, 0.0), people=1)
    person = world.simulator.people.persons[0, 0]
    person["x"], person["y"], person["kept"] = 5.0, 4.5, kept
    assert rules_act(world, 12.0) == any(active)
    assert (world.robots["traffic"]["rules_active"] > 0).tolist() == active
