"""The order of visits at every cell: a robot enters a cell after all visits that the plan ranks before are over.

Source: Hoenig, Kiesel, Tinka, Durham, Ayanian 2019, "Persistent and robust execution of MAPF schedules in warehouses"
(action dependency graph). Adapted: each visit has a rank and each cell a count of visits that are over, instead of
edges; a visit is over when the body has left the cell.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.central.grid_pibt import BACKWARDS
from warehouse_env.kernel import kernel
from warehouse_env.simulation.physics.geometry import Rectangle, rectangles_touch

LENGTH = 64  # visits of a robot kept, in a ring
REACHED = 0.6  # [cells] from a cell's centre to the axle, within which a robot may shift gears there
SLACK = 0.1  # [m] that a body may reach into a cell after leaving it


class CentralOrders(NamedTuple):
    """All visits of one world's robots. Visit k of robot i stands at [i, k % LENGTH]."""

    cell: NDArray[np.int64]  # [N, LENGTH], row * columns + column
    move: NDArray[np.int64]  # [N, LENGTH], see pibt_step
    rank: NDArray[np.int64]  # [N, LENGTH], visits of the cell that come before, by any robot
    first: NDArray[np.int64]  # [N], the earliest visit that the body has not left
    at: NDArray[np.int64]  # [N], the visit where the front axle is
    granted: NDArray[np.int64]  # [N], the last visit that may be entered now
    end: NDArray[np.int64]  # [N], visits planned in all
    planned: NDArray[np.int64]  # [H * W], visits planned of a cell
    done: NDArray[np.int64]  # [H * W], visits over

    @classmethod
    def of(cls, cell: NDArray[np.int64], heading: NDArray[np.int64], size: int) -> CentralOrders:
        """Return the orders of robots that stand at distinct cells int64[N] of `size`."""
        n = len(cell)
        table = [np.zeros((n, LENGTH), np.int64) for _ in range(3)]
        orders = cls(*table, *(np.zeros(n, np.int64) for _ in range(4)), *(np.zeros(size, np.int64) for _ in range(2)))
        append(orders, cell, heading, np.ones(n, np.bool_))
        return orders


@kernel
def append(orders, cell, move, moves):
    """Add a visit of `cell` int64[N] by `move` int64[N] for the robots that move, bool[N]."""
    for i in range(cell.size):
        if moves[i]:
            k = orders.end[i] % LENGTH
            orders.cell[i, k], orders.move[i, k] = cell[i], move[i]
            orders.rank[i, k] = orders.planned[cell[i]]
            orders.planned[cell[i]] += 1
            orders.end[i] += 1


@kernel
def _may_enter(orders, i, visit):
    """Return whether all visits ranked before are over or the robot's own."""
    k = visit % LENGTH
    waiting = orders.rank[i, k] - orders.done[orders.cell[i, k]]
    for other in range(orders.first[i], visit):
        if orders.cell[i, other % LENGTH] == orders.cell[i, k]:
            waiting -= 1
    return waiting == 0


@kernel
def goes_straight_on(orders, i, visit):
    """Return whether the plan has a next visit in the same direction and gear."""
    return visit + 1 < orders.end[i] and orders.move[i, visit % LENGTH] == orders.move[i, (visit + 1) % LENGTH]


@kernel
def _end_of_turn(orders, i, visit):
    """Return the first visit from this one on at which a body can wait: one without a turn."""
    while visit + 1 < orders.end[i] and not goes_straight_on(orders, i, visit):
        visit += 1
    return visit


@kernel
def advance(orders, axle, heading, centre, body, look):
    """Update which visits have begun and which are over, and grant the next ones, at most `look` ahead of the axle.

    axle float64[N, 2] [m]; heading float64[N] [rad]; centre float64[H * W, 2] [m], of the cells; body: half length,
    half width and metres from the axle back to its centre.
    """
    side = abs(centre[1, 0] - centre[0, 0])
    for i in range(heading.size):
        c, s = np.cos(heading[i]), np.sin(heading[i])
        while orders.at[i] < orders.granted[i]:
            now, following = orders.at[i] % LENGTH, (orders.at[i] + 1) % LENGTH
            here, there = centre[orders.cell[i, now]], centre[orders.cell[i, following]]
            if (orders.move[i, now] >= BACKWARDS) != (orders.move[i, following] >= BACKWARDS):  # stop, then shift
                begun = np.hypot(axle[i, 0] - here[0], axle[i, 1] - here[1]) < REACHED * side
            else:
                ahead = np.hypot(axle[i, 0] - there[0], axle[i, 1] - there[1])
                begun = ahead < np.hypot(axle[i, 0] - here[0], axle[i, 1] - here[1])
            if not begun:
                break
            orders.at[i] += 1
        x, y = axle[i, 0] - body[2] * c, axle[i, 1] - body[2] * s
        while orders.first[i] < orders.at[i]:
            cell = orders.cell[i, orders.first[i] % LENGTH]
            again = False
            for visit in range(orders.first[i] + 1, orders.at[i] + 1):
                again |= orders.cell[i, visit % LENGTH] == cell
            q = centre[cell]
            half = 0.5 * side - SLACK
            square = Rectangle(q[0], q[1], 1.0, 0.0, half, half)
            if not again and rectangles_touch(Rectangle(x, y, c, s, body[0], body[1]), square):
                break
            orders.done[cell] += 1
            orders.first[i] += 1
    _grant(orders, look)


@kernel
def _grant(orders, look):
    """Grant each robot the next visits that may be entered, at most `look` ahead of its axle."""
    for i in range(orders.end.size):
        most = min(orders.end[i], orders.at[i] + look + 1)
        while orders.granted[i] + 1 < most:
            last = _end_of_turn(orders, i, orders.granted[i] + 1)
            for visit in range(orders.granted[i] + 1, last + 1):
                if not _may_enter(orders, i, visit):
                    last = -1
                    break
            if last < 0:
                break
            orders.granted[i] = last


@kernel
def forget_future(orders):
    """Drop all visits that are not granted, so that planning restarts from the poses of the bodies."""
    orders.planned[:] = 0
    orders.done[:] = 0
    for i in range(orders.end.size):
        orders.end[i] = orders.granted[i] + 1
        for visit in range(orders.first[i], orders.end[i]):
            k = visit % LENGTH
            orders.rank[i, k] = orders.planned[orders.cell[i, k]]
            orders.planned[orders.cell[i, k]] += 1
