"""Robots that stand where they are told to and go where they are told to: scenes, benchmarks, a user's own tasks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError, shown
from warehouse_env.maps.grid_map import GridMap


@dataclass(frozen=True, eq=False)
class Assignment:
    """The start of one world's N robots; bodies may touch nothing, and no two robots have one goal."""

    pose: NDArray[np.float64]  # [N, 3], front axle x [m], y [m], heading [rad]
    goal: NDArray[np.int64]  # [N, 2], cells (row, col)

    def __post_init__(self) -> None:
        for name, kind, width in (("pose", "fiu", 3), ("goal", "iu", 2)):
            try:
                array = np.array(getattr(self, name))
            except (TypeError, ValueError):
                array = np.empty(0)
            numbers = array.ndim == 2 and array.shape[1] == width and array.dtype.kind in kind
            if not numbers or not np.isfinite(array).all():
                raise ConfigError(f"{name}={shown(getattr(self, name))} must be a table of {width} numbers a robot")
            object.__setattr__(self, name, array.astype(np.float64 if width == 3 else np.int64))
        if len(self.pose) != len(self.goal) or not len(self.pose):
            raise ConfigError(f"{len(self.pose)} poses and {len(self.goal)} goals must be one of each for every robot")
        if len(np.unique(self.goal, axis=0)) < len(self.goal):
            raise ConfigError("two robots have the same goal; goals must be distinct")


def check_assignments(assignments: Sequence[Assignment], worlds: int, robots: int, grid: GridMap) -> None:
    """Raise ConfigError or MapError unless there is one for each world, of its robots and on its floor."""
    several = isinstance(assignments, Sequence) and len(assignments) == worlds
    if not several or not all(isinstance(one, Assignment) for one in assignments):
        raise ConfigError(f"assignments must be {worlds} of type Assignment, one for each world")
    for one in assignments:
        if len(one.pose) != robots:
            raise ConfigError(f"an assignment of {len(one.pose)} robots does not fit num_agents={robots}")
        for robot in range(robots):
            grid.check_cell(one.goal[robot], f"goal of robot {robot}")
            grid.check_cell(grid.cell(one.pose[robot, :2]), f"start of robot {robot}")
