"""A floor's bottlenecks, and changes that may help there: opened aisles and one-way rules.

Pick faces and stations stay, so robots have the same tasks on every changed floor.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice, takewhile
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.advice.conflicts import conflicts
from train.advice.tasks import Task, endpoint_tasks
from train.evaluation.places import peaks
from warehouse_env.maps.distance import label_regions
from warehouse_env.maps.endpoints import beside, shelves
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning.graph_search import AStarTurns
from warehouse_env.planning.plan import path_length

TRIPS = 300  # that represent all
MOST = 5  # bottlenecks
RADIUS = 2  # [cells] of a place


class Bottleneck(NamedTuple):
    """A place where robots wait."""

    cell: Cell
    x: float  # [m]
    y: float
    waiting: float  # [s/h] within RADIUS
    share: float  # of all waiting on the floor
    trips: float  # share of trips through its busiest cell


def draw_trips(grid: GridMap, seed: int) -> list[Task]:
    """Return random trips between pick faces and stations, as lifelong robots make them."""
    return endpoint_tasks(grid, TRIPS, np.random.default_rng([seed, 0]))


def plan_trips(grid: GridMap, trips: Sequence[Task]) -> list[NDArray[np.int64]]:
    """Return the cells int[L, 2] of a shortest route with the fewest turns for each trip; PlanError if none exists."""
    planner, rng = AStarTurns(), np.random.default_rng(0)
    return [planner.plan(grid, start, goal, rng).cells for start, goal in trips]


def traffic(routes: Sequence[NDArray[np.int64]], shape: tuple[int, int]) -> NDArray[np.float64]:
    """Return float64[H, W, 8]: the share of routes that leave a cell by each move of MOVES; the last cell by none."""
    flow = np.zeros((*shape, len(MOVES)))
    number = {(int(row), int(column)): k for k, (row, column) in enumerate(MOVES)}
    for route in routes:
        for (row, column), step in zip(route[:-1], np.diff(route, axis=0), strict=True):
            flow[row, column, number[int(step[0]), int(step[1])]] += 1.0
    return flow / max(1, len(routes))


def passing(routes: Sequence[NDArray[np.int64]], shape: tuple[int, int]) -> NDArray[np.float64]:
    """Return float64[H, W]: the share of routes that visit a cell."""
    visits = np.zeros(shape)
    for route in routes:
        cells = np.unique(route, axis=0)
        visits[cells[:, 0], cells[:, 1]] += 1.0
    return visits / max(1, len(routes))


def bottlenecks(grid: GridMap, waiting: NDArray[np.float64], visits: NDArray[np.float64]) -> list[Bottleneck]:
    """Return up to MOST places with the longest waiting [s/h], worst first; visits: as `passing`."""
    found = []
    for row, column, heat in peaks(waiting, MOST, RADIUS):
        around = (slice(max(0, row - RADIUS), row + RADIUS + 1), slice(max(0, column - RADIUS), column + RADIUS + 1))
        x, y = grid.world(grid.centre((row, column))).tolist()
        found.append(Bottleneck((row, column), x, y, heat, heat / float(waiting.sum()), float(visits[around].max())))
    return found


Kind = Literal["aisle", "one-way", "stations", "chargers"]
REACH = 4  # [cells] from a bottleneck to a shelf that may be opened
MOST_CELLS = 60  # of shelf that one change removes
WIDEST = 2  # [cells] across an aisle
SHORTEST = 4  # [cells] along it
PRICE = 4.0  # [cells] of detour that an expected conflict costs
EAST, NORTH, WEST, SOUTH = 1, 2, 3, 4  # one_way.ARROWS
_NAMES = {EAST: "east", NORTH: "north", WEST: "west", SOUTH: "south"}
_STEPS = ((0, 1), (-1, 0), (0, -1), (1, 0))


class Candidate(NamedTuple):
    """A changed floor."""

    kind: Kind
    text: str  # the change in words
    grid: GridMap
    changed: NDArray[np.bool_]  # [H, W], cells opened, given a direction, or made a station or none
    work: Mapping[str, Any] = MappingProxyType({})  # changed fields of EnvConfig


class Storage(NamedTuple):
    """The storage that a change removes."""

    cells: int  # of shelf
    share: float  # of all shelf cells
    faces: int  # pick faces left without a shelf
    of: int  # pick faces with a shelf before


def storage_lost(grid: GridMap, one: Candidate) -> Storage:
    """Return the shelves, not walls, that are lost."""
    before, after = shelves(grid.walls), shelves(grid.walls) & ~one.changed
    served, left = (int(beside(racks)[tuple(grid.picks.T)].sum()) for racks in (before, after))
    cells = int(before.sum() - after.sum())
    return Storage(cells, cells / max(1, int(before.sum())), served - left, served)


def aisles(grid: GridMap, cell: Cell) -> list[Candidate]:
    """Return what could be opened around a cell, on each side with shelves; the walls around a floor stay.

    A gap through the next rack or its face removed, and both through all racks in that line: a new or a wider aisle.
    """
    racks = shelves(grid.walls)
    found = []
    for step in _STEPS:
        aside = (step[1], step[0])
        face = _nearest_face(grid, racks, cell, step)
        if face is None:
            continue
        through = _run(racks, face, step)
        across = [*_run(racks, face, aside), *_run(racks, face, (-aside[0], -aside[1]))]
        if _is_free(grid, (through[-1][0] + step[0], through[-1][1] + step[1])):
            found.append(_opened(grid, through, "a gap through the shelves"))
            found.append(_opened(grid, _line(racks, face, step), "a new aisle"))
        found.append(_opened(grid, across, "the aisle wider by a row of shelves"))
        found.append(_opened(grid, _line(racks, face, aside), "the aisle wider over its whole length"))
    return [one for one in found if one.changed.sum() <= MOST_CELLS]


def _nearest_face(grid: GridMap, racks: NDArray[np.bool_], cell: Cell, step: Cell) -> Cell | None:
    """Return the first cell of a rack in that direction from a cell, or from the nearest free cell sideways of it."""
    sides = {(step[1], step[0]), (-step[1], -step[0])}
    for distance in range(REACH + 1):
        for aside in sorted(sides):
            start = (cell[0] + distance * aside[0], cell[1] + distance * aside[1])
            if not _is_free(grid, start):
                sides.remove(aside)
                continue
            face = _next_shelf(grid, racks, start, step)
            if face is not None:
                return face
    return None


def _next_shelf(grid: GridMap, racks: NDArray[np.bool_], cell: Cell, step: Cell) -> Cell | None:
    """Return the first cell of a rack within REACH in that direction, None if there is none or a wall."""
    for ahead in islice(_ray(grid.shape, cell, step), 1, REACH + 1):
        if not _is_free(grid, ahead):
            return ahead if racks[ahead] else None
    return None


def _ray(shape: tuple[int, ...], cell: Cell, step: Cell) -> Iterator[Cell]:
    """Yield the cells of a floor from one on, in a direction."""
    row, column = cell
    while 0 <= row < shape[0] and 0 <= column < shape[1]:
        yield row, column
        row, column = row + step[0], column + step[1]


def _run(racks: NDArray[np.bool_], cell: Cell, step: Cell) -> list[Cell]:
    """Return the cells of a rack from one on, in a direction."""
    return list(takewhile(lambda one: racks[one], _ray(racks.shape, cell, step)))


def _line(racks: NDArray[np.bool_], cell: Cell, step: Cell) -> list[Cell]:
    """Return all cells of racks in a cell's row or column, whichever runs along `step`."""
    row, column = cell
    if step[0]:
        return [(int(one), column) for one in np.flatnonzero(racks[:, column])]
    return [(row, int(one)) for one in np.flatnonzero(racks[row])]


def _is_free(grid: GridMap, cell: Cell) -> bool:
    row, column = cell
    return 0 <= row < grid.shape[0] and 0 <= column < grid.shape[1] and not grid.occupied[row, column]


def _opened(grid: GridMap, cells: Iterable[Cell], what: str) -> Candidate:
    changed = np.zeros(grid.shape, dtype=np.bool_)
    for cell in cells:
        changed[cell] = True
    text = f"{what} at {_where(grid, changed)} ({int(changed.sum())} shelf cells)"
    occupied = grid.occupied & ~changed
    return Candidate("aisle", text, dataclasses.replace(grid, occupied=occupied), changed)


def _where(grid: GridMap, changed: NDArray[np.bool_]) -> str:
    """Say where cells are, in metres."""
    corners = grid.world(grid.centre(np.argwhere(changed)))
    half = grid.cell_size / 2
    (left, low), (right, high) = corners.min(axis=0) - half, corners.max(axis=0) + half
    return f"x {left:g} to {right:g} m, y {low:g} to {high:g} m"


def aisle_cells(grid: GridMap, along_row: bool) -> NDArray[np.int64]:
    """Return int64[H, W]: numbers from 1 for the aisles along rows (or columns), 0 off them.

    An aisle is at most WIDEST cells across, its sides shelves or the map's edge, and at least SHORTEST long.
    """
    free = ~grid.occupied if along_row else ~grid.occupied.T
    narrow = free & (run_lengths(free.T).T <= WIDEST)
    aisle = narrow & (run_lengths(narrow) >= SHORTEST)
    label = label_regions(aisle)
    return np.ascontiguousarray(label if along_row else label.T).astype(np.int64)


def run_lengths(free: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return int64[H, W]: the length of the run of free cells in its row that a cell is in, 0 off them."""
    lengths = np.zeros(free.shape, dtype=np.int64)
    for row, line in enumerate(free):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(np.int64), [0]])))
        for start, end in zip(edges[::2], edges[1::2], strict=True):
            lengths[row, start:end] = end - start
    return lengths


def one_ways(grid: GridMap, cell: Cell, flow: NDArray[np.float64]) -> list[Candidate]:
    """Return the aisles through a cell as one-way streets in the busier direction; flow: as `traffic`."""
    found = []
    for along_row in (True, False):
        label = aisle_cells(grid, along_row)
        if label[cell]:
            street = label == label[cell]
            forth, back = (EAST, WEST) if along_row else (NORTH, SOUTH)
            more = _towards(flow[street], forth) >= _towards(flow[street], back)
            way = forth if more else back
            text = f"one way {_NAMES[way]} at {_where(grid, street)}"
            found.append(_directed(grid, street, np.full(grid.shape, way), text))
    return [one for one in found if cut_off(one.grid) is None]


def _directed(grid: GridMap, street: NDArray[np.bool_], ways: NDArray[Any], text: str) -> Candidate:
    """Return the floor with a one-way street bool[H, W], by directions [H, W]."""
    directions = np.where(street, ways, grid.one_way).astype(grid.one_way.dtype)
    return Candidate("one-way", text, dataclasses.replace(grid, one_way=directions), street)


def _towards(flow: NDArray[np.float64], way: int) -> float:
    """Return how much of flow [K, 8] goes in a direction, also diagonally."""
    middle = 2 * (way - 1)
    return float(sum(flow[:, (middle + turn) % 8].sum() for turn in (-1, 0, 1)))


def alternating(grid: GridMap) -> list[Candidate]:
    """Return the floors with all aisles along rows, or along columns, one way in alternating directions."""
    found = []
    for along_row, name in ((True, "west-east"), (False, "north-south")):
        label = aisle_cells(grid, along_row)
        lines = np.argwhere(label)[:, 0 if along_row else 1]
        begins = np.flatnonzero(np.diff(np.concatenate([[-2], np.unique(lines)])) > 1)
        first = np.unique(lines)[begins]
        if len(first) < 2:
            continue
        turn = np.searchsorted(first, np.arange(grid.shape[0 if along_row else 1]), side="right") % 2
        ways = np.where(turn, *((EAST, WEST) if along_row else (NORTH, SOUTH)))
        ways = np.broadcast_to(ways[:, None] if along_row else ways[None, :], grid.shape)
        found.append(_directed(grid, label > 0, ways, f"all {len(first)} lines of {name} aisles one way in turn"))
    return [one for one in found if cut_off(one.grid) is None]


def cut_off(grid: GridMap) -> Cell | None:
    """Return an endpoint without a way to and from the first one, None if all are connected."""
    first, *others = grid.endpoints[2]
    region = grid.return_region(first)
    return next((cell for cell in others if not region[cell]), None)


def expected_cost(grid: GridMap, trips: Sequence[Task], robots: int) -> float:
    """Return the cost of a trip in cells: its length, and PRICE for each expected conflict with `robots`."""
    routes = plan_trips(grid, trips)
    length = float(np.mean([path_length(route) for route in routes]))
    met = 2.0 * conflicts(routes, grid.shape).all / len(routes) * robots / len(routes)
    return length + PRICE * met


def choose(candidates: Sequence[Candidate], trips: Sequence[Task], robots: int, most: int) -> list[Candidate]:
    """Return the `most` different changes with the least expected cost of trips."""
    different = {one.changed.tobytes() + one.grid.one_way.tobytes(): one for one in reversed(candidates)}
    return sorted(different.values(), key=lambda one: expected_cost(one.grid, trips, robots))[:most]
