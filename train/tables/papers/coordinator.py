"""Paper 001, section 2.3, on the grid: waiting by priority, stepping aside, new routes; one move a step for everyone.

The paper's AGVs drive at one speed and are planned alone; a step is one of the 8 moves, straight or diagonal (its
"step 9"). Two clash where the space that they take up overlaps: here where discs of 0.7 cells meet between two steps.
That is the same cell, changing places, and crossing diagonals; following round a corner (0.707 cells) is free.

Of two that clash the one with the longer way left gives way (the paper's order for tasks of one kind):

- node conflict, the other does not come through its cell: it waits where it is;
- opposing conflict, the other does: the quicker of a step aside (into a neighbouring cell on nobody's path, until the
  other is past, and back onto its path) and a new route (without the cells that both have before them).

Readings of our own, where the paper is silent: robots that have arrived stay and are driven round by a new route; who
would drive into a robot that has to wait, waits behind it; where neither step nor route exists, it waits.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning import make_planner
from warehouse_env.traffic.conflicts import Route

Tracks = NDArray[np.int64]  # [T + 1, N, 2] cells (row, column) of all robots after each step
Path = list[Cell]

TOUCH = 0.7  # [cells] between two centres, below which they clash


def path_of(cells: Iterable[Iterable[int]]) -> Path:
    """Return cells (row, column) of any kind as tuples of Python's own integers."""
    return [(int(row), int(column)) for row, column in cells]


def nearest(a: Cell, to_a: Cell, b: Cell, to_b: Cell) -> float:
    """Return the least distance [cells] of two that go straight from a to to_a and from b to to_b in one step."""
    row, column = b[0] - a[0], b[1] - a[1]
    d_row, d_column = to_b[0] - to_a[0] - row, to_b[1] - to_a[1] - column
    speed = d_row * d_row + d_column * d_column
    part = min(max(-(row * d_row + column * d_column) / speed, 0.0), 1.0) if speed else 0.0
    return math.hypot(row + part * d_row, column + part * d_column)


def clash(a: Cell, to_a: Cell, b: Cell, to_b: Cell) -> bool:
    """Tell whether two robots touch within a step; more than two cells apart they cannot."""
    return abs(b[0] - a[0]) <= 2 and abs(b[1] - a[1]) <= 2 and nearest(a, to_a, b, to_b) < TOUCH


def duration(cells: Sequence[Cell]) -> float:
    """Return the time [cells] along a path with its waits: a straight move and a wait take 1, a diagonal sqrt(2)."""
    return sum(max(1.0, math.hypot(to[0] - at[0], to[1] - at[1])) for at, to in itertools.pairwise(cells))


class Driven(NamedTuple):
    """What became of a fleet: its tracks, and whether all have arrived."""

    tracks: Tracks
    arrived: bool

    def paths(self) -> list[Path]:
        """Return each robot's cells, with its waits, up to its last arrival."""
        paths = []
        for robot in range(self.tracks.shape[1]):
            track = path_of(self.tracks[:, robot])
            end = len(track)
            while end > 1 and track[end - 2] == track[-1]:
                end -= 1
            paths.append(track[:end])
        return paths

    def clashes(self) -> int:
        """Return how many pairs clash at some time."""
        pairs = itertools.combinations(np.swapaxes(self.tracks, 0, 1).tolist(), 2)
        return sum(_touch(own, other) for own, other in pairs)


def _touch(own: Sequence[Cell], theirs: Sequence[Cell]) -> bool:
    steps = zip(itertools.pairwise(own), itertools.pairwise(theirs), strict=True)
    return any(clash(*a, *b) for a, b in steps)


def drive_alone(routes: Sequence[Route]) -> Driven:
    """Let everyone drive its route at once as if nobody else were there; who has arrived stays."""
    longest = max(len(route) for route in routes)
    return Driven(np.stack([route[np.minimum(np.arange(longest), len(route) - 1)] for route in routes], axis=1), True)


@dataclass(frozen=True)
class Coordinator:
    """The rules of section 2.3; `aside` and `new_route` can be left out to see what each is worth."""

    aside: bool = True
    new_route: bool = True

    def drive(self, grid: GridMap, routes: Sequence[Route]) -> Driven:
        """Drive a fleet along routes int64[L, 2] planned alone, until all have arrived or all comes again (stuck)."""
        fleet = _Fleet(self, grid, list(map(path_of, routes)))
        tracks, known = [list(fleet.at)], set()
        while any(fleet.ahead) and (now := (tuple(fleet.at), tuple(map(tuple, fleet.ahead)))) not in known:
            known.add(now)
            fleet.step()
            tracks.append(list(fleet.at))
        return Driven(np.array(tracks, dtype=np.int64), not any(fleet.ahead))


class _Fleet:
    """Where all robots are, and the cells that each has still before it; a cell twice in a row is a wait."""

    def __init__(self, rules: Coordinator, grid: GridMap, paths: Sequence[Path]) -> None:
        self.rules, self.grid = rules, grid
        self.at: Path = [path[0] for path in paths]
        self.ahead: list[Path] = [path[1:] for path in paths]

    def step(self) -> None:
        """Everyone moves by one cell or waits, the one with the shortest way left first."""
        moves: dict[int, Cell] = {}
        order = sorted(range(len(self.at)), key=lambda i: (duration([self.at[i], *self.ahead[i]]), i))
        for robot in order:
            moves[robot] = self._wish(robot)
            other = self._clashing(robot, moves)
            if other is not None:
                moves[robot] = self._give_way(robot, other, moves)
        self._hold(order, moves)
        for robot, cell in moves.items():
            if self.ahead[robot] and self.ahead[robot][0] == cell:
                del self.ahead[robot][0]
            self.at[robot] = cell

    def _wish(self, robot: int) -> Cell:
        return self.ahead[robot][0] if self.ahead[robot] else self.at[robot]

    def _clashing(self, robot: int, moves: dict[int, Cell]) -> int | None:
        """Return the first of those that have chosen already which a robot's move clashes with."""
        own = self.at[robot], moves[robot]
        return next((j for j, to in moves.items() if j != robot and clash(*own, self.at[j], to)), None)

    def _give_way(self, robot: int, other: int, moves: dict[int, Cell]) -> Cell:
        """Return the move of a robot that clashes with one of higher priority; may change its path."""
        parked = not self.ahead[other]
        if not parked and self.at[robot] not in self.ahead[other]:
            return self.at[robot]
        ways = [] if parked or not self.rules.aside else self._asides(robot, other)
        if parked or self.rules.new_route:
            ways += self._new_routes(robot, other)
        if not ways:
            return self.at[robot]
        self.ahead[robot] = min(ways, key=lambda ahead: duration([self.at[robot], *ahead]))
        move = {**moves, robot: self._wish(robot)}
        return move[robot] if self._clashing(robot, move) is None else self.at[robot]

    def _asides(self, robot: int, other: int) -> list[Path]:
        """Return the ways into a free cell beside, the wait there until the other is past, and back to the path."""
        path, theirs = [self.at[robot], *self.ahead[robot]], [self.at[other], *self.ahead[other]]
        taken = {cell for k in range(len(self.at)) if k != robot for cell in (self.at[k], *self.ahead[k])}
        ways = []
        for cell in self._neighbours(self.at[robot]):
            if cell in taken:
                continue
            beside = self._neighbours(cell)
            for place, back in enumerate(path):
                if back in beside:
                    tries = ([cell] * (1 + wait) + path[place:] for wait in range(len(theirs) + 1))
                    ways += [way for way in tries if not _meet([self.at[robot], *way], theirs)][:1]
        return ways

    def _neighbours(self, cell: Cell) -> Path:
        return path_of(MOVES[self.grid.legal_moves[cell]] + cell)

    def _new_routes(self, robot: int, other: int) -> list[Path]:
        """Return the shortest route without parked robots and the cells before both, as a list of one; or none."""
        occupied = self.grid.occupied.copy()
        shared = {self.at[other], *self.ahead[other]} & set(self.ahead[robot]) if self.ahead[other] else set()
        for cell in shared | {self.at[k] for k in range(len(self.at)) if not self.ahead[k]}:
            occupied[cell] = True
        goal = self.ahead[robot][-1]
        occupied[self.at[robot]] = occupied[goal] = False
        plan = make_planner("astar").plan(GridMap(occupied), self.at[robot], goal, np.random.default_rng(0))
        return [path_of(plan.cells[1:])] if plan.found else []

    def _hold(self, order: Sequence[int], moves: dict[int, Cell]) -> None:
        """Let those wait whose move would touch another's, until none does; all standing still never clash."""
        while True:
            held = [i for i in order if moves[i] != self.at[i] and self._clashing(i, moves) is not None]
            if not held:
                return
            moves[held[-1]] = self.at[held[-1]]


def _meet(own: Path, theirs: Path) -> bool:
    """Tell whether two clash along their paths; who has arrived stays."""
    steps = max(len(own), len(theirs))
    return _touch(*(path + [path[-1]] * (steps - len(path)) for path in (own, theirs)))
