"""Paper 002's avoidance of an obstacle that the global path does not know, on its 30 x 30 cells, and other answers.

The paper (discussion, and conclusion 2) lets the robot follow its global path, avoid obstacles by the improved
potential field, and plan the rest again from where it then is. Our reading: within REACH of the obstacle the robot
makes, each step, the legal move with the smallest angle to the force of eqs. 16-20. The path's cell LOOK cells ahead
attracts; shelves and the obstacle repel. Out of reach the robot follows its path, and replans if it has left it. It
knows where the obstacle is, not where it goes; the obstacle ignores the robot. Both make one move a step.
"""

import itertools
import math
from collections.abc import Callable
from functools import partial

import numpy as np

from train.reporting.rows import Row
from train.tables.papers.coordinator import TOUCH, Path, duration, gaps, path_of
from train.tables.papers.settings import clutter_task
from train.tables.study import TableSetting, TableTask, driven_row
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning import Planner, make_planner, path_length, turns
from warehouse_env.planning.field_walkers import along
from warehouse_env.planning.potential_field import force_at, intermediate_point, repulsion

STANDING, CROSSING, ONCOMING = "standing obstacle", "crossing obstacle", "oncoming obstacle"
SIZE, SHARE, MAPS = 30, 0.2, 24
START, GOAL = (0, 0), (29, 27)

# d0 [cells] and k_rep of the obstacle. Of gains 1 to 60, reaches 2.5 to 6 and looks 4 to 12, tried on maps 200 to 213,
# these avoid the most by the classical field, and within two points of the most by the improved one.
REACH, GAIN = 4.0, 60.0
SHELVES_GAIN, SHELVES_REACH = 0.3, 2.0  # as in the walkers' table
LOOK = 8  # [cells]
PATIENCE = 4  # times the steps of the path, after which a robot is given up


def cells_of(planner: Planner, grid: GridMap, start: Cell, goal: Cell) -> Path:
    """Return the cells of a plan, none if there is no path; the planners used here draw nothing."""
    return path_of(planner.plan(grid, start, goal, np.random.default_rng(0)).cells)


class Avoider:
    """A robot on its global path. The methods that take an obstacle within REACH return the robot's next cell."""

    def __init__(self, task: TableTask, planner: Planner) -> None:
        self.grid, self.goal, self.at, self._planner = task.grid, task.goal, task.start, planner
        self.path = cells_of(planner, self.grid, self.at, self.goal)
        self._shelves = repulsion(self.grid.occupied, SHELVES_GAIN, SHELVES_REACH)
        self._tried = np.zeros(self.grid.shape, np.bool_)  # intermediate points
        self.point: Cell | None = None  # the intermediate point that the robot heads for

    def follow(self, _obstacle: Cell | None = None) -> Cell:
        """Return the next cell of the path; replan if the robot has left it."""
        if self.at not in self.path:
            self.path = cells_of(self._planner, self.grid, self.at, self.goal)
        return self.path[min(self.path.index(self.at) + 1, len(self.path) - 1)]

    def wait(self, obstacle: Cell) -> Cell:
        """Stand while the next cell is the obstacle's or one beside it."""
        row, column = self.follow()
        return self.at if max(abs(row - obstacle[0]), abs(column - obstacle[1])) <= 1 else (row, column)

    def new_route(self, obstacle: Cell) -> Cell:
        """Replan around the obstacle and the cells beside it; if there is no way, around its own cell."""
        for margin in (1, 0):
            occupied = self.grid.occupied.copy()
            occupied[tuple(slice(max(at - margin, 0), at + margin + 1) for at in obstacle)] = True
            occupied[self.at] = occupied[self.goal] = False
            path = cells_of(self._planner, GridMap(occupied), self.at, self.goal)
            if path:
                self.path = path
                return self.follow()
        return self.at

    def by_field(self, obstacle: Cell, exponent: float = 1.0, points: bool = False) -> Cell:
        """Follow the force (exponent 0: the classical one); `points`: where stuck, head for an intermediate point."""
        if self.point == self.at:
            self.point = None
        # The path's cell nearest to the robot, the last of several, and from there LOOK cells on.
        here = min(range(len(self.path)), key=lambda k: (math.dist(self.path[k], self.at), -k))
        ahead = self.path[min(here + LOOK, len(self.path) - 1)]
        to = self.pushed(obstacle, self.point or ahead, exponent)
        if to is None and points:
            occupied = self.grid.occupied.copy()
            occupied[obstacle] = True
            row, column = intermediate_point(occupied, self.at, ahead, self._tried)
            if row >= 0:
                self.point = (int(row), int(column))
                self._tried[self.point] = True
                to = self.pushed(obstacle, self.point, exponent)
        return to or self.at

    def pushed(self, obstacle: Cell, target: Cell, exponent: float) -> Cell | None:
        """Return the cell to which the force leads; None where it leads nowhere."""
        at, legal = np.array(self.at), self.grid.legal_moves[self.at] & (MOVES + self.at != obstacle).any(axis=1)
        push, energy = (part[self.at] for part in self._shelves)
        distance = math.dist(self.at, obstacle)
        near = 1 / distance - 1 / REACH
        push = push + GAIN * near / distance**3 * (at - obstacle)  # eq. 14
        energy, pull = energy + 0.5 * GAIN * near**2, (np.array(target) - at).astype(np.float64)
        force = force_at(pull[0], pull[1], push[0], push[1], energy, 1.0, exponent)
        move = along(legal, force[0], force[1])
        return None if move < 0 else path_of([at + MOVES[move]])[0]


Answer = Callable[[Avoider, Cell], Cell]
ANSWERS: dict[str, Answer] = {
    "follows its path": Avoider.follow,
    "classical field": partial(Avoider.by_field, exponent=0.0),
    "improved field": Avoider.by_field,
    "improved field, intermediate point": partial(Avoider.by_field, points=True),
    "waits": Avoider.wait,
    "new route": Avoider.new_route,
}


def avoid(task: TableTask, planner: Planner, _rng: np.random.Generator, *, answer: Answer) -> Row:
    """Drive a robot past its obstacle, which drives a shortest path and stays at its end; return the row's figures."""
    robot, obstacle = Avoider(task, planner), cells_of(make_planner("astar_turns"), task.grid, *task.others[0])
    cells = [robot.at]
    for step in range(PATIENCE * len(robot.path)):
        here = obstacle[min(step, len(obstacle) - 1)]
        near = 0.0 < math.dist(robot.at, here) < REACH
        if not near:
            robot.point = None
        robot.at = answer(robot, here) if near else robot.follow()
        cells.append(robot.at)
        if robot.at == robot.goal:
            break
    apart = min(gaps(cells, obstacle, len(cells) - 1))
    good = robot.at == robot.goal and apart >= TOUCH
    kept = np.array([cells[0], *(to for at, to in itertools.pairwise(cells) if at != to)])
    row = driven_row(task.grid, task.ends[:1], good, path_length(kept), duration(cells))
    return row | {"turns": turns(kept) if good else None, "contacts": int(apart < TOUCH), "apart": apart}


def met_at(path: Path, other: Path) -> int | None:
    """Return the step in which two robots clash that start together along their paths, None if they do not."""
    steps = enumerate(gaps(path, other, min(len(path), len(other)) - 1))
    return next((step for step, gap in steps if gap < TOUCH), None)


def obstacles(seed: int) -> dict[str, TableTask]:
    """Return a map with an obstacle of each kind that clashes with a robot in the middle half of its path."""
    grid = clutter_task(SIZE, SHARE, seed, (START, GOAL)).grid
    planner, rng = make_planner("astar_turns"), np.random.default_rng([SIZE, seed])
    path = cells_of(planner, grid, START, GOAL)
    middle = range(len(path) // 4, 3 * len(path) // 4)
    ends = {STANDING: (path[int(rng.choice(middle))],) * 2}
    while len(ends) < 3:
        cells = np.array(path) if CROSSING in ends else grid.free_cells
        start, goal = path_of(cells[rng.integers(0, len(cells), 2)])
        other = cells_of(planner, grid, start, goal)
        step = met_at(path, other)
        if step is None or step not in middle:
            continue
        shared = len(set(path) & set(other))
        if shared <= 1:
            ends.setdefault(CROSSING, (start, goal))
        elif shared > 4 and other[step - 2] in path[step:]:
            ends.setdefault(ONCOMING, (start, goal))
    return {kind: TableTask(grid, START, GOAL, (one,)) for kind, one in ends.items()}


def moving_obstacle() -> tuple[TableSetting, ...]:
    """Return the floors with an obstacle that stands, crosses, or comes towards the robot."""
    every = [obstacles(seed) for seed in range(MAPS)]
    return tuple(TableSetting(kind, tuple(one[kind] for one in every)) for kind in (STANDING, CROSSING, ONCOMING))
