"""Short episodes in a tight hall, where robots meet, wait and touch."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.record.recording import Episode, Recorder
from warehouse_env.simulation.simulator import Simulator

CONFIG = EnvConfig(num_agents=7, planner="astar", action_repeat=2, people=4)


def hall() -> GridMap:
    """10 x 14 cells with two blocks of shelves, an aisle between them that is one-way, and a ramp."""
    occupied = np.zeros((10, 14), dtype=np.bool_)
    occupied[3:7, 2:6] = occupied[3:7, 8:12] = True
    height = np.zeros((10, 14), dtype=np.float32)
    height[8:, 4:10] = 0.2
    one_way = np.zeros((10, 14), dtype=np.uint8)
    one_way[3:7, 6] = 2
    one_way[3:7, 7] = 4
    return GridMap(occupied, height, name="hall", one_way=one_way)


@lru_cache(maxsize=4)
def driven(steps: int = 150, front_steered: bool = False) -> Episode:
    """Two worlds of 7 robots that cruise along their routes whatever is in the way."""
    robot = RobotSpec(front_overhang=0.75) if front_steered else RobotSpec()
    simulator = Simulator(CONFIG.replace(robot=robot), 2, grid=hall())
    recorder = Recorder(simulator, (9, 4), "follow")
    for _ in range(steps):
        recorder.step(np.full((2, CONFIG.num_agents), simulator.cruise_action))
    return recorder.episode
