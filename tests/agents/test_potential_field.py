"""`apf` on hand-made observations: what each force does, and its command."""

from __future__ import annotations

import numpy as np
import pytest

from agents.potential_field import FieldGains, PotentialField
from tests.agents.conftest import Observe
from warehouse_env.config import EnvConfig
from warehouse_env.observation import observation_layout

RNG = np.random.default_rng(0)


def seen(observe: Observe, config: EnvConfig, route: tuple[float, float] = (2.0, 0.0), **what: object) -> np.ndarray:  # type: ignore[type-arg]
    """A robot far from shelves and goal, whose route leads through `route` [m] from its front axle."""
    observation = observe(config, **what)
    slices, sensor = observation_layout(config).slices, config.sensor
    observation[..., slices["lidar"]] = 1 / (1 + sensor.lidar_range)
    observation[..., slices["ego"].start + 5] = 1.0
    observation[..., slices["route"]] = np.tile(np.array(route) / 5, sensor.route_points)
    return observation


def test_alone_it_is_drawn_to_the_route_point_and_cruises(observe: Observe) -> None:
    config = EnvConfig()
    policy = PotentialField(config)
    assert policy.force(seen(observe, config, (1.2, 1.6)))[0, 0] == pytest.approx([0.6, 0.8])
    assert policy.act(seen(observe, config, (1.2, 1.6)), RNG).tolist() == [[15]]  # 1.5 m/s, offset 0


def test_a_robot_repels_by_paper_001s_formula(observe: Observe) -> None:
    config = EnvConfig()
    gains = FieldGains(robots=0.2, robots_range=2.0)
    force = PotentialField(config, gains).force(seen(observe, config, other=(0.0, 1.4)))[0, 0]
    gap = 1.4 - 0.9
    assert force == pytest.approx([1.0, -0.2 * (1 / gap - 1 / 2.0) / gap**2], rel=1e-5)


def test_a_shelf_repels_within_its_range_only(observe: Observe) -> None:
    config = EnvConfig()
    policy = PotentialField(config, FieldGains(lidar=0.32, lidar_range=1.0))
    for gap, push in ((0.5, 0.32 * (2 - 1) / 0.25 / 32), (1.1, 0.0)):
        observation = seen(observe, config)
        observation[..., 8] = 1 / (1 + 0.3 + gap)  # the ray to the left; the body reaches 0.3 m there
        assert policy.force(observation)[0, 0] == pytest.approx([1.0, -push], abs=1e-5)


def test_one_ahead_brakes_it_and_one_aside_shifts_it(observe: Observe) -> None:
    config = EnvConfig()
    policy = PotentialField(config, FieldGains(robots=0.15))
    speed = lambda action: config.speed_levels[int(action[0, 0]) // 5]  # noqa: E731
    assert speed(policy.act(seen(observe, config, other=(1.4, 0.0)), RNG)) <= 0.0
    aside = int(policy.act(seen(observe, config, other=(1.0, 1.0)), RNG)[0, 0]) % 5
    assert config.lateral_offsets[aside] < 0  # to the right of a robot on the left


@pytest.mark.parametrize("action_type", ["discrete", "continuous", "raw"])
def test_actions_stay_within_their_bounds(action_type: str) -> None:
    config = EnvConfig(action_type=action_type)  # type: ignore[arg-type]
    observation = np.random.default_rng(1).uniform(-1, 1, (1, 200, observation_layout(config).size)).astype(np.float32)
    action = PotentialField(config).act(observation, RNG)
    assert np.isfinite(action).all()
    assert action_type == "discrete" or np.abs(action).max() <= 1.0
