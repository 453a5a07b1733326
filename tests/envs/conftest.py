"""Provide small configurations of every layout, action type and task mode, with the fastest planner."""

from __future__ import annotations

import itertools
from typing import Any, get_args

import numpy as np
import pytest
from numpy.typing import NDArray

from warehouse_env.config import ActionType, EnvConfig, SensorSpec
from warehouse_env.maps.layouts import LAYOUTS
from warehouse_env.observation import SENSORS
from warehouse_env.simulation.senses.extra import SensorView
from warehouse_env.work import BatterySpec, OrderSpec, ServiceSpec


class Compass:
    """Sensor of the noisy heading and of the share of the floor's width west of the robot."""

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


CASES = [
    *itertools.product(("open",), get_args(ActionType), ("lifelong", "one_shot")),
    *itertools.product(sorted({*LAYOUTS} - {"open", "blocks"}), ("discrete",), ("lifelong",)),
]

WORKING = ("open", "orders", "batteries")
SENSING = ("open", "extra", "sensor")


def working() -> EnvConfig:
    """Return a configuration with service, orders and batteries."""
    return EnvConfig(
        layout="open", num_agents=3, max_steps=12, planner="astar", arrival="stop", service=ServiceSpec(0.3, 0.3),
        orders=OrderSpec(per_hour=36_000), battery=BatterySpec(),
    )  # fmt: skip


@pytest.fixture(params=[*CASES, WORKING, SENSING], ids="-".join)
def every_config(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> EnvConfig:
    """Return one configuration of each kind."""
    if request.param == WORKING:
        return working()
    plain = EnvConfig(layout="open", num_agents=3, max_steps=12, planner="astar")
    if request.param == SENSING:
        monkeypatch.setitem(SENSORS, "compass", Compass)
        return plain.replace(sensor=SensorSpec(extra="compass"))
    layout, action_type, tasks = request.param
    return plain.replace(layout=layout, action_type=action_type, tasks=tasks)


@pytest.fixture
def tiny() -> EnvConfig:
    """Return three robots on the open floor for twelve steps."""
    return EnvConfig(layout="open", num_agents=3, max_steps=12, planner="astar")
