"""Kernels find every slice that they write where the layout says that it is."""

from __future__ import annotations

import pytest

from warehouse_env.config import EnvConfig, SensorSpec
from warehouse_env.observation import observation_layout
from warehouse_env.work import BatterySpec

ALL = EnvConfig(sensor=SensorSpec(predictions=True), traffic="shield", arrival="stop", battery=BatterySpec())
BY_OTHERS = {"lidar", "needs"}  # begins at 0; is written by shifts


@pytest.mark.parametrize("config", [EnvConfig(), EnvConfig(traffic="shield"), EnvConfig(arrival="pose"), ALL])
def test_kernels_are_told_where_slices_start(config: EnvConfig) -> None:
    layout = observation_layout(config)
    told = {name: start for name, start in layout.starts._asdict().items() if start is not None}
    assert told == {name: part.start for name, part in layout.slices.items() if name not in BY_OTHERS}


def test_slices_follow_each_other() -> None:
    layout, end = observation_layout(ALL), 0
    for part in layout.slices.values():
        assert part.start == end
        end = part.stop
    assert end == layout.size
