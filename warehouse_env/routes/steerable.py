"""Lines that a rear-steer robot can drive: of bounded curvature, and off the shelves by the body's width throughout.

The pose is the centre of the fixed front axle, and the axle moves along the heading. The rear wheels, a wheelbase L
behind, at the steering angle d, turn the body by w = -v tan(d) / L, so the axle's path bends by |w / v| = tan|d| / L:
2.89/m at most (a radius of 0.35 m) for 60 degrees and 0.6 m. Lines ask for no more than STEERING_SHARE of the steering
angle (51 degrees, 2.06/m, 0.49 m), which leaves the follower 9 degrees to come back onto the line.

The objective is eq. 13 of paper 004 with squared norms (planning/smoothing.py), x(i) being the way-points in their
lane, and a third term against bending: what is least in length alone bends sharply wherever it touches a clearance.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import RobotSpec
from warehouse_env.kernel import kernel
from warehouse_env.maps.clearance import distance, nearest_shelf, segment_gap
from warehouse_env.maps.grid_map import MOVES, GridMap
from warehouse_env.routes.lanes import resample

STEERING_SHARE = 0.85  # of the steering limit
STEP = 0.25  # [m] between way-points
MARGIN = 0.05  # [m] from the body's sides to shelves, kept by whole segments
ROOMS = (0.45, 0.42, 0.38)  # [m] to shelves that way-points ask for, in turn, until the line bends within its bound
LEFT = 0.02  # [m] of half a cell that is not asked for as room
DEVIATION, LENGTH, STIFFNESS = 0.03, 0.5, 1.0  # lambda, mu of eq. 13 and the weight of bending, per way-point
SWEEPS = 80  # of the objective with its bounds, and then
REPAIRS = 40  # of the bounds alone
INSIDE = 0.95  # of the bound of curvature during the sweeps: spacing the points evenly again bends some more
_MOVE = {(d_row, d_column): move for move, (d_row, d_column) in enumerate(MOVES.tolist())}
ROUNDING = 1e-6  # [m], [1/m] of comparisons


def most_curvature(robot: RobotSpec) -> float:
    """Return the bound [1/m] of a line's curvature for a robot: tan(share of the steering limit) / wheelbase."""
    return math.tan(STEERING_SHARE * robot.max_steering) / robot.wheelbase


@kernel
def _bend(line, k):
    """Return the curvature at way-point k: of the circle through it and its neighbours."""
    ax, ay = line[k, 0] - line[k - 1, 0], line[k, 1] - line[k - 1, 1]
    bx, by = line[k + 1, 0] - line[k, 0], line[k + 1, 1] - line[k, 1]
    cx, cy = ax + bx, ay + by
    sides = math.sqrt((ax * ax + ay * ay) * (bx * bx + by * by) * (cx * cx + cy * cy))
    return 2.0 * abs(ax * by - ay * bx) / sides if sides > 0.0 else math.inf


@kernel
def sharpest(line):
    """Return the largest curvature [1/m] of a line float64[K, 2] [m], by circles through three way-points each."""
    most = 0.0
    for k in range(1, line.shape[0] - 1):
        most = max(most, _bend(line, k))
    return most


@kernel
def narrowest(line, solid, cell, reach):
    """Return the least distance [m] of a line's segments from shelves and rim, at most `reach`."""
    least = reach
    for k in range(line.shape[0] - 1):
        least = segment_gap(solid, line[k, 0], line[k, 1], line[k + 1, 0], line[k + 1, 1], cell, least)
    return least


@kernel
def _best_place(line, target, k):
    """Return where way-point k makes the objective least while the others stand still."""
    x = DEVIATION * target[k, 0] + LENGTH * (line[k - 1, 0] + line[k + 1, 0])
    y = DEVIATION * target[k, 1] + LENGTH * (line[k - 1, 1] + line[k + 1, 1])
    scale = DEVIATION + 2.0 * LENGTH
    if 2 <= k < line.shape[0] - 2:
        x += STIFFNESS * (4.0 * (line[k - 1, 0] + line[k + 1, 0]) - line[k - 2, 0] - line[k + 2, 0])
        y += STIFFNESS * (4.0 * (line[k - 1, 1] + line[k + 1, 1]) - line[k - 2, 1] - line[k + 2, 1])
        scale += 6.0 * STIFFNESS
    return x / scale, y / scale


@kernel
def _relax(line, target, solid, cell, room, bend):
    """Move the inner way-points in place: to the objective's least, within the curvature, and off the shelves."""
    n = line.shape[0]
    length = 0.0
    for k in range(n - 1):
        length += distance(line[k, 0], line[k, 1], line[k + 1, 0], line[k + 1, 1])
    spacing = length / (n - 1)
    most = 0.5 * bend * spacing * spacing  # from the neighbours' middle, at this curvature
    for sweep in range(SWEEPS + REPAIRS):
        for k in range(1, n - 1):
            x, y = _best_place(line, target, k) if sweep < SWEEPS else (line[k, 0], line[k, 1])
            middle_x = 0.5 * (line[k - 1, 0] + line[k + 1, 0])
            middle_y = 0.5 * (line[k - 1, 1] + line[k + 1, 1])
            off = distance(x, y, middle_x, middle_y)
            if off > most:
                x, y = middle_x + (x - middle_x) * most / off, middle_y + (y - middle_y) * most / off
            gap, away_x, away_y = nearest_shelf(solid, x, y, cell, room)
            if gap < room:
                x, y = x + (room - gap) * away_x, y + (room - gap) * away_y
            line[k, 0], line[k, 1] = x, y


def without_knees(cells: NDArray[np.int64], grid: GridMap) -> NDArray[np.int64]:
    """Return the path int[L, 2] without the cells that a single move of eq. 26 can skip.

    What is left turns by 45 degrees, or by 90 round a shelf or from diagonal to diagonal: no turn is sharper.
    """
    kept: list[list[int]] = []
    for row, column in cells.tolist():
        while len(kept) >= 2:
            d_row, d_column = row - kept[-2][0], column - kept[-2][1]
            if max(abs(d_row), abs(d_column)) > 1:
                break
            if (d_row or d_column) and not grid.legal_moves[(*kept[-2], _MOVE[d_row, d_column])]:
                break
            kept.pop()
        if not kept or kept[-1] != [row, column]:
            kept.append([row, column])
    return np.array(kept, dtype=np.int64).reshape(-1, 2)


def rounded(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the polyline float64[L, 2] with an arc for each corner, from the middle of the shorter side there.

    On a path without knees over cells of side s the arcs' radius is at least s / 2, and they keep s / 2 from shelves.
    """
    pieces = [points[:1]]
    for before, corner, after in zip(points[:-2], points[1:-1], points[2:], strict=True):
        one, two = before - corner, after - corner
        reach = 0.5 * min(math.hypot(*one), math.hypot(*two))
        one, two = one / math.hypot(*one), two / math.hypot(*two)
        turn = math.pi - math.acos(min(max(float(one @ two), -1.0), 1.0))
        if turn < 1e-6:
            continue
        middle = (one + two) / math.hypot(*(one + two))
        centre = corner + middle * reach / math.sin(0.5 * turn)
        radius = reach / math.tan(0.5 * turn)
        along = (two - one) / math.hypot(*(two - one))
        angles = np.linspace(-0.5 * turn, 0.5 * turn, max(math.ceil(turn / 0.05), 2))[:, None]
        pieces.append(centre + radius * (np.sin(angles) * along - np.cos(angles) * middle))
    return np.concatenate([*pieces, points[-1:]])


def steerable_line(
    lane: NDArray[np.float32], cells: NDArray[np.int64], grid: GridMap, solid: NDArray[np.uint8], robot: RobotSpec
) -> NDArray[np.float32]:
    """Return way-points float32[R, 2] [m], about STEP apart, with the lane's ends, that the robot can drive.

    lane: float32[K, 2] [m], the way-points of `drivable_line`; cells: int64[L, 2], the planned path; solid: uint8
    [H + 2, W + 2], padded shelves, y up. The line's curvature is at most `most_curvature(robot)`, and its segments keep
    half the robot's width + MARGIN from shelves, on any map whose cells are as wide as twice the least radius and as
    the body with its margins (1 m for the default robot): where the lane cannot be made so, the path of cells with
    rounded corners is taken (1 in 200 routes of the layouts). On smaller cells nothing is promised.
    """
    if len(lane) < 3:
        return lane
    cell, bend, width = grid.cell_size, most_curvature(robot), 0.5 * robot.width + MARGIN
    target = resample(lane.astype(np.float64), STEP)
    for room in ROOMS:
        line = target.copy()
        _relax(line, target, solid, cell, max(min(room, 0.5 * cell - LEFT), width), INSIDE * bend)
        line = resample(line, STEP)
        if sharpest(line) <= bend + ROUNDING and narrowest(line, solid, cell, width) >= width - ROUNDING:
            break
    else:
        line = resample(rounded(grid.centre(without_knees(cells, grid))), STEP)
    drivable: NDArray[np.float32] = line.astype(np.float32)
    return drivable
