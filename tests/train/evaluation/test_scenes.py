"""Scenes fit their floors at every seed."""

from __future__ import annotations

import numpy as np
import pytest

from train.evaluation.scenes import SCENES
from warehouse_env.config import EnvConfig
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.well_formed import cut_off, disc_of

BASE = EnvConfig(planner="astar", tasks="one_shot")


@pytest.mark.parametrize("name", sorted(SCENES))
def test_scenes_are_well_formed_and_touch_nothing(name: str) -> None:
    scene = SCENES[name]()
    simulator = Simulator(BASE.replace(num_agents=scene.robots), 10, grid=scene.grid)
    drawn = [scene.draw(np.random.default_rng(seed)) for seed in range(10)]
    simulator.reset_to(drawn, seed=0)  # raises where something touches
    assert not np.array_equal(drawn[0].pose, drawn[1].pose)
    for one in drawn:
        starts = scene.grid.cell(one.pose[:, :2])
        if name.startswith("swap"):  # a start is another's goal, so all that can be asked is the way from the middle
            starts = np.broadcast_to(np.array(scene.grid.shape) // 2, starts.shape)
        assert not cut_off(scene.grid, starts, one.goal, disc_of(BASE, scene.grid.cell_size)).any()
