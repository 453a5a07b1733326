"""Messages lost: who is silent is seen by lidar alone, and keeps the stop that it has published; 0 changes nothing."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.simulation.physics.test_no_overlap import crowd
from tests.simulation.rights import World
from tests.simulation.safe_stops import assert_all_can_stop
from tests.simulation.test_determinism import MAP, actions_for
from tests.simulation.worlds import drawn, give_line, raw, room, stage
from warehouse_env.config import EnvConfig, SensorSpec
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.traffic_spec import TrafficSpec, UncertaintySpec

STANDING = ((5.0, 5.0, 0.0), (7.0, 5.0, math.pi))


def seen(loss: float) -> tuple[Simulator, NDArray[np.float32]]:
    """What each of two robots, nose to nose, sees of the other."""
    changes = {
        "action_type": "discrete",
        "sensor": SensorSpec(predictions=True),
        "uncertainty": UncertaintySpec(loss=loss),
    }
    simulator = stage(room(10, 12), *STANDING, **changes)
    for robot, (x, y, heading) in enumerate(STANDING):
        ahead = np.arange(0.0, 4.0, 0.25)[:, None] * [math.cos(heading), math.sin(heading)]
        give_line(simulator, robot, np.array([x, y]) + ahead)
    return simulator, simulator.step(np.full((1, 2), 5))[0].copy()  # speed 0, on the route


def test_a_silent_robot_is_seen_by_lidar_alone() -> None:
    simulator, heard = seen(0.0)
    _, unheard = seen(1.0)
    of = simulator.layout.slices
    assert (heard[:, of["neighbours"].start + 6] == 1).all()
    assert not unheard[:, of["neighbours"]].any()
    assert (heard[:, of["predictions"]] < 1).any(axis=1).all()
    assert (unheard[:, of["predictions"]] == 1).all()
    for name in ("lidar", "ego", "route"):
        np.testing.assert_array_equal(unheard[:, of[name]], heard[:, of[name]])


@pytest.mark.parametrize(("silent", "held"), [((0, 0), [0, 0]), ((0, 1), [1, 1]), ((1, 0), [1, 0])])
def test_who_is_not_heard_keeps_its_stop_and_others_count_on_it(silent: tuple[int, int], held: list[int]) -> None:
    """Both stop within the same way, so who is 0.1 m ahead is in the way only if it stops now, as unheard it does."""
    poses = (2.0, 1.5, 0.0, 1.5), (3.0, 1.5, 0.0, 1.5)
    simulator = stage(room(3, 30), *poses, traffic=TrafficSpec(shield=True))
    simulator.robots["task"]["age"][0, 1] = 1
    simulator.robots["shield"]["silent"][0] = silent
    simulator.step(raw(simulator, (1.0, 0.0), (1.0, 0.0)))
    assert simulator.robots["shield"]["vetoed"][0].tolist() == held
    np.testing.assert_allclose(simulator.state.speed[0], np.where(held, 1.4, 1.5), atol=1e-6)


@settings(max_examples=20)
@given(st.integers(0, 10**6), st.sampled_from([0.1, 0.3, 0.9]), st.sampled_from([0.0, 0.5, 5.0]))
def test_whatever_is_lost_nobody_touches_anything(seed: int, loss: float, burst: float) -> None:
    """In a crowd told to drive at random, each of whom must be able to stop clear of all others after every step."""
    rng = np.random.default_rng(seed)
    grid = room(9, 9)
    changes = {"traffic": TrafficSpec(shield=True), "uncertainty": UncertaintySpec(loss=loss, burst=burst)}
    simulator = stage(grid, *crowd(rng, grid, 12, 0.05), **changes)
    simulator.draws.begin(0, [seed])
    simulator.messages.begin(0)
    commands = np.zeros((1, simulator.num_agents, 2))
    for _ in range(80):
        fresh = rng.choice([-1.0, 0.0, 1.0], commands.shape, p=[0.2, 0.1, 0.7])
        commands = np.where(rng.random((*commands.shape[:2], 1)) < 0.3, fresh, commands)
        simulator.step(commands)
        assert_all_can_stop(simulator)
    assert not simulator.robots["totals"]["hits_robot"].any()
    assert not simulator.robots["totals"]["hits_shelf"].any()
    assert simulator.robots["totals"]["distance"].sum() > 0.1


def test_what_a_silent_robot_is_granted_the_others_learn_a_decision_later() -> None:
    authority = {}
    for silent in (0, 1):
        world = World((8.0, 10.0, 0.0, 1.0), (10.0, 8.0, math.pi / 2, 1.0), ages=(100, 0))
        world.robots["shield"]["silent"][0] = silent
        world.decide()
        authority[silent] = world.robots["traffic"]["authority"].tolist()
        assert world.robots["traffic"]["authority"][0] > 2.0 + 0.3 + 0.75  # over the crossing
    assert authority[0][1] < 2.0  # waits before it
    assert authority[1][1] > authority[0][1]
    world.robots["shield"]["silent"][0] = 0
    assert world.decide().robots["traffic"]["yields_to"].tolist() == [-1, 0]


def test_bursts_last_as_long_as_asked_for_and_lose_as_much() -> None:
    uncertainty = UncertaintySpec(loss=0.25, burst=2.0)  # ten decisions of 0.2 s
    sensor = SensorSpec(predictions=True)
    config = EnvConfig(num_agents=5, planner="astar", action_repeat=2, sensor=sensor, uncertainty=uncertainty)
    simulator = Simulator(config, 8, grid=drawn(MAP))
    simulator.reset(2)
    lost = []
    for actions in actions_for("discrete", 400, 8, 5):
        simulator.step(actions)
        lost.append(simulator.robots["shield"]["silent"].reshape(-1).copy())
    lasted = [len(run) for robot in np.array(lost).T for run in "".join(map(str, robot)).strip("1").split("0") if run]
    assert min(lasted) == 10
    assert all(run % 10 == 0 for run in lasted)  # one may begin when another ends
    assert np.mean(lost) == pytest.approx(0.25, abs=0.05)
