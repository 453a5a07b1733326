"""The slices of an observation that options add are each written where the layout has them, whatever else is on."""

from __future__ import annotations

import numpy as np
import pytest

from warehouse_env import BatterySpec, EnvConfig, ServiceSpec, Simulator, TrafficSpec
from warehouse_env.simulation.state import OWNER, field_of

WITH = {"layout": "open", "num_agents": 3, "planner": "astar", "arrival": "stop", "action_repeat": 2}


@pytest.mark.parametrize("shield", [False, pytest.param(True, marks=pytest.mark.nightly)])
def test_goals_and_fields_are_seen_alike_with_and_without_needs(shield: bool) -> None:
    config = EnvConfig(**WITH, traffic=TrafficSpec(shield=shield))  # type: ignore[arg-type]
    without = Simulator(config)
    served = Simulator(config.replace(service=ServiceSpec(1.0, 1.0), battery=BatterySpec()))
    without.reset(3)
    served.reset(3)
    served.routes[...] = without.routes
    for name in OWNER:
        field_of(served.robots, name)[...] = field_of(without.robots, name)
    served._observe()
    without._observe()
    assert np.isfinite(served.observation).all()
    for name, own in without.layout.slices.items():
        np.testing.assert_array_equal(
            served.observation[..., served.layout.slices[name]], without.observation[..., own], name
        )
