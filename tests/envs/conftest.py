"""Small configurations: every layout, action type and task mode, few robots, few steps, the fastest planner."""

from __future__ import annotations

import itertools
from typing import get_args

import pytest

from tests.envs.sensors import Compass
from warehouse_env.config import ActionType, EnvConfig, SensorSpec
from warehouse_env.maps.layouts import LAYOUTS
from warehouse_env.observation import SENSORS
from warehouse_env.work import BatterySpec, OrderSpec, ServiceSpec

CASES = [
    *itertools.product(("open",), get_args(ActionType), ("lifelong", "one_shot")),
    *itertools.product(sorted({*LAYOUTS} - {"open", "blocks"}), ("discrete",), ("lifelong",)),
]

WORKING = ("open", "orders", "batteries")
SENSING = ("open", "extra", "sensor")


def working() -> EnvConfig:
    """Robots that are served, carry out orders and charge."""
    return EnvConfig(
        layout="open", num_agents=3, max_steps=12, planner="astar", arrival="stop", service=ServiceSpec(0.3, 0.3),
        orders=OrderSpec(per_hour=36_000), battery=BatterySpec(),
    )  # fmt: skip


@pytest.fixture(params=[*CASES, WORKING, SENSING], ids="-".join)
def every_config(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> EnvConfig:
    """One configuration of each kind there is."""
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
    """Three robots on the open floor for twelve steps."""
    return EnvConfig(layout="open", num_agents=3, max_steps=12, planner="astar")
