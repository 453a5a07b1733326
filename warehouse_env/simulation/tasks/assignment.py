"""Robots that stand where they are told to and go where they are told to: scenes, benchmarks, a user's own tasks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError, shown
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.routes.goals import Goal


@dataclass(frozen=True, eq=False)
class Assignment:
    """The start of one world's N robots; bodies may touch nothing, and no two robots have one goal."""

    pose: NDArray[np.float64]  # [N, 3], front axle x [m], y [m], heading [rad]
    # [N, 2]: cells (row, col) if whole numbers, else points x, y [m] of the front axle; or [N, 3]: poses, whose heading
    # [rad] may be nan: any
    goal: NDArray[np.int64] | NDArray[np.float64]

    def __post_init__(self) -> None:
        pose, goal = (_table(getattr(self, name)) for name in ("pose", "goal"))
        if pose.shape[1] != 3 or not np.isfinite(pose).all():
            raise ConfigError(f"pose={shown(self.pose)} must be a table of 3 numbers a robot")
        if goal.shape[1] not in (2, 3) or not np.isfinite(goal[:, :2]).all() or np.isinf(goal).any():
            raise ConfigError(
                f"goal={shown(self.goal)} must be a table of 2 whole numbers a robot (a cell), or 2 or 3 numbers (a "
                "point, a pose)"
            )
        object.__setattr__(self, "pose", pose.astype(np.float64))
        cells = goal.shape[1] == 2 and goal.dtype.kind in "iu"
        object.__setattr__(self, "goal", goal.astype(np.int64 if cells else np.float64))
        if len(self.pose) != len(self.goal) or not len(self.pose):
            raise ConfigError(f"{len(self.pose)} poses and {len(self.goal)} goals must be one of each for every robot")
        if len(np.unique(self.goal[:, :2], axis=0)) < len(self.goal):
            raise ConfigError("two robots have the same goal; goals must be distinct")

    def goals(self, grid: GridMap) -> list[Goal]:
        """Return each robot's goal; MapError for one that is not on the floor."""
        found, cells = [], self.goal if self.goal.dtype.kind == "i" else grid.cell(self.goal[:, :2])
        for robot, (cell, (x, y, *heading)) in enumerate(zip(cells, self.goal.tolist(), strict=True)):
            free = grid.check_cell(cell, f"goal of robot {robot}")
            exact = self.goal.dtype.kind == "f"
            found.append(Goal(free, ((x, y, *(heading or [math.nan])),) if exact else ()))
        return found


def _table(given: object) -> NDArray[Any]:
    """Return an array [N, K] of numbers; [0, 0] where it is none."""
    try:
        array = np.array(given)
    except (TypeError, ValueError):
        return np.empty((0, 0))
    return array if array.ndim == 2 and array.dtype.kind in "fiu" else np.empty((0, 0))


def check_assignments(assignments: Sequence[Assignment], worlds: int, robots: int, grid: GridMap) -> None:
    """Raise ConfigError or MapError unless there is one for each world, of its robots and on its floor."""
    several = isinstance(assignments, Sequence) and len(assignments) == worlds
    if not several or not all(isinstance(one, Assignment) for one in assignments):
        raise ConfigError(f"assignments must be {worlds} of type Assignment, one for each world")
    for one in assignments:
        if len(one.pose) != robots:
            raise ConfigError(f"an assignment of {len(one.pose)} robots does not fit num_agents={robots}")
        one.goals(grid)
        for robot in range(robots):
            grid.check_cell(grid.standing(one.pose[robot, :2]), f"start of robot {robot}")
