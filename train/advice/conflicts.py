"""Conflicts between the routes of robots that repeat them, each at a random time.

Two routes share a stretch where both visit the same cells one after another, in the same or in the opposite order
(paper 001, section 2.3, tells node from opposing conflicts so). All robots drive at one cell a unit of time, and a
robot keeps others off a cell for HOLD units around its arrival there:

- a crossing: routes that share a single cell, or merge into the same direction, or change over between the centres of
  four cells on two diagonals. They conflict if they arrive within HOLD of each other. Driving behind each other after
  that is no conflict.
- an opposing conflict: a shared stretch of length l > 0 in opposite directions. They conflict if they enter its two
  ends within l + HOLD of each other.

A place with a window w counts w/T_i + w/T_j, T the routes' durations: conflicts while each robot drives its route once,
in the mean of both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError
from warehouse_env.kernel import kernel

Route = NDArray[np.int64]  # [L, 2] cells (row, col)

HOLD = 1.0  # [cells of driving] a robot of 0.9 m occupies a cell of 1 m for about as long as it takes to cross it

_SQRT2 = math.sqrt(2.0)


class Conflicts(NamedTuple):
    """Totals over all pairs of a set of routes."""

    crossings: float
    opposing: float

    @property
    def all(self) -> float:
        """Both kinds together."""
        return self.crossings + self.opposing


class Flat(NamedTuple):
    """Routes end to end, for the kernels."""

    cell: NDArray[np.int64]  # [S] row * columns + column
    at: NDArray[np.float64]  # [S] arrival, in cells driven
    first: NDArray[np.int64]  # [N + 1], where each route begins
    columns: int


def flatten(routes: Sequence[Route], columns: int) -> Flat:
    """Put routes int64[L, 2], one or more cells each, end to end."""
    lengths = [len(route) for route in routes]
    if not all(lengths):
        raise ConfigError("a route without cells has no traffic; leave out tasks for which no path was found")
    cells = np.concatenate([np.empty((0, 2), np.int64), *routes])
    first = np.zeros(len(routes) + 1, np.int64)
    np.cumsum(lengths, out=first[1:])
    flat = Flat(cells[:, 0] * columns + cells[:, 1], np.zeros(len(cells)), first, columns)
    _arrive(flat)
    return flat


@kernel
def _arrive(flat):
    """Fill the arrivals. Steps are counted apart and added once, so that equal lengths are equal numbers."""
    for i in range(len(flat.first) - 1):
        straight = diagonal = 0
        for k in range(flat.first[i] + 1, flat.first[i + 1]):
            cell, before = flat.cell[k], flat.cell[k - 1]
            along = cell // flat.columns == before // flat.columns or cell % flat.columns == before % flat.columns
            straight += 1 if along else 0
            diagonal += 0 if along else 1
            flat.at[k] = straight + diagonal * _SQRT2


def durations(flat: Flat) -> NDArray[np.float64]:
    """Return float64[N], the time [cells] that each route takes, at least 1."""
    return np.maximum(flat.at[flat.first[1:] - 1] - flat.at[flat.first[:-1]], 1.0)


def conflict_table(routes: Sequence[Route], shape: tuple[int, int]) -> NDArray[np.float64]:
    """Return float64[N, N, 2]: (crossings, opposing conflicts) of each pair of routes, symmetric, 0 on the diagonal.

    A route visits no cell twice. ConfigError for a route without cells.
    """
    flat = flatten(routes, shape[1])
    table = np.zeros((len(routes), len(routes), 2))
    _pairs(flat, durations(flat), shape[0] * shape[1], table)
    return table


def conflicts(routes: Sequence[Route], shape: tuple[int, int]) -> Conflicts:
    """Return the crossings and opposing conflicts between all pairs of routes (see the module)."""
    crossings, opposing = conflict_table(routes, shape).sum(axis=(0, 1)) / 2
    return Conflicts(float(crossings), float(opposing))


@kernel
def _pairs(flat, duration, cells, table):
    """Fill the upper and the lower half of the table."""
    place = np.full(cells, -1, np.int64)  # index of a cell in route i
    for i in range(len(duration)):
        for k in range(flat.first[i], flat.first[i + 1]):
            place[flat.cell[k]] = k
        for j in range(i):
            rate = 1.0 / duration[i] + 1.0 / duration[j]
            table[i, j] = table[j, i] = _meet(flat, place, flat.first[j], flat.first[j + 1], rate)
        for k in range(flat.first[i], flat.first[i + 1]):
            place[flat.cell[k]] = -1


@kernel
def _meet(flat, place, first, end, rate):
    """Crossings and opposing conflicts, float64[2], of the route first..end-1 with the one that `place` holds."""
    found = np.zeros(2)
    last = first - 1  # of the stretch at hand
    for k in range(first, end):
        mine = place[flat.cell[k]]
        if mine >= 0 and k > last:
            last, step = _stretch(flat, place, k, end)
            if step < 0:
                found[1] += (flat.at[last] - flat.at[k] + HOLD) * rate
            else:
                found[0] += HOLD * rate
        if k + 1 < end and _change_over(flat, place, flat.cell[k], flat.cell[k + 1]):
            found[0] += HOLD * rate
    return found


@kernel
def _stretch(flat, place, k, end):
    """Last index of the shared stretch that begins at index k, and its direction: 1, -1, or 0 for a single cell."""
    step = 0
    while k + 1 < end:
        ahead = place[flat.cell[k + 1]]
        change = ahead - place[flat.cell[k]]
        if ahead < 0 or abs(change) != 1 or (step != 0 and change != step):
            break
        step = change
        k += 1
    return k, step


@kernel
def _change_over(flat, place, cell, to):
    """Whether the other route takes the diagonal that crosses the diagonal step cell -> to."""
    d_row, d_column = to // flat.columns - cell // flat.columns, to % flat.columns - cell % flat.columns
    if d_row * d_column == 0:
        return False
    a, b = place[cell + d_column], place[cell + d_row * flat.columns]
    return a >= 0 and b >= 0 and abs(a - b) == 1
