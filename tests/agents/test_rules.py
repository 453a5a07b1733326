"""Rules on hand-made observations: `follow`, `brake`, paper 001's conflicts, velocities of `orca`."""

from __future__ import annotations

import numpy as np
import pytest

from agents import make_policy
from agents.reciprocal import Reciprocal, Reciprocity
from agents.route_command import RouteCommand
from agents.rules import RuleNumbers, Rules
from tests.agents.conftest import Observe
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.observation import observation_layout
from warehouse_env.simulation.simulator import Simulator


def test_follow_commands_the_fastest_level_on_the_route(observe: Observe) -> None:
    config = EnvConfig(speed_levels=(0.0, 1.3, 0.5), lateral_offsets=(0.6, 0.0))
    action = make_policy("follow", config).act(observe(config, other=(0.9, 0.0)), RNG)
    assert action.tolist() == [[1 * 2 + 1]]


def test_continuous_actions_cruise_at_zero_and_stop_below(observe: Observe) -> None:
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
        ((1.2, 0.80), np.pi / 2, 1.3, True),  # crosswise: its 0.45 m reach into the corridor
        ((1.2, -0.7), 0.0, 1.3, True),
        (None, 0.0, 1.3, False),  # zeros of an absent neighbour
    ],
)
def test_brake_stops_for_bodies_in_its_corridor(
    observe: Observe, other: tuple[float, float] | None, turn: float, speed: float, stops: bool
) -> None:
    config = EnvConfig(action_repeat=2)
    action = make_policy("brake", config).act(observe(config, speed, other, turn), RNG)
    assert config.speed_levels[int(action[0, 0]) // 5] == (0.0 if stops else 1.5)
    assert int(action[0, 0]) % 5 == 0  # no offset


@pytest.mark.parametrize("action_type", ["discrete", "continuous", "raw"])
def test_follow_reaches_goals_without_contact(action_type: str) -> None:
    config = EnvConfig(layout="open", num_agents=1, planner="astar", action_type=action_type)  # type: ignore[arg-type]
    simulator, policy = Simulator(config), make_policy("follow", config)
    simulator.reset(3)
    for _ in range(400):
        simulator.step(policy.act(simulator.observation, RNG))
    row = simulator.episode_metrics(0)
    assert row["goals"] >= 1
    assert row["collisions_shelf"] == 0


def test_cruise_action_equals_the_simulators() -> None:
    for action_type in ("discrete", "continuous"):
        config = EnvConfig(layout="open", planner="astar", action_type=action_type, robot=RobotSpec(max_speed=1.4))
        nothing = np.zeros((1, observation_layout(config).size), np.float32)
        command = RouteCommand(config)
        ours = command.at_speed(nothing, np.full(1, command.cruise_speed))[0]
        assert np.array_equal(ours, Simulator(config).cruise_action)


RNG = np.random.default_rng(0)


def view(observe: Observe, config: EnvConfig, route: tuple[float, float] = (2.0, 0.0), **more: object) -> np.ndarray:  # type: ignore[type-arg]
    """Return observations far from shelves and goal; the route passes `route` [m] from the front axle."""
    observation = observe(config, **more)
    slices, sensor = observation_layout(config).slices, config.sensor
    observation[..., slices["lidar"]] = 1 / (1 + sensor.lidar_range)
    observation[..., slices["ego"].start + 5] = 1.0
    observation[..., slices["route"]] = np.tile(np.array(route) / 5, sensor.route_points)
    return observation


@pytest.mark.parametrize("action_type", ["discrete", "continuous", "raw"])
def test_actions_stay_within_their_bounds(action_type: str) -> None:
    config = EnvConfig(action_type=action_type)  # type: ignore[arg-type]
    observation = np.random.default_rng(1).uniform(-1, 1, (1, 200, observation_layout(config).size)).astype(np.float32)
    action = Rules(config).act(observation, RNG)
    assert np.isfinite(action).all()
    assert action_type == "discrete" or np.abs(action).max() <= 1.0


CONFIG = EnvConfig()
WIDE = RuleNumbers(range=4.0)


def command(policy: Rules, observation: np.ndarray, seed: int = 0) -> tuple[float, float]:  # type: ignore[type-arg]
    action = int(policy.act(observation, np.random.default_rng(seed))[0, 0])
    return CONFIG.speed_levels[action // 5], CONFIG.lateral_offsets[action % 5]


def with_velocity(observation: np.ndarray, vx: float, vy: float) -> np.ndarray:  # type: ignore[type-arg]
    """Give the neighbour a velocity [m/s] relative to the own."""
    start = observation_layout(CONFIG).slices["neighbours"].start
    observation[..., start + 4 : start + 6] = np.array([vx, vy]) / CONFIG.robot.max_speed
    return observation


def test_rules_cruise_when_alone(observe: Observe) -> None:
    assert command(Rules(CONFIG, WIDE), view(observe, CONFIG)) == (1.5, 0.0)


@pytest.mark.parametrize(
    ("other", "turn", "waits"),
    [
        ((2.5, -2.5), np.pi / 2, True),  # as far from the node as itself, from the right
        ((2.5, 2.5), -np.pi / 2, False),  # from the left
        ((2.5, 1.5), -np.pi / 2, True),  # from the left, but a body's length nearer
        ((2.5, -3.6), np.pi / 2, False),  # from the right, but further
        ((2.5, 2.5), np.pi / 2, False),  # past the node
    ],
)
def test_nearer_robot_goes_first_at_a_node_then_the_one_on_the_right(
    observe: Observe, other: tuple[float, float], turn: float, waits: bool
) -> None:
    observation = with_velocity(view(observe, CONFIG, other=other, turn=turn), 0.0, np.sin(turn))
    assert command(Rules(CONFIG, WIDE), observation)[0] == (0.0 if waits else 1.5)


def test_exactly_one_of_two_robots_waits_at_a_node(observe: Observe) -> None:
    """Check both robots' views of one meeting: they agree on who waits without communication."""
    rng, policy = np.random.default_rng(4), Rules(CONFIG, WIDE)
    for _ in range(200):
        own, others = rng.uniform(0.8, 3.0, 2)  # [m] to the node
        turn = rng.uniform(0.9, 2.2) * rng.choice([-1, 1])
        x, y = own - others * np.cos(turn), -others * np.sin(turn)
        back_x, back_y = -x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) - y * np.cos(turn)
        waits = []
        for place, angle in (((x, y), turn), ((back_x, back_y), -turn)):
            observation = with_velocity(
                view(observe, CONFIG, speed=1.0, other=place, turn=angle), np.cos(angle) - 1, np.sin(angle)
            )
            near = policy._surroundings.neighbours(observation)
            waits.append(bool(policy.must_wait(near, np.ones((1, 1))).any()))
        assert sum(waits) == 1


def test_head_on_robots_step_aside_to_the_free_side(observe: Observe) -> None:
    observation = view(observe, CONFIG, other=(3.5, 0.0), turn=np.pi)
    assert command(Rules(CONFIG, WIDE), observation) == (0.5, -0.6)
    lidar = observation_layout(CONFIG).slices["lidar"].start
    observation[..., lidar + 24] = 1 / (1 + 0.3 + 0.2)  # shelf 0.2 m to the right
    assert command(Rules(CONFIG, WIDE), observation) == (0.5, 0.6)
    observation[..., lidar + 8] = 1 / (1 + 0.3 + 0.2)  # and on the left
    assert command(Rules(CONFIG, WIDE), observation) == (0.5, 0.0)


def test_robot_nose_to_nose_waits_then_backs_at_random(observe: Observe) -> None:
    policy = Rules(CONFIG, RuleNumbers(begins=0.5))
    observation = view(observe, CONFIG, other=(1.1, 0.0), turn=np.pi)
    assert {command(policy, observation, seed)[0] for seed in range(20)} == {0.0}
    observation[..., observation_layout(CONFIG).slices["ego"].start + 7] = 10 / 20  # standing for 10 s
    assert {command(policy, observation, seed)[0] for seed in range(20)} == {0.0, -0.4}


def test_orca_cruises_when_alone(observe: Observe) -> None:
    pytest.importorskip("pyrvo")
    config = EnvConfig()
    policy = Reciprocal(config)
    assert policy.velocity(view(observe, config, (1.2, 1.6)))[0, 0] == pytest.approx([0.9, 1.2])
    assert policy.act(view(observe, config, (1.2, 1.6)), RNG).tolist() == [[15]]


def test_orca_takes_half_of_the_velocity_change(observe: Observe) -> None:
    """Check two robots head-on at 1 m/s, 4 m apart, discs of .5 m: the cone's leg has sine 1 / 4, 2 m/s / 4 away.

    The own share is half of that, .25 m/s at right angles to the leg: slower by .25^2, and to the right.
    """
    pytest.importorskip("pyrvo")
    config = EnvConfig(speed_levels=(0.0, 1.0))
    observation = view(observe, config, speed=1.0, other=(4.0, 0.0), turn=np.pi)
    observation[..., observation_layout(config).slices["neighbours"].start + 4] = -2.0 / config.robot.max_speed
    velocity = Reciprocal(config, Reciprocity(radius=0.5, horizon=2.0)).velocity(observation)[0, 0]
    assert velocity == pytest.approx([1 - 0.25**2, -0.25 * np.sqrt(1 - 0.25**2)], abs=1e-5)
