"""Goals as poses: where a robot's front axle is to stand in a goal's cell, and which way it is to face.

A pick face or a station is served from its side, so a robot stands beside it in parallel, either way round, with the
middle of its body in the middle of the cell: it drives on without a turn, lets others pass, and in an aisle of one cell
nothing else fits. Vehicles that face a shelf are forklifts, which put their forks into it; this one's load lies on its
back, and whoever hands it over stands beside it (paper 000 has no fork).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import RobotSpec
from warehouse_env.maps.fitting import HEADINGS, headings_on, stands
from warehouse_env.maps.grid_map import Cell, GridMap

Pose = tuple[float, float, float]  # front axle x [m], y [m], heading [rad], nan: any
_EAST, _NORTH, _WEST, _SOUTH = (0, 1), (-1, 0), (0, -1), (1, 0)  # (row, column)


class Goal(NamedTuple):
    """Where a robot is to arrive: in a cell, at any of some poses; none: at its centre, facing anywhere."""

    cell: Cell
    poses: tuple[Pose, ...] = ()


def facing(poses: Sequence[Pose], cells: NDArray[np.integer[Any]]) -> Pose:
    """Return which of the poses a robot faces that comes along cells int[L, 2]: of equals the first."""
    row, column = (cells[-1] - cells[max(len(cells) - 3, 0)]).tolist()
    along = [column * math.cos(heading) - row * math.sin(heading) for _, _, heading in poses]
    return poses[int(np.argmax(along))]


def face(grid: GridMap, cell: Cell, robot: RobotSpec) -> Goal:
    """Return the goal at an endpoint: in parallel to what is beside it, either way round.

    Nothing beside it, or no way on along that: at the cell's centre, facing anywhere. A body longer than a cell that
    would touch something so: with its axle at the cell's centre, at a heading at which it does not.
    """
    barred = {side: _is_barred(grid, cell, side) for side in (_EAST, _NORTH, _WEST, _SOUTH)}
    for ahead, left in ((_EAST, _NORTH), (_NORTH, _WEST)):
        beside = barred[left] or barred[(-left[0], -left[1])]
        if beside and not (barred[ahead] and barred[(-ahead[0], -ahead[1])]):
            heading = math.atan2(-ahead[0], ahead[1])
            if robot.farthest > grid.cell_size and not stands(grid, cell, robot, heading, centred=True):
                break
            return Goal(cell, tuple(_middle(grid, cell, robot, way) for way in (heading, heading - math.pi)))
    if robot.farthest <= grid.cell_size:
        return Goal(cell)
    x, y = grid.centre(np.array(cell)).tolist()
    headings = headings_on(grid, cell, robot)
    return Goal(cell, ((x, y, headings[0]),) if 0 < len(headings) < HEADINGS else ())


def _is_barred(grid: GridMap, cell: Cell, side: tuple[int, int]) -> bool:
    """Whether there is a shelf, the rim, or floor too near to them on a side of a cell."""
    row, column = cell[0] + side[0], cell[1] + side[1]
    rows, columns = grid.shape
    return not (0 <= row < rows and 0 <= column < columns) or bool(grid.closed[row, column])


def _middle(grid: GridMap, cell: Cell, robot: RobotSpec, heading: float) -> Pose:
    """Return the pose whose body has its middle in a cell's centre."""
    x, y = grid.centre(np.array(cell)).tolist()
    ahead = robot.rear_reach - robot.length / 2
    return x + ahead * math.cos(heading), y + ahead * math.sin(heading), heading
