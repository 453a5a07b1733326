"""Section 2.3 of paper 001 on the grid: robots wait by priority, step aside, or take new routes.

All robots make one of the 8 moves in a step. Two robots clash if their centres come nearer than 0.7 cells in a step: on
one cell, changing places, on crossing diagonals. Following round a corner (0.707 cells) is allowed. Of two robots that
clash, the one with the longer way left gives way:

- node conflict (its cell is not on the other's path): it waits;
- opposing conflict: it takes the quicker of a step aside (to a neighbouring cell on no path, until the other has
  passed, then back to its path) and a new route (without the cells that both have ahead).

Our readings where the paper is silent: arrived robots stay, and the others take new routes around them. A robot waits
behind a waiting one, and where it has neither a step aside nor a route. `six_agvs` is the experiment of section 3.3.
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from train.reporting.rows import Row
from train.tables.study import TableSetting, TableTask, driven_row
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.planning import Planner, make_planner

TOUCH = 0.7  # [cells] between two centres, below which they clash

Path = list[Cell]
"""A robot's cell after each step, waits included; it stays on the last one."""


def path_of(cells: Iterable[Iterable[int]]) -> Path:
    """Return cells (row, column) as tuples of Python integers."""
    return [(int(row), int(column)) for row, column in cells]


def nearest(a: Cell, to_a: Cell, b: Cell, to_b: Cell) -> float:
    """Return the least distance [cells] of two robots that go straight from a to to_a and from b to to_b in a step."""
    row, column = b[0] - a[0], b[1] - a[1]
    d_row, d_column = to_b[0] - to_a[0] - row, to_b[1] - to_a[1] - column
    speed = d_row * d_row + d_column * d_column
    part = min(max(-(row * d_row + column * d_column) / speed, 0.0), 1.0) if speed else 0.0
    return math.hypot(row + part * d_row, column + part * d_column)


def gaps(own: Path, other: Path, steps: int) -> Iterator[float]:
    """Yield the least distance [cells] of two robots in each step."""
    mine, theirs = (path + path[-1:] * (steps + 1 - len(path)) for path in (own, other))
    for k in range(steps):
        yield nearest(mine[k], mine[k + 1], theirs[k], theirs[k + 1])


def meet(own: Path, other: Path) -> bool:
    """Tell whether two robots clash on their paths."""
    return any(gap < TOUCH for gap in gaps(own, other, max(len(own), len(other)) - 1))


def duration(cells: Sequence[Cell]) -> float:
    """Return the time [cells] along a path: 1 for a straight move or a wait, sqrt(2) for a diagonal move."""
    return sum(max(1.0, math.dist(at, to)) for at, to in itertools.pairwise(cells))


class Coordinator:
    """The positions of all robots on paths that were planned alone, and the rules of section 2.3.

    aside, new_route: False leaves that rule out, to measure what it is worth.
    """

    def __init__(self, grid: GridMap, paths: Sequence[Path], *, aside: bool = True, new_route: bool = True) -> None:
        self.grid, self.aside, self.new_route = grid, aside, new_route
        self.at: Path = [path[0] for path in paths]
        self.ahead: list[Path] = [path[1:] for path in paths]  # a cell twice in a row is a wait

    def drive(self) -> tuple[list[Path], bool]:
        """Drive until all robots have arrived or a situation repeats (they are stuck).

        Returns each robot's cells up to its last arrival, and whether all have arrived.
        """
        tracks, known = [[cell] for cell in self.at], set()
        while any(self.ahead) and (now := (tuple(self.at), tuple(map(tuple, self.ahead)))) not in known:
            known.add(now)
            self._step()
            for track, cell in zip(tracks, self.at, strict=True):
                track.append(cell)
        for track in tracks:
            while track[-2:-1] == track[-1:]:
                track.pop()
        return tracks, not any(self.ahead)

    def _step(self) -> None:
        """Move all robots by one cell or let them wait; the robot with the shortest way left chooses first."""
        moves: dict[int, Cell] = {}
        order = sorted(range(len(self.at)), key=lambda robot: duration([self.at[robot], *self.ahead[robot]]))
        for robot in order:
            moves[robot] = self._wish(robot)
            other = self._clashing(robot, moves)
            if other is not None:
                moves[robot] = self._give_way(robot, other, moves)
        # Hold robots back until no moves clash; robots that all stand never do.
        while held := [i for i in order if moves[i] != self.at[i] and self._clashing(i, moves) is not None]:
            moves[held[-1]] = self.at[held[-1]]
        for robot, cell in moves.items():
            if self.ahead[robot][:1] == [cell]:
                del self.ahead[robot][0]
            self.at[robot] = cell

    def _wish(self, robot: int) -> Cell:
        return self.ahead[robot][0] if self.ahead[robot] else self.at[robot]

    def _clashing(self, robot: int, moves: dict[int, Cell]) -> int | None:
        """Return the first robot with a move that clashes with the given robot's move."""
        own = self.at[robot], moves[robot]
        return next((k for k, to in moves.items() if k != robot and nearest(*own, self.at[k], to) < TOUCH), None)

    def _give_way(self, robot: int, other: int, moves: dict[int, Cell]) -> Cell:
        """Return the move of a robot that clashes with one of higher priority; may change its path."""
        parked = not self.ahead[other]
        if not parked and self.at[robot] not in self.ahead[other]:
            return self.at[robot]
        ways = self._asides(robot, other) if self.aside and not parked else []
        ways += self._new_routes(robot, other) if self.new_route or parked else []
        if not ways:
            return self.at[robot]
        self.ahead[robot] = min(ways, key=lambda ahead: duration([self.at[robot], *ahead]))
        wish = self._wish(robot)
        return wish if self._clashing(robot, {**moves, robot: wish}) is None else self.at[robot]

    def _asides(self, robot: int, other: int) -> list[Path]:
        """Return the ways to a free neighbouring cell, with a wait there until the other has passed, and back."""
        path, theirs = [self.at[robot], *self.ahead[robot]], [self.at[other], *self.ahead[other]]
        taken = {cell for k in range(len(self.at)) if k != robot for cell in (self.at[k], *self.ahead[k])}
        ways: list[Path] = []
        for cell in (free for free in self._neighbours(path[0]) if free not in taken):
            for place in (k for k, back in enumerate(path) if back in self._neighbours(cell)):
                tries = ([cell] * (1 + wait) + path[place:] for wait in range(len(theirs) + 1))
                ways += itertools.islice((way for way in tries if not meet([path[0], *way], theirs)), 1)
        return ways

    def _neighbours(self, cell: Cell) -> Path:
        return path_of(MOVES[self.grid.legal_moves[cell]] + cell)

    def _new_routes(self, robot: int, other: int) -> list[Path]:
        """Return the shortest route without parked robots and the cells that both have ahead, as a list of 0 or 1."""
        occupied = self.grid.occupied.copy()
        shared = {self.at[other], *self.ahead[other]} & set(self.ahead[robot]) if self.ahead[other] else set()
        goal = self.ahead[robot][-1]
        for cell in shared | {at for at, ahead in zip(self.at, self.ahead, strict=True) if not ahead}:
            occupied[cell] = True
        occupied[self.at[robot]] = occupied[goal] = False
        plan = make_planner("astar").plan(GridMap(occupied), self.at[robot], goal, np.random.default_rng(0))
        return [path_of(plan.cells[1:])] if plan.found else []


ROBOTS, DRAWS = 6, 24
SIDE = 22  # columns, since cells 279, 301 and 323 of the paper are one below the other
_AISLES = (0, 1, 4, 7, 10, 13, 16, 19)  # rows
_CROSS_AISLES = (4, 5, 9, 10, 11, 16, 17)  # columns
_TASKS = (  # start and goal of AGV_0 to AGV_5
    ((16, 1), (19, 21)), ((4, 14), (14, 4)), ((21, 16), (6, 9)),
    ((16, 14), (4, 8)), ((16, 19), (20, 9)), ((7, 21), (20, 5)),
)  # fmt: skip


def printed_task() -> TableTask:
    """Return our reconstruction of the paper's floor and six tasks; see the study's note."""
    occupied = np.ones((SIDE, SIDE), dtype=np.bool_)
    occupied[list(_AISLES)] = occupied[:, list(_CROSS_AISLES)] = False
    return TableTask(GridMap(occupied, name="six AGVs"), *_TASKS[0], _TASKS[1:])


def _drawn(name: str, grid: GridMap, robots: int = ROBOTS) -> TableSetting:
    """Return draws of tasks between distinct endpoints; starts are two cells apart."""
    tasks = []
    for draw in range(DRAWS):
        order = np.random.default_rng([robots, draw]).permutation(len(grid.endpoints[2]))
        cells = path_of(grid.endpoints[2][k] for k in order)
        starts: list[Cell] = []
        for row, column in cells:
            if all(max(abs(row - r), abs(column - c)) > 1 for r, c in starts) and len(starts) < robots:
                starts.append((row, column))
        first, *others = zip(starts, (cell for cell in cells if cell not in starts), strict=False)
        tasks.append(TableTask(grid, *first, tuple(others)))
    return TableSetting(name, tuple(tasks))


def six_agvs() -> tuple[TableSetting, ...]:
    """Return the printed experiment, other tasks on its floor, on two of ours, and more robots than the paper has."""
    printed, paper46, narrow = printed_task(), make_layout("paper46"), make_layout("narrow")
    drawn = _drawn("its floor, other tasks", printed.grid), _drawn("paper46", paper46), _drawn("narrow", narrow)
    return TableSetting("as printed", (printed,)), *drawn, _drawn("narrow, 24 robots", narrow, 24)


def on_grid(task: TableTask, planner: Planner, rng: np.random.Generator, **rules: bool) -> Row:
    """Plan all robots alone and drive them by rules of Coordinator, or each as if alone; lengths contain waits."""
    paths = [path_of(planner.plan(task.grid, *one, rng).cells) for one in task.ends]
    arrived = all(paths)
    if rules and arrived:
        paths, arrived = Coordinator(task.grid, paths, **rules).drive()
    times = [duration(path) for path in paths]
    contacts = sum(meet(*pair) for pair in itertools.combinations(paths, 2)) if all(paths) else 0
    return driven_row(task.grid, task.ends, arrived, sum(times), max(times)) | {"contacts": contacts}
