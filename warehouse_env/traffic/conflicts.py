"""Conflicts between routes of several robots: measures, and cost maps from them.

Two routes share a stretch where both visit the same cells one after another, in the same or in the opposite order
(paper 001, section 2.3, tells node from opposing conflicts so). All robots drive at one cell a unit of time, and a
robot keeps others off a cell for HOLD units around its arrival there:

- a crossing: routes that share a single cell, or merge into the same direction, or change over between the centres of
  four cells on two diagonals. They conflict if they arrive within HOLD of each other. Driving behind each other after
  that is no conflict.
- an opposing conflict: a shared stretch of length l > 0 in opposite directions. They conflict if they enter its two
  ends within l + HOLD of each other.

How often they happen depends on what is known of time:

- "count": nothing; every shared place counts once.
- "start": all robots start at time 0 and drive their route once; a place counts if they conflict there.
- "lifelong": robots repeat routes like theirs, each at a random time, so that a place with a window w counts
  w/T_i + w/T_j, T the routes' durations: conflicts while each robot drives its route once, in the mean of both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError
from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import MOVES

Timing = Literal["count", "start", "lifelong"]
Route = NDArray[np.int64]  # [L, 2] cells (row, col)

HOLD = 1.0  # [cells of driving] a robot of 0.9 m occupies a cell of 1 m for about as long as it takes to cross it

_COUNT, _START, _LIFELONG = range(3)
_SQRT2 = math.sqrt(2.0)
_ROUNDING = 1e-9  # [cells] robots that are apart by the whole window do not conflict


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


def conflict_table(routes: Sequence[Route], shape: tuple[int, int], timing: Timing = "lifelong") -> NDArray[np.float64]:
    """Return float64[N, N, 2]: (crossings, opposing conflicts) of each pair of routes, symmetric, 0 on the diagonal.

    A route visits no cell twice. ConfigError for an unknown timing or a route without cells.
    """
    if timing not in get_args(Timing):
        raise ConfigError(f"timing={timing!r} must be one of {', '.join(get_args(Timing))}")
    flat = flatten(routes, shape[1])
    table = np.zeros((len(routes), len(routes), 2))
    _pairs(flat, durations(flat), shape[0] * shape[1], get_args(Timing).index(timing), HOLD, table)
    return table


def conflicts(routes: Sequence[Route], shape: tuple[int, int], timing: Timing = "lifelong") -> Conflicts:
    """Return the crossings and opposing conflicts between all pairs of routes (see the module)."""
    crossings, opposing = conflict_table(routes, shape, timing).sum(axis=(0, 1)) / 2
    return Conflicts(float(crossings), float(opposing))


@kernel
def _pairs(flat, duration, cells, timing, hold, table):
    """Fill the upper and the lower half of the table."""
    place = np.full(cells, -1, np.int64)  # index of a cell in route i
    for i in range(len(duration)):
        for k in range(flat.first[i], flat.first[i + 1]):
            place[flat.cell[k]] = k
        for j in range(i):
            rate = 1.0 / duration[i] + 1.0 / duration[j]
            table[i, j] = table[j, i] = _meet(flat, place, flat.first[j], flat.first[j + 1], timing, hold, rate)
        for k in range(flat.first[i], flat.first[i + 1]):
            place[flat.cell[k]] = -1


@kernel
def _meet(flat, place, first, end, timing, hold, rate):
    """Crossings and opposing conflicts, float64[2], of the route first..end-1 with the one that `place` holds."""
    found = np.zeros(2)
    last = first - 1  # of the stretch at hand
    for k in range(first, end):
        mine = place[flat.cell[k]]
        if mine >= 0 and k > last:
            last, step = _stretch(flat, place, k, end)
            opposing = step < 0
            length = flat.at[last] - flat.at[k] if opposing else 0.0
            entered = flat.at[place[flat.cell[last]]] if opposing else flat.at[mine]
            found[1 if opposing else 0] += _weight(flat.at[k] - entered, length + hold, timing, rate)
        if k + 1 < end:
            other = _changeover(flat, place, flat.cell[k], flat.cell[k + 1])
            if other >= 0:
                found[0] += _weight(flat.at[k] - flat.at[other], hold, timing, rate)
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
def _changeover(flat, place, cell, to):
    """Index at which the other route begins the diagonal that crosses the diagonal step cell -> to; else -1."""
    d_row, d_column = to // flat.columns - cell // flat.columns, to % flat.columns - cell % flat.columns
    if d_row * d_column == 0:
        return -1
    a, b = place[cell + d_column], place[cell + d_row * flat.columns]
    return min(a, b) if a >= 0 and b >= 0 and abs(a - b) == 1 else -1


@kernel
def _weight(apart, window, timing, rate):
    """What a shared place counts, entered `apart` from each other."""
    if timing == _LIFELONG:
        return window * rate
    return 1.0 if timing == _COUNT or abs(apart) < window - _ROUNDING else 0.0


def congestion(
    routes: Sequence[Route], shape: tuple[int, int], crossing: float = 1.0, opposing: float | None = None
) -> NDArray[np.float64]:
    """Return the cost map for the robot planned next, from other robots' routes (`Planner.plan`).

    crossing, opposing: cells of detour that avoiding one conflict is worth.

    opposing None: float64[H, W], crossing * 2 * HOLD / T_j on every cell of route j, whatever the direction.
    Otherwise float64[H, W, 8]: entering a cell of route j costs the same, but nothing on j's own moves (driving behind
    each other), and opposing * 2 * length / T_j on j's moves backwards. Along a path the sum is the expected number of
    conflicts that it meets on one drive while the others repeat their routes ("lifelong"), times their price: exactly
    (but for the HOLD of an opposing stretch, which is priced as a crossing), so that a search over it is exact too.
    """
    flat = flatten(routes, shape[1])
    if opposing is None:
        cost = np.zeros(shape)
        share = np.repeat(2 * HOLD * crossing / durations(flat), np.diff(flat.first))
        np.add.at(cost.reshape(-1), flat.cell, share)
        return cost
    directed = np.zeros((shape[0] * shape[1], 8))
    _charge(flat, durations(flat), 2 * HOLD * crossing, 2 * opposing, directed)
    return directed.reshape(*shape, 8)


@kernel
def _charge(flat, duration, enter, against, cost):
    """Add the price of meeting each route to cost float64[C, 8]; moves that are not legal are charged as well."""
    rows, columns = len(cost) // flat.columns, flat.columns
    for j in range(len(duration)):
        first, end = flat.first[j], flat.first[j + 1]
        for k in range(first, end):
            cell = flat.cell[k]
            row, column = cell // columns, cell % columns
            before = flat.cell[k - 1] if k > first else -1
            after = flat.cell[k + 1] if k + 1 < end else -1
            for move in range(8):
                r, c = row - MOVES[move, 0], column - MOVES[move, 1]
                if 0 <= r < rows and 0 <= c < columns and r * columns + c != before:
                    backwards = r * columns + c == after
                    price = against * (flat.at[k + 1] - flat.at[k]) if backwards else enter
                    cost[r * columns + c, move] += price / duration[j]
            if after >= 0 and after // columns != row and after % columns != column:
                d_column, d_row = after % columns - column, after // columns - row
                a, b = cell + d_column, cell + d_row * columns
                for move in range(1, 8, 2):  # the diagonals between a and b change over with this one
                    if a + MOVES[move, 0] * columns + MOVES[move, 1] == b:
                        cost[a, move] += enter / duration[j]
                        cost[b, (move + 4) % 8] += enter / duration[j]
