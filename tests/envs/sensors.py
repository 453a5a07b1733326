"""An extra sensor to test with."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.simulation.senses.extra import SensorView


class Compass:
    """The heading, disturbed by noise, and the share of the floor's width that lies west of the robot."""

    size = 3
    bounds = (-2.0, 2.0)

    def __init__(self, config: EnvConfig, noise: float = 0.1) -> None:
        self.noise = noise

    def observe(self, view: SensorView) -> NDArray[Any]:
        x, _, heading = np.moveaxis(view.state.pose, -1, 0)
        drawn = [np.random.default_rng([*key, step]) for key, step in zip(view.keys, view.steps, strict=True)]
        noise = np.stack([rng.uniform(-self.noise, self.noise, x.shape[1]) for rng in drawn])
        west = x / (view.grid.shape[1] * view.grid.cell_size)
        return np.stack([np.cos(heading) + noise, np.sin(heading), west], axis=-1)
