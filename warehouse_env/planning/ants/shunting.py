"""The shunting neural network of paper 003 (SHAA): activity that spreads from the goal over the free cells.

A cell is a neuron. Its steady state is x = S / (A + S) (Grossberg 1988; for robots Yang & Meng 2000), excited by
S = I + sum of w_ij * x_j over the cells j that a move leads to, with I = E at the goal and 0 elsewhere; shelves stay at
0. With `strongest`, the largest w_ij * x_j alone excites, not the sum. Activity falls to between a third and a tenth
from cell to cell, so plain floats would end some 300 to 650 cells from the goal: a state is a mantissa with a whole
exponent of its own.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import MOVES
from warehouse_env.planning.ants.floor import AntFloor, Table

LEAST_DECAY = 4.0 + 4.0 / math.sqrt(2.0)  # the sum of the weights 1/d of 8 moves; up to it activity saturates
_TOLERANCE = 1e-3  # share by which no state changes any more in a sweep
_SWEEPS = 1_000
_NO_ACTIVITY = -(2**40)  # an exponent below all others
_FAR = 1_000  # binary places between two numbers of which the smaller does not count
_HALVED = 2.0 ** -np.arange(_FAR)  # exact


class Activity(NamedTuple):
    """x = mantissa * 2^exponent of each cell."""

    mantissa: NDArray[np.float64]  # [C], from 0.5 to below 1; 0 where no activity arrives
    exponent: NDArray[np.int64]  # [C]


@kernel
def settle(floor, weight, decay, source, strongest):
    """Return the steady state for A = `decay`, E = `source` and w_ij = `weight` float64[C, 8] of the move from i to j.

    A must exceed the sum of each cell's weights. Sweeps over the cells in the order of their moves from the goal, in
    which activity spreads, each cell from the newest states of its neighbours (Gauss-Seidel), until all is settled.
    """
    cells = floor.neighbour.shape[0]
    state = Activity(np.zeros(cells), np.full(cells, _NO_ACTIVITY, np.int64))
    order = _flood(floor)
    for _ in range(_SWEEPS):
        change = 0.0
        for k in range(len(order)):
            change = max(change, _renew(floor, weight, decay, source, strongest, state, order[k]))
        if change <= _TOLERANCE:
            break
    return state


@kernel
def _renew(floor, weight, decay, source, strongest, state, cell):
    """Set a cell to S / (A + S) and return by what share it changed."""
    mantissa, exponent = state
    at_goal = cell == floor.goal
    top = 0 if at_goal else _NO_ACTIVITY
    for move in range(8):
        to = floor.neighbour[cell, move]
        if to != cell and exponent[to] > top:
            top = exponent[to]
    excited = source if at_goal else 0.0  # S / 2^top
    for move in range(8):
        to = floor.neighbour[cell, move]
        if to != cell and exponent[to] > top - _FAR:
            arriving = weight[cell, move] * mantissa[to] * _HALVED[top - exponent[to]]
            excited = max(excited, arriving) if strongest else excited + arriving
    saturation = math.ldexp(excited, int(top)) if top > -_FAR else 0.0
    new = excited / (decay + saturation)
    fraction, shift = math.frexp(new)
    change = 1.0
    if exponent[cell] != _NO_ACTIVITY and abs(exponent[cell] - top - shift) <= 1:
        change = abs(math.ldexp(mantissa[cell], int(exponent[cell] - top)) / new - 1.0)
    mantissa[cell], exponent[cell] = fraction, top + shift
    return change


@kernel
def _flood(floor):
    """Cells int64[R] from which moves lead to the goal, in the order of their number."""
    rows, columns = floor.neighbour.shape[0] // floor.columns, floor.columns
    cells = floor.neighbour.shape[0]
    order, known = np.empty(cells, np.int64), np.zeros(cells, np.bool_)
    order[0], size, at = floor.goal, 1, 0
    known[floor.goal] = True
    while at < size:
        for move in range(8):
            row, column = order[at] // columns + MOVES[move, 0], order[at] % columns + MOVES[move, 1]
            to = row * columns + column
            inside = 0 <= row < rows and 0 <= column < columns
            if inside and floor.legal[to, (move + 4) % 8] and not known[to]:
                known[to] = True
                order[size] = to
                size += 1
        at += 1
    return order[:size]


def rise(floor: AntFloor, activity: Activity) -> Table:
    """Return float64[C, 8], x_j / x_i of the move from i to j; 1 on cells that no activity reaches."""
    mantissa, exponent = activity
    silent = mantissa == 0.0
    fraction = mantissa[floor.neighbour] / np.where(silent, 1.0, mantissa)[:, None]
    shift = np.where(silent[:, None], 0, exponent[floor.neighbour] - exponent[:, None])
    return np.where(silent[:, None], 1.0, np.ldexp(fraction, shift.clip(-_FAR, _FAR).astype(np.int32)))
