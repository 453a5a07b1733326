"""Given starts and goals, for scenes, benchmarks and a user's own tasks."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.routes.goals import Goal
from warehouse_env.simulation.physics.poses import numbers, poses, within_a_turn

_GOALS = "a table of 2 whole numbers a robot (a cell), or 2 or 3 finite numbers (a point, a pose)"


@dataclass(frozen=True, eq=False)
class Assignment:
    """The start of one world's N robots; bodies may touch nothing, and no two robots have one goal."""

    pose: NDArray[np.float64]  # [N, 3], front axle x [m], y [m], heading [rad]
    # [N, 2]: cells (row, col) if whole numbers, else points x, y [m] of the front axle; or [N, 3]: poses, whose heading
    # [rad] may be nan: any
    goal: NDArray[np.int64] | NDArray[np.float64]

    def __post_init__(self) -> None:
        pose = numbers("pose", self.pose, (-1, 3), rule="a table of 3 finite numbers a robot")
        goal = numbers("goal", self.goal, (-1, 2), (-1, 3), rule=_GOALS, nan=True)
        cells = goal.shape[1] == 2 and (given := np.asarray(self.goal)).dtype.kind in "iu"
        for table in (pose, goal):
            table[:, 2:] = within_a_turn(table[:, 2:])
        object.__setattr__(self, "pose", pose)
        object.__setattr__(self, "goal", given.astype(np.int64) if cells else goal)
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


def check_assignments(assignments: Sequence[Assignment], worlds: int, robots: int, grid: GridMap) -> None:
    """Raise ConfigError or MapError unless there is one for each world, of its robots and on its floor."""
    several = isinstance(assignments, Sequence) and len(assignments) == worlds
    if not several or not all(isinstance(one, Assignment) for one in assignments):
        raise ConfigError(f"assignments must be {worlds} of type Assignment, one for each world")
    for one in assignments:
        if len(one.pose) != robots:
            raise ConfigError(f"an assignment of {len(one.pose)} robots does not fit num_agents={robots}")
        one.goals(grid)
        poses("pose", one.pose, (robots, 3), grid)
