"""Bodies other than the default, front and rear steered, on floors wide enough: they arrive, and touch no shelf."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from warehouse_env.config import ArrivalMode, EnvConfig, RobotSpec
from warehouse_env.maps.generators import blocks
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.simulator import Simulator

BODIES = {
    "large": RobotSpec(length=3.0, width=2.0, wheelbase=2.0, front_overhang=0.5),
    "large front": RobotSpec(length=3.0, width=2.0, wheelbase=2.0, front_overhang=2.5, max_steering=math.radians(50.0)),
    "small": RobotSpec(length=0.5, width=0.4, wheelbase=0.34, front_overhang=0.08),
    "small front": RobotSpec(length=0.5, width=0.4, wheelbase=0.34, front_overhang=0.42),
}


def floor_for(name: str) -> GridMap:
    """Shelves with aisles of two lengths of the body, in cells of a third of a metre or a metre."""
    wide = blocks(
        36, 36, block_rows=2, block_columns=8, aisle=6, cross=7, zone_rows=2, zone_columns=2, rim_rows=7, rim_columns=7
    )
    return wide if name.startswith("large") else dataclasses.replace(wide, cell_size=0.2)


@pytest.mark.nightly
@pytest.mark.parametrize("arrival", ["pass", "stop", "pose"])
@pytest.mark.parametrize("name", BODIES)
def test_bodies_drive_and_arrive(name: str, arrival: ArrivalMode) -> None:
    config = EnvConfig(
        num_agents=1, planner="astar_turns", arrival=arrival, robot=BODIES[name], max_steps=10**6,
        arrival_radius=0.5 if name.startswith("large") else 0.3,
    )  # fmt: skip
    simulator = Simulator(config, 8, grid=floor_for(name))
    simulator.reset(31600007)
    cruise = np.full((8, 1), simulator.cruise_action)
    for _ in range(1000):
        simulator.step(cruise)
    robots = simulator.robots
    assert robots["totals"]["hits_shelf"].sum() == 0
    assert robots["totals"]["goals"].min() >= 1
    assert robots["totals"]["goals"].mean() >= 2
