"""Visits of cells as routes and speeds of bodies: the path follower of the environment drives them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from train.central.grid_pibt import BACKWARDS
from train.central.orders import LENGTH, Orders, goes_straight_on
from warehouse_env.routes.lanes import resample
from warehouse_env.simulation.simulator import Simulator

SPACING = 0.25  # [m] of the way-points
REST = 0.2  # [cells] ahead of a cell's centre where a front axle stops: the body then hardly leaves the cell
REST_TO_TURN = -0.1  # [cells], the same where it may have to turn from rest: it then hardly swings out of the cell
BACK_SPEED = 0.4  # [m/s]
BRAKE_SHARE = 0.8  # of the acceleration limit that stops are planned with
_WAYS = np.array([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])  # (x, y) of headings 0..3

Line = tuple[NDArray[np.float32], float]
"""Way-points float32[R, 2] [m], and where on them the axle must stop [m]."""


def line_of(orders: Orders, robot: int, centre: NDArray[np.float64], side: float) -> Line:
    """Return the line of the visits in the present gear, from where the robot is to the last one granted."""
    at, last = int(orders.at[robot]), int(orders.granted[robot])
    move = orders.move[robot]
    gear = move[at % LENGTH] >= BACKWARDS
    while last > at and any((move[k % LENGTH] >= BACKWARDS) != gear for k in range(at + 1, last + 1)):
        last -= 1
    heading = _WAYS[move[last % LENGTH] % 4]
    goal = centre[orders.cell[robot, last % LENGTH]]
    if gear:  # a straight line along the heading, which is driven from its end towards its start
        here = centre[orders.cell[robot, at % LENGTH]]
        ends = np.stack([goal - side * heading, here + 2 * side * heading])
        return resample(ends, SPACING).astype(np.float32), (1.0 + REST) * side
    begin = at
    while begin > max(orders.first[robot], at - 2) and move[begin % LENGTH] < BACKWARDS:
        begin -= 1
    cells = [centre[orders.cell[robot, k % LENGTH]] for k in range(begin, last + 1)]
    into = _WAYS[move[begin % LENGTH] % 4]
    rest = REST if goes_straight_on(orders, robot, last) else REST_TO_TURN
    cells[-1] = cells[-1] + rest * side * heading
    points = np.stack([cells[0] - side * into, *cells])
    line = resample(rounded(points), SPACING)
    return line.astype(np.float32), float(np.hypot(*np.diff(line, axis=0).T).sum())


def rounded(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the polyline float64[L, 2] with an arc for each corner, from the middle of the shorter side there.

    On a path over neighbouring cells of side s the arcs' radius is at least s / 2, and they keep s / 2 from shelves.
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


def give_line(simulator: Simulator, world: int, robot: int, line: NDArray[np.float32]) -> None:
    """Let a robot drive along a line float32[R, 2] [m] from now on, from the point nearest to its axle."""
    r = simulator.robots[world, robot]
    nearest = int(np.argmin(np.hypot(line[:, 0] - r["x"], line[:, 1] - r["y"])))
    since_milestone, bearing = r["position"] - r["milestone"], r["bearing"]
    simulator.dispatcher.give_line(world, robot, line)
    r["position"] = nearest * r["spacing"]
    r["milestone"] = r["position"] - since_milestone
    r["bearing"] = bearing  # by which it steers backwards until it has found its place on the line


def speed_for(way: float, period: float, acceleration: float) -> float:
    """Return the speed [m/s] from which a robot can stop within `way` [m], after one more period [s] at it."""
    brake = BRAKE_SHARE * acceleration
    return -brake * period + math.sqrt((brake * period) ** 2 + 2.0 * brake * max(way, 0.0))
