"""Random trips on a floor: their routes, the traffic they make, where robots wait, and what a trip costs."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.evaluation.places import peaks
from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning.graph_search import AStarTurns
from warehouse_env.planning.plan import path_length

TRIPS = 300  # that represent all
MOST = 5  # bottlenecks
RADIUS = 2  # [cells] of a bottleneck
PRICE = 4.0  # [cells] of detour that an expected conflict costs

Trip = tuple[Cell, Cell]
"""Start and goal."""


def draw_trips(grid: GridMap, seed: int, count: int = TRIPS) -> list[Trip]:
    """Draw trips between pick faces and stations in alternating direction, as lifelong robots make them.

    Endpoints are dealt in random order, repeatedly if there are fewer than trips. ConfigError for a single endpoint.
    """
    if len(np.unique(np.concatenate([grid.picks, grid.stations]), axis=0)) < 2:
        raise ConfigError(f"map {grid.name!r} has a single endpoint; a task needs two")
    rng = np.random.default_rng([seed, 0])
    decks = [rng.permutation(cells).tolist() for cells in (grid.picks, grid.stations)]
    trips: list[Trip] = []
    for k in range(2 * count):
        pick, station = (tuple(deck[k % len(deck)]) for deck in decks)
        if pick != station and len(trips) < count:
            trips.append((pick, station) if len(trips) % 2 else (station, pick))
    return trips


def plan_trips(grid: GridMap, trips: Sequence[Trip]) -> list[NDArray[np.int64]]:
    """Plan a shortest route with the fewest turns for each trip, as cells int[L, 2]; PlanError if none exists."""
    planner, rng = AStarTurns(), np.random.default_rng(0)
    return [planner.plan(grid, start, goal, rng).cells for start, goal in trips]


def traffic(routes: Sequence[NDArray[np.int64]], shape: tuple[int, int]) -> tuple[NDArray[np.float64], float]:
    """Return the traffic of one or more routes int64[L, 2], none of which meets itself.

    That is the share of the routes that visit a cell, float64[H, W], and the expected conflicts between all pairs of
    routes while each robot drives its route once.

    Robots repeat their routes from random times on and drive a cell in a unit of time. Two conflict at a shared stretch
    of cells if they arrive within one unit of each other; on an opposing stretch (paper 001, section 2.3) within its
    length more. Diagonals that cross count like a shared cell. A window w of routes that take T_i and T_j counts
    w / T_i + w / T_j. A stretch has one cell more than steps, so the number of stretches is cells less steps.
    """
    lengths = [len(route) for route in routes]
    cells, owner = np.concatenate(routes), np.repeat(np.arange(len(routes)), lengths)
    weight = 1.0 / np.maximum([path_length(route) for route in routes], 1.0)
    place = cells[:, 0] * shape[1] + cells[:, 1]
    drives = np.flatnonzero(owner[:-1] == owner[1:])
    (rows, columns), start, end = (cells[drives + 1] - cells[drives]).T, place[drives], place[drives + 1]
    numbers = np.zeros((3, 3), np.int64)  # of MOVES, by row and column
    numbers[tuple(np.array(MOVES).T + 1)] = range(8)
    move = numbers[rows + 1, columns + 1]
    visits = np.bincount(place, minlength=shape[0] * shape[1])
    moves = np.bincount(8 * start + move, minlength=8 * len(visits))

    same, opposing = moves[8 * start + move] - 1, moves[8 * end + (move + 4) % 8]
    long = np.where(rows * columns, np.sqrt(2.0), 1.0)
    square = 2 * (np.minimum(cells[drives], cells[drives + 1]) @ (shape[1], 1)) + (rows * columns > 0)
    diagonals = np.bincount(square[rows * columns != 0], minlength=2 * len(visits))
    crossing = np.where(rows * columns, diagonals[square ^ 1], 0)
    met = float((weight[owner] * (visits[place] - 1)).sum())
    met += float((weight[owner[drives]] * (crossing - same - opposing + long * opposing)).sum())
    return visits.reshape(shape) / len(routes), met


class Bottleneck(NamedTuple):
    """A place where robots wait."""

    cell: Cell
    x: float  # [m]
    y: float
    waiting: float  # [s/h] within RADIUS
    share: float  # of all waiting on the floor
    trips: float  # share of trips through its busiest cell


def bottlenecks(grid: GridMap, waiting: NDArray[np.float64], visits: NDArray[np.float64]) -> list[Bottleneck]:
    """Return up to MOST places with the longest waiting [s/h], worst first; visits: see `traffic`."""
    found = []
    for row, column, heat in peaks(waiting, MOST, RADIUS):
        around = (slice(max(0, row - RADIUS), row + RADIUS + 1), slice(max(0, column - RADIUS), column + RADIUS + 1))
        x, y = grid.world(grid.centre((row, column))).tolist()
        found.append(Bottleneck((row, column), x, y, heat, heat / float(waiting.sum()), float(visits[around].max())))
    return found


def expected_cost(grid: GridMap, trips: Sequence[Trip], robots: int) -> float:
    """Return the cost of a trip in cells: its length, and PRICE for each expected conflict with `robots`."""
    routes = plan_trips(grid, trips)
    length = float(np.mean([path_length(route) for route in routes]))
    _, conflicts = traffic(routes, grid.shape)
    met = 2.0 * conflicts / len(routes) * robots / len(routes)
    return length + PRICE * met
