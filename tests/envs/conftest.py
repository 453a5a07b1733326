"""Small configurations: every layout, action type and task mode, few robots, few steps, the fastest planner."""

from __future__ import annotations

import itertools
from typing import get_args

import pytest

from warehouse_env.config import ActionType, EnvConfig, TaskMode
from warehouse_env.maps.layouts import LAYOUTS
from warehouse_env.work import BatterySpec, OrderSpec, ServiceSpec

CASES = [
    *itertools.product(("open",), get_args(ActionType), get_args(TaskMode)),
    *itertools.product(sorted({*LAYOUTS} - {"open", "blocks"}), ("discrete",), ("lifelong",)),
]

WORKING = ("open", "orders", "batteries")


def working() -> EnvConfig:
    """Robots that are served, carry out orders and charge."""
    return EnvConfig(
        layout="open", num_agents=3, max_steps=12, planner="astar", arrival="stop", service=ServiceSpec(0.3, 0.3),
        orders=OrderSpec(per_hour=36_000), battery=BatterySpec(),
    )  # fmt: skip


@pytest.fixture(params=[*CASES, WORKING], ids=["-".join(case) for case in [*CASES, WORKING]])
def every_config(request: pytest.FixtureRequest) -> EnvConfig:
    """One configuration of each kind there is."""
    if request.param == WORKING:
        return working()
    layout, action_type, tasks = request.param
    return EnvConfig(layout=layout, action_type=action_type, tasks=tasks, num_agents=3, max_steps=12, planner="astar")


@pytest.fixture
def tiny() -> EnvConfig:
    """Three robots on the open floor for twelve steps."""
    return EnvConfig(layout="open", num_agents=3, max_steps=12, planner="astar")
