"""`orca`: the library's velocities where the answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from agents.reciprocal import Reciprocal, Reciprocity
from tests.agents.conftest import Observe
from tests.agents.test_potential_field import seen
from warehouse_env.config import EnvConfig
from warehouse_env.observation import observation_layout

pytest.importorskip("pyrvo")
RNG = np.random.default_rng(0)


def test_alone_it_cruises_along_the_route(observe: Observe) -> None:
    config = EnvConfig()
    policy = Reciprocal(config)
    assert policy.velocity(seen(observe, config, (1.2, 1.6)))[0, 0] == pytest.approx([0.9, 1.2])
    assert policy.act(seen(observe, config, (1.2, 1.6)), RNG).tolist() == [[15]]


def test_half_of_the_change_is_the_own_one(observe: Observe) -> None:
    """Head on, both at 1 m/s, 4 m apart, discs of .5 m: the cone's leg has a sine of 1 / 4 and lies 2 m/s / 4 away.

    Half of that, .25 m/s, at right angles to the leg, is the own share: slower by .25^2, and to the right.
    """
    config = EnvConfig(speed_levels=(0.0, 1.0))
    observation = seen(observe, config, speed=1.0, other=(4.0, 0.0), turn=np.pi)
    observation[..., observation_layout(config).slices["neighbours"].start + 4] = -2.0 / config.robot.max_speed
    velocity = Reciprocal(config, Reciprocity(radius=0.5, horizon=2.0)).velocity(observation)[0, 0]
    assert velocity == pytest.approx([1 - 0.25**2, -0.25 * np.sqrt(1 - 0.25**2)], abs=1e-5)
