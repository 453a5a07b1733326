"""An instance as a world of the simulator: its discs as they are, its goals as poses, its robots parked for good.

Lengths are scaled so that the body is 0.9 x 0.6 m. Around the floor lies a metre more: the benchmark keeps axles on the
floor, not bodies.
"""

from __future__ import annotations

import math

import numpy as np

from train.clmapf.instance import BODY, DISC_RADIUS, Instance, Poses
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.tasks.assignment import Assignment

SCALE = 0.3  # [m] of the benchmark's unit
BORDER = 1.0  # [m] around the floor


def config_of(instance: Instance, seconds: float = 300.0) -> EnvConfig:
    """Return the config of an instance's robots, the benchmark's front-steered body, and so much time."""
    robot = RobotSpec(
        length=2 * BODY.half_length * SCALE, width=2 * BODY.half_width * SCALE, front_overhang=BODY.ahead * SCALE,
        wheelbase=SCALE, max_steering=math.atan(1.0 / BODY.radius),
    )  # fmt: skip
    return EnvConfig(
        num_agents=len(instance.names), tasks="one_shot", arrival="pose", robot=robot, planner="astar_turns",
        max_steps=round(10 * seconds),
    )  # fmt: skip


def world_of(instance: Instance, cell: float = 0.6) -> tuple[GridMap, Assignment]:
    """Return an instance's floor of cells so wide [m], and where its robots begin and are to stand.

    The simulator raises MapError for a start or goal that is on no free cell: no route of cells leads there.
    """
    rows, columns = (math.ceil((side * SCALE + 2 * BORDER) / cell) for side in (instance.height, instance.width))
    discs = np.column_stack([instance.discs * SCALE + BORDER, np.full(len(instance.discs), DISC_RADIUS * SCALE)])
    floor = GridMap(np.zeros((rows, columns), np.bool_), cell_size=cell, name=instance.name, discs=discs)
    return floor, Assignment(_scaled(instance.starts), _scaled(instance.goals))


def _scaled(poses: Poses) -> Poses:
    return np.column_stack([poses[:, :2] * SCALE + BORDER, poses[:, 2]])
