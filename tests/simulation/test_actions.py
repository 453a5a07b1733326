"""What the numbers of an action mean and what is no action; robots put somewhere see what drivers there see."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.simulation.worlds import room
from warehouse_env.config import EnvConfig, FleetPart, RobotSpec, SensorSpec
from warehouse_env.errors import ActionError, ConfigError, WarehouseError
from warehouse_env.maps.layouts import make_layout
from warehouse_env.simulation.actions import ActionDecoder
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment
from warehouse_env.traffic_spec import TrafficSpec


def decoded(config: EnvConfig, actions: Any) -> list[Any]:
    given = np.asarray(actions)
    commands = np.zeros((1, given.shape[1], 2), dtype=np.float32)
    decoder = ActionDecoder(config)
    decoder.decode(given, commands, decoder.no_choices(1, given.shape[1]))
    return [pytest.approx(pair, abs=1e-6) for pair in commands[0].tolist()]


def test_discrete_actions_are_speed_levels_times_offsets() -> None:
    config = EnvConfig(speed_levels=(-0.4, 0.0, 1.3), lateral_offsets=(0.0, 0.6, -0.6, 1.2))
    decoder = ActionDecoder(config)
    assert decoder.space.n == 12  # type: ignore[attr-defined]
    assert decoder.cruise == 8
    assert decoded(config, [[0, 3, 4, 9, 11]]) == [(-0.4, 0.0), (-0.4, 1.2), (0.0, 0.0), (1.3, 0.6), (1.3, 1.2)]


def test_of_preferences_the_first_is_driven() -> None:
    config = EnvConfig(speed_levels=(-0.4, 0.0, 1.3), lateral_offsets=(0.0, 0.6, -0.6, 1.2))
    liked = np.random.default_rng(0).normal(size=(1, 9, 12)).astype(np.float32)
    table = ActionDecoder(config).table
    assert decoded(config, liked) == table[liked.argmax(axis=-1)[0]].tolist()


def ranked(liked: dict[tuple[float, float], float]) -> list[Any]:
    """Choices (offset, speed, speed above 0) of one robot that likes these (speed, offset) more than all else."""
    config = EnvConfig(
        speed_levels=(0.0, 0.5, 1.5),
        lateral_offsets=(0.0, 0.6, -0.6),
        traffic=TrafficSpec(shield=True, right_of_way=True),
    )
    decoder, commands = ActionDecoder(config), np.zeros((1, 1, 2), np.float32)
    pairs = [(v, o) for v in config.speed_levels for o in config.lateral_offsets]
    preferences = [[[liked.get(pair, -1.0) for pair in pairs]]]
    choices = decoder.no_choices(1, 1)
    decoder.decode(preferences, commands, choices)
    assert commands[0, 0].tolist() == choices[0, 0, 0, [1, 0]].tolist()
    return [pytest.approx(row, abs=1e-6) for row in choices[0, 0].tolist()]


def test_offsets_come_in_the_order_of_their_best_speeds() -> None:
    rows = ranked({(0.0, 0.6): 5.0, (0.5, 0.6): 0.0, (1.5, -0.6): 3.0, (0.5, -0.6): 2.0, (0.5, 0.0): 1.0})
    wanted = [(0.6, 0.0, 0.5), (0.6, 0.0, 0.5), (-0.6, 1.5, 1.5), (0.0, 0.5, 0.5)]
    assert rows == wanted


def test_one_action_is_its_offset_first_and_then_the_right_and_the_left() -> None:
    config = EnvConfig(traffic=TrafficSpec(shield=True, right_of_way=True))
    decoder, commands = ActionDecoder(config), np.zeros((1, 1, 2), np.float32)
    choices = decoder.no_choices(1, 1)
    decoder.decode([[11]], commands, choices)  # 0.5 m/s, 0.6 m to the left
    assert choices[0, 0, :, 0].tolist() == pytest.approx([0.6, 0.0, -0.6, 0.6, -1.2, 1.2])
    assert (choices[0, 0, :, 1:] == 0.5).all()


def test_cruise_is_the_fastest_level_nearest_to_the_route() -> None:
    config = EnvConfig(speed_levels=(1.0, 1.4, 0.2), lateral_offsets=(-0.8, 0.3, 0.5))
    assert decoded(config, [[int(ActionDecoder(config).cruise)]]) == [(1.4, 0.3)]


def test_continuous_actions_are_around_cruising() -> None:
    config = EnvConfig(action_type="continuous", speed_levels=(-0.4, 0.0, 0.5, 1.3))
    given = [[[0, 0], [1, 1], [-1, -1], [0.5, -0.25], [-0.5, 7.0]]]
    expected = [(1.3, 0), (1.5, 1.2), (-0.5, -1.2), (1.4, -0.3), (0.4, 1.2)]
    assert decoded(config, given) == expected
    assert decoded(config, [[ActionDecoder(config).cruise]]) == [(1.3, 0.0)]


def test_raw_actions_are_in_units_of_the_limits() -> None:
    config = EnvConfig(action_type="raw")
    assert decoded(config, [[[0.5, -1.0], [-3.0, 0.1]]]) == [(0.5, -1.5), (-1.0, 0.15)]
    assert decoded(config, [[ActionDecoder(config).cruise]]) == [(0.0, 0.0)]


def small(action_type: Any) -> Simulator:
    simulator = Simulator(EnvConfig(num_agents=3, action_type=action_type, planner="astar"), 2, grid=room(9, 9))
    simulator.reset(seed=0)
    return simulator


BAD = [
    ("discrete", np.zeros((2, 2), dtype=int), r"\(2, 3\)"),
    ("discrete", np.zeros((2, 3)), "whole numbers"),
    ("discrete", np.array([[0, 0, 0], [0, 0, -1]]), r"0\.\.19.*-1"),
    ("discrete", np.zeros((2, 3, 19)), r"\(2, 3, 20\)"),
    ("discrete", np.where(np.arange(120).reshape(2, 3, 20) == 7, np.nan, 0.0), "nan"),
    ("continuous", np.full((2, 3, 2), np.nan), "finite"),
    ("raw", np.zeros((3, 2)), r"\(2, 3, 2\)"),
    ("raw", np.where(np.arange(12).reshape(2, 3, 2) == 7, np.inf, 0.0), "finite"),
]


@pytest.mark.parametrize(("action_type", "actions", "hint"), BAD)
def test_a_bad_action_is_one_sentence_and_changes_nothing(action_type: str, actions: Any, hint: str) -> None:
    simulator = small(action_type)
    before = simulator.robots.tobytes()
    with pytest.raises(ActionError, match=hint) as caught:
        simulator.step(actions)
    assert isinstance(caught.value, WarehouseError)
    assert isinstance(caught.value, ValueError)
    assert "\n" not in str(caught.value)
    assert simulator.robots.tobytes() == before
    assert simulator.steps.tolist() == [0, 0]


CONFIG = EnvConfig(planner="astar", num_agents=8, action_repeat=1, sensor=SensorSpec(predictions=True))


def test_a_placed_robot_observes_what_one_that_drove_there_observes() -> None:
    grid = make_layout("open")
    driven, standing = (Simulator(CONFIG, grid=grid) for _ in range(2))
    driven.reset(seed=7)
    standing.reset(seed=7)
    for _ in range(40):
        driven.step(np.tile(driven.cruise_action, (1, 8)))
    assert standing.put(driven.state.pose, driven.state.speed).tolist() == [True]
    ego = driven.layout.slices["ego"].start
    steering = [ego + 1, ego + 2]  # the wheels', which turn on; the follower's, which is that of a step before
    kept = np.setdiff1d(np.arange(driven.layout.size), steering)
    straight = np.abs(driven.state.steer[0]) < 2e-3
    assert straight.sum() >= 5
    np.testing.assert_allclose(standing.observation[0, straight], driven.observation[0, straight], atol=2e-3)
    standing.robots["motion"]["steer"] = driven.robots["motion"]["steer"]  # which predictions look at
    standing._observe()
    assert np.array_equal(standing.observation[..., kept], driven.observation[..., kept])
    assert np.abs(driven.robots["on_route"]["lateral"]).min() > 1e-3


# of a feature set that test_fleet compiles as well
FLEET = (FleetPart(1, RobotSpec(min_speed=0.0, max_speed=0.8)),)
MIXED = CONFIG.replace(num_agents=2, action_type="raw", sensor=SensorSpec(), fleet=FLEET)
THERE = [[(5.5, 5.5, 0.0), (9.5, 5.5, 0.0)]]


@pytest.mark.parametrize(
    ("pose", "speed", "says"),
    [
        (THERE, 1e5, "speed: 100000 m/s of robot 0 .* between -0.5 and 1.5"),
        (THERE, [[1.5, 0.81]], "robot 1 must lie between 0 and 0.8"),
        (THERE, math.nan, "speed=nan"),
        (THERE, [[0.0], [1.0, 2.0]], "speed="),
        (THERE[0], 0.0, "pose=.*shape"),
        (3.0, 0.0, "pose=3.0"),
        ([[(1, 1, 2), (1, 1, math.nan)]], 0.0, "pose="),
        ([[(1e30, 1, 0), (1, 1, 0)]], 0.0, "not on the floor of 40 x 40 m"),
        ([[(1, 1, 0), (3, 40.1, 0)]], 0.0, r"pose: \(3, 40.1\) is not on the floor"),
    ],
)
def test_what_robots_cannot_be_put_to_is_refused(pose: Any, speed: Any, says: str) -> None:
    """At 1e4 m/s a robot left the floor, at 1e5 m/s the lidar read memory that is not its own."""
    simulator = Simulator(MIXED, grid=make_layout("open"))
    simulator.reset(0)
    before = simulator.robots.tobytes()
    with pytest.raises(ConfigError, match=says):
        simulator.put(pose, speed)
    assert simulator.robots.tobytes() == before


@pytest.mark.parametrize("turns", [-1, 150])
def test_a_heading_of_many_turns_is_that_of_the_remainder(turns: int) -> None:
    heading, seen = np.pi / 2, []
    config = CONFIG.replace(num_agents=1, arrival="pose", sensor=SensorSpec())
    for more in (0, turns):
        simulator = Simulator(config, 2, grid=make_layout("open"))
        turned = heading + more * 2 * np.pi
        simulator.reset(0, [Assignment([(20.5, 20.5, turned)], [(30.5, 20.5, 1.0 + turned)])] * 2)
        seen += [simulator.observation.copy(), simulator.state.pose.copy()]
        simulator.put([[(20.5, 20.5, turned)]] * 2, 0.5)
        seen += [simulator.observation.copy(), simulator.state.pose.copy()]
    for one, other in zip(seen[:4], seen[4:], strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5)
