"""`follow` and `brake` on hand-made observations, and on the route."""

from __future__ import annotations

import numpy as np
import pytest

from agents import make_policy
from agents.route_command import RouteCommand
from tests.agents.conftest import Observe
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.observation import observation_layout
from warehouse_env.simulation.simulator import Simulator

RNG = np.random.default_rng(0)


def test_follow_commands_the_fastest_level_on_the_route(observe: Observe) -> None:
    config = EnvConfig(speed_levels=(0.0, 1.3, 0.5), lateral_offsets=(0.6, 0.0))
    action = make_policy("follow", config).act(observe(config, other=(0.9, 0.0)), RNG)
    assert action.tolist() == [[1 * 2 + 1]]


def test_real_valued_actions_cruise_at_zero_and_stop_between_it_and_the_slowest(observe: Observe) -> None:
    config = EnvConfig(action_type="continuous")
    assert make_policy("follow", config).act(observe(config), RNG).tolist() == [[[0.0, 0.0]]]
    stop = make_policy("brake", config).act(observe(config, other=(0.9, 0.0)), RNG)
    assert stop[0, 0] == pytest.approx([-1.5 / (1.5 + 0.5), 0.0])  # cruise 1.5 m/s, slowest -0.5 m/s


def test_raw_actions_pursue_the_route(observe: Observe) -> None:
    config = EnvConfig(action_type="raw", action_repeat=2)
    observation = observe(config, speed=1.2)
    slices = observation_layout(config).slices
    observation[..., slices["ego"].start + 1] = -0.3  # steering now, of 60 degrees
    observation[..., slices["route"].start :][..., :2] = 0.2, 0.2  # 1 m ahead and 1 m left: an arc of radius 1 m
    action = make_policy("follow", config).act(observation, RNG)
    wanted, most = -np.arctan(0.6 / 1.0), config.robot.max_steering
    acceleration = (1.3 * (1 + wanted / most) - 1.2) / 0.2
    rate = (wanted + 0.3 * most) / 0.2 / 1.5
    assert -1 < rate < 0
    assert action[0, 0] == pytest.approx([max(acceleration, -1.0), rate], abs=1e-5)


@pytest.mark.parametrize(
    ("other", "turn", "speed", "stops"),
    [
        ((0.95, 0.0), 0.0, 0.0, True),  # bumper to bumper
        ((2.6, 0.0), 0.0, 1.3, True),  # gap 1.7 m, within the stopping distance
        ((2.6, 0.0), 0.0, 0.0, False),  # far enough for a standing robot
        ((5.0, 0.0), 0.0, 1.3, False),
        ((-1.0, 0.0), 0.0, 1.3, False),  # behind
        ((1.2, 0.80), 0.0, 1.3, False),  # 0.2 m beside the corridor's 0.3 + 0.15 m
        ((1.2, 0.80), np.pi / 2, 1.3, True),  # crosswise, its 0.45 m reach into it
        ((1.2, -0.7), 0.0, 1.3, True),
        (None, 0.0, 1.3, False),  # the zeros of an absent one
    ],
)
def test_brake_stops_for_a_body_in_its_corridor(
    observe: Observe, other: tuple[float, float] | None, turn: float, speed: float, stops: bool
) -> None:
    config = EnvConfig(action_repeat=2)
    action = make_policy("brake", config).act(observe(config, speed, other, turn), RNG)
    assert config.speed_levels[int(action[0, 0]) // 5] == (0.0 if stops else 1.5)
    assert int(action[0, 0]) % 5 == 0  # no offset


@pytest.mark.parametrize("action_type", ["discrete", "continuous", "raw"])
def test_follow_drives_one_robot_to_goals_without_a_touch(action_type: str) -> None:
    config = EnvConfig(layout="open", num_agents=1, planner="astar", action_type=action_type)  # type: ignore[arg-type]
    simulator, policy = Simulator(config), make_policy("follow", config)
    simulator.reset(3)
    for _ in range(400):
        simulator.step(policy.act(simulator.observation, RNG))
    row = simulator.episode_metrics(0)
    assert row["goals"] >= 1
    assert row["collisions_shelf"] == 0


def test_the_cruise_action_is_the_simulators() -> None:
    for action_type in ("discrete", "continuous"):
        config = EnvConfig(layout="open", planner="astar", action_type=action_type, robot=RobotSpec(max_speed=1.4))
        nothing = np.zeros((1, observation_layout(config).size), np.float32)
        command = RouteCommand(config)
        ours = command.at_speed(nothing, np.full(1, command.cruise_speed))[0]
        assert np.array_equal(ours, Simulator(config).cruise_action)
