"""Waiting places beside the traffic for robots without a goal, and queues for cells that others hold.

A place is a cell that is neither pick face nor station. A robot stands there along the obstacle beside it, or at any
heading if there is none, and leaves all endpoints connected. Where the floor allows it, the free cells around the place
stay connected, so it blocks no aisle.
"""

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.moves import label_regions
from warehouse_env.routes.goals import face
from warehouse_env.simulation.tasks.sampled import covered, disc_of

_OWN_CELL = np.zeros((1, 2), np.int64)
APART = 0.3  # [m] between the bodies of two that stand at neighbouring places, at any headings


def standing_places(grid: GridMap, config: EnvConfig, count: int) -> list[Cell]:
    """Return up to `count` places that keep all endpoints connected.

    Places that block no aisle come first, of these those along an obstacle, and of these the nearest to a station.
    """
    endpoints = grid.endpoints[2]
    apart = (2 * config.widest_body.farthest + APART) / grid.cell_size
    free, chosen = grid.region.copy(), list[Cell]()
    for cell, disc in _by_use(grid, config):
        if len(chosen) == count:
            break
        if any(np.hypot(cell[0] - r, cell[1] - c) < apart for r, c in chosen):
            continue
        left = free.copy()
        left[covered(cell, disc, grid.shape)] = False
        labels = label_regions(left)
        ends = {int(labels[end]) for end in endpoints}
        if len(ends) == 1 and 0 not in ends:
            free = left
            chosen.append(cell)
    return chosen


def _by_use(grid: GridMap, config: EnvConfig) -> list[tuple[Cell, NDArray[np.int64]]]:
    """Return the cells away from endpoints and what a robot there may bar (see `disc_of`), the best places first."""
    ends, stations, body = np.array(grid.endpoints[2]), grid.stations, config.widest_body
    disc = disc_of(config, grid.cell_size)
    reach = float(np.sqrt((disc**2).sum(axis=1).max()))
    found = []
    for row, column in grid.free_cells.tolist():
        if np.hypot(ends[:, 0] - row, ends[:, 1] - column).min() <= reach:
            continue
        along = body.length <= grid.cell_size and len(face(grid, (row, column), body).poses) > 0
        bars = _OWN_CELL if along else disc
        way = float(np.hypot(stations[:, 0] - row, stations[:, 1] - column).min())
        found.append((_bars((row, column), bars, grid.region), not along, way, (row, column), bars))
    return [(cell, bars) for *_, cell, bars in sorted(found, key=lambda place: place[:-1])]


def _bars(cell: Cell, disc: NDArray[np.int64], inside: NDArray[np.bool_]) -> bool:
    """Whether a robot on a cell disconnects the free cells around it."""
    reach = int(np.abs(disc).max()) + 1
    padded = np.pad(inside, reach)
    window = padded[cell[0] : cell[0] + 2 * reach + 1, cell[1] : cell[1] + 2 * reach + 1].copy()
    window[tuple((disc + reach).T)] = False
    labels = label_regions(window)
    return int(labels.max()) != 1


class Places:
    """The cells that robots of one world hold, each by one robot, and the queues for held cells."""

    def __init__(self, waiting: Sequence[Cell], spare: Sequence[Cell]) -> None:
        """waiting: the places to stand; spare: other cells for when all places are held."""
        self._waiting, self._spare = list(waiting), list(spare)
        self.held_by: dict[Cell, int] = {}
        self._held: dict[int, Cell] = {}
        self._queues: dict[Cell, deque[int]] = {}

    def take(self, robot: int, cell: Cell) -> None:
        """Let a robot hold a free cell, and give up the cell it held and its place in a queue."""
        self.leave(robot)
        self.held_by[cell], self._held[robot] = robot, cell

    def leave(self, robot: int) -> None:
        """Take a robot's cell and its place in a queue away."""
        if robot in self._held:
            del self.held_by[self._held.pop(robot)]
        self._leave_queue(robot)

    def _leave_queue(self, robot: int) -> None:
        for cell in [cell for cell, queue in self._queues.items() if robot in queue]:
            self._queues[cell].remove(robot)
            if not self._queues[cell]:
                del self._queues[cell]

    def queue(self, robot: int, cell: Cell) -> None:
        """Add a robot to the queue for a cell, instead of the one that it is in."""
        self._leave_queue(robot)
        self._queues.setdefault(cell, deque()).append(robot)

    def queued(self, cell: Cell) -> int:
        """Return the length of the queue for a cell."""
        return len(self._queues.get(cell, ()))

    def next_in(self) -> list[tuple[int, Cell]]:
        """Return the robots whose awaited cell is free: the first of each queue."""
        return [(queue[0], cell) for cell, queue in self._queues.items() if cell not in self.held_by]

    def stands(self, robot: int) -> bool:
        """Whether a robot holds a waiting place."""
        return self._held.get(robot) in self._waiting

    def near(self, cell: Cell) -> Cell | None:
        """Return the free place nearest to a cell, or a spare one; None if all are held."""
        return self._nearest(self._waiting, cell) or self._nearest(self._spare, cell)

    def cell_of(self, robot: int) -> Cell:
        """Return the cell that a robot holds."""
        return self._held[robot]

    def _nearest(self, cells: Sequence[Cell], to: Cell) -> Cell | None:
        free = [cell for cell in cells if cell not in self.held_by]
        return nearest_cell(free, to) if free else None


def nearest_cell(cells: Sequence[Cell], to: Cell) -> Cell:
    """Return the cell nearest to another, as the crow flies."""
    return min(cells, key=lambda cell: ((cell[0] - to[0]) ** 2 + (cell[1] - to[1]) ** 2, cell))
