"""Plans of grid planners: a cell for each robot at each step, checked. read.py reads them from files."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import PlanError, counted, shown
from warehouse_env.maps.grid_map import Cell, GridMap

_MOST = 10_000, 1_000_000  # robots, and steps


class GridPlan(NamedTuple):
    """A plan of N robots over T steps."""

    cells: NDArray[np.int64]  # [T + 1, N, 2], (row, column)
    tasks: tuple[tuple[int, ...], ...]  # steps after which each robot has finished a task
    ticks: int = 1  # steps in which a robot that drives reaches the next cell

    @property
    def makespan(self) -> int:
        """The step after which no robot moves any more."""
        moving = np.flatnonzero((self.cells != self.cells[-1]).any(axis=(1, 2)))
        return int(moving[-1]) + 1 if len(moving) else 0


def path_of(cells: NDArray[np.int64]) -> tuple[list[Cell], list[int]]:
    """Return the cells of a robot's plan int[T + 1, 2] without its waits, and the step after which it is at each."""
    moved = np.flatnonzero((np.diff(cells, axis=0) != 0).any(axis=1)) + 1
    steps = [0, *moved.tolist()]
    return [(row, column) for row, column in cells[steps].tolist()], steps


def finished(cells: NDArray[np.int64]) -> GridPlan:
    """Return the plan of one task for each robot, at its last cell."""
    robots = range(cells.shape[1])
    return GridPlan(cells, tuple((path_of(cells[:, i])[1][-1],) for i in robots))


def check_plan(cells: NDArray[np.int64], grid: GridMap) -> None:
    """Raise PlanError unless robots move to free cells beside theirs, and no two share or swap cells."""
    steps, robots = len(cells) - 1, cells.shape[1]
    if not 1 <= robots <= _MOST[0] or steps > _MOST[1]:
        raise PlanError(f"{counted(robots, 'robot')} over {steps:,} steps; at most {_MOST[0]:,} over {_MOST[1]:,}")
    inside = np.asarray(((cells >= 0) & (cells < grid.shape)).all(axis=2))
    closed = grid.closed[tuple(np.where(inside[..., None], cells, 0).transpose(2, 0, 1))]
    for step, robot in np.argwhere(np.logical_or(~inside, closed))[:1].tolist():
        raise PlanError(f"step {step}: robot {robot} is at {_at(cells, step, robot)}, which is no free cell")
    for step, robot in np.argwhere(np.abs(np.diff(cells, axis=0)).sum(axis=2) > 1)[:1].tolist():
        moved = f"from {_at(cells, step, robot)} to {_at(cells, step + 1, robot)}"
        raise PlanError(f"step {step + 1}: robot {robot} moves {moved}, which is not beside it")
    places = cells[..., 0] * grid.shape[1] + cells[..., 1]
    for step, now in enumerate(places):
        where = {place: robot for robot, place in reversed(list(enumerate(now.tolist())))}
        if len(where) < robots:
            robot = next(robot for robot, place in enumerate(now.tolist()) if where[place] != robot)
            other = where[int(now[robot])]
            raise PlanError(f"step {step}: robots {other} and {robot} are both at {_at(cells, step, robot)}")
        if step == 0:
            continue
        for robot in np.flatnonzero(places[step - 1] != now).tolist():
            other = where.get(int(places[step - 1, robot]))
            if other is not None and other != robot and places[step - 1, other] == now[robot]:
                raise PlanError(f"step {step}: robots {robot} and {other} swap cells")


def _at(cells: NDArray[np.int64], step: int, robot: int) -> str:
    return shown(tuple(cells[step, robot].tolist()))
