"""Goals as poses: the front axle's position in a goal's cell, and the heading.

A pick face or a station is served from the side. The robot stands parallel to it, with either heading, and the middle
of its body is in the middle of the cell. It drives on without a turn, others can pass, and in an aisle of one cell
nothing else fits. Only forklifts face a shelf; this robot carries its load on its back (paper 000 has no fork).
"""

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
    """A goal: a cell, and the poses that count; without poses its centre at any heading."""

    cell: Cell
    poses: tuple[Pose, ...] = ()


def facing(poses: Sequence[Pose], cells: NDArray[np.integer[Any]]) -> Pose:
    """Return the pose that faces along the end of a path int[L, 2]; of equals the first."""
    row, column = (cells[-1] - cells[max(len(cells) - 3, 0)]).tolist()
    along = [column * math.cos(heading) - row * math.sin(heading) for _, _, heading in poses]
    return poses[int(np.argmax(along))]


def face(grid: GridMap, cell: Cell, robot: RobotSpec) -> Goal:
    """Return the goal at an endpoint: parallel to the obstacle beside it, with either heading.

    Without an obstacle, or with a dead end along it, the goal is the cell's centre at any heading. A body longer than a
    cell that would touch something stands with its axle at the centre, at a free heading.
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
    """Whether a side of a cell is a shelf, the rim, or tight floor."""
    row, column = cell[0] + side[0], cell[1] + side[1]
    rows, columns = grid.shape
    return not (0 <= row < rows and 0 <= column < columns) or bool(grid.closed[row, column])


def _middle(grid: GridMap, cell: Cell, robot: RobotSpec, heading: float) -> Pose:
    """Return the pose that puts the body's middle in a cell's centre."""
    x, y = grid.centre(np.array(cell)).tolist()
    ahead = robot.rear_reach - robot.length / 2
    return x + ahead * math.cos(heading), y + ahead * math.sin(heading), heading
