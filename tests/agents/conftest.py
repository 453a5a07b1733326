"""Hand-made observations: a robot that sees nothing, and one with another robot at a given place."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from agents import Network, PolicyRecord, save_policy
from warehouse_env.config import EnvConfig
from warehouse_env.observation import observation_layout

Observe = Callable[..., NDArray[np.float32]]


@pytest.fixture
def observe() -> Observe:
    """Return a function that makes float32[1, 1, D]: own speed [m/s], and another body's centre (x, y) [m] and turn."""

    def make(
        config: EnvConfig, speed: float = 0.0, other: tuple[float, float] | None = None, turn: float = 0.0
    ) -> NDArray[np.float32]:
        layout, sensor = observation_layout(config), config.sensor
        observation = np.zeros((1, 1, layout.size), np.float32)
        observation[..., layout.slices["ego"].start] = speed / config.robot.max_speed
        if other is not None:
            x, y = other[0] / sensor.lidar_range, other[1] / sensor.lidar_range
            seen = (x, y, np.cos(turn), np.sin(turn), 0.0, 0.0, 1.0)
            observation[..., layout.slices["neighbours"].start :][..., :7] = seen
        return observation

    return make


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a policy folder with random weights for the default EnvConfig."""
    config = EnvConfig()
    actions = len(config.speed_levels) * len(config.lateral_offsets)
    network = Network(observation_layout(config).size, actions, True, (8, 8))
    rng = np.random.default_rng(0)
    tensors = {name: rng.normal(size=shape).astype(np.float32) for name, shape in network.shapes().items()}
    return save_policy(tmp_path / "mine", PolicyRecord("reinforce", network, config), tensors)
