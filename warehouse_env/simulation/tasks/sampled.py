"""Starts and goals by name: those of the project, and a user's own sampler.

Under one-shot tasks no body parked at a goal cuts another robot off from its own goal. A robot parks as soon as its
front axle is within `arrival_radius` of its goal, at any heading. So its body lies in a disc around the goal's centre.
A body that drives along the grid's lines keeps off that disc on every cell whose centre is half a body's width further
out. Tasks are well-formed if eq. 26 moves over free cells outside the discs of all other goals join each robot's start
and goal. This is the condition of well-formed infrastructures (Cap, Novak, Kleiner & Selecky 2015) for goals alone,
checked exactly on the grid for the worst parking poses. In any order of arrivals, a robot alone on the floor could then
still drive to its goal.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env import plugins
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.moves import label_regions
from warehouse_env.simulation.draws import GOAL, TRIAL, Key, below
from warehouse_env.simulation.tasks.goals import NONE, GoalState, draw
from warehouse_env.simulation.tasks.placement import GAP
from warehouse_env.simulation.tasks.tasks import Tasks

MARGIN = 0.05  # [m] between a passing body and the disc of a parked one


def disc_of(config: EnvConfig, cell: float) -> NDArray[np.int64]:
    """Return int64[K, 2]: where (row, column), from a goal's cell, a parked body may bar a cell of `cell` [m]."""
    off = config.pose_radius if config.arrival == "pose" else config.arrival_radius
    reach = (off + config.widest_body.farthest + config.widest_body.width / 2 + MARGIN) / cell
    steps = np.arange(-math.floor(reach), math.floor(reach) + 1)
    offsets = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    within: NDArray[np.int64] = offsets[(offsets**2).sum(axis=1) < reach * reach]
    return within


def covered(cell: Cell, disc: NDArray[np.int64], shape: tuple[int, ...]) -> tuple[NDArray[np.int64], ...]:
    """Return the cells that a body parked on a cell may bar, as an index into arrays of a floor's shape."""
    cells = disc + cell
    return tuple(cells[((cells >= 0) & (cells < shape)).all(axis=1)].T)


def cut_off(
    grid: GridMap, starts: NDArray[np.int64], goals: NDArray[np.int64], disc: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Return bool[N]: robots whose goal bodies parked at the other goals cut off from its start; cells int64[N, 2].

    disc: see `disc_of`.
    """
    discs = [covered(goal, disc, grid.shape) for goal in map(tuple, goals.tolist())]
    bodies, found = np.zeros(grid.shape, np.int32), []  # how many bar a cell
    for cells in discs:
        bodies[cells] += 1
    for cells, start, goal in zip(discs, starts, goals, strict=True):
        bodies[cells] -= 1
        region = label_regions(~grid.closed & (bodies == 0))
        bodies[cells] += 1
        found.append(region[tuple(start)] == 0 or region[tuple(start)] != region[tuple(goal)])
    return np.array(found, dtype=np.bool_)


TRIALS = 400  # redraws of goals that are cut off; usually a few tens at most
NEAR = 8  # goals nearest to a start or goal, among which a blocking one is sought


class OneShotTasks(Tasks):
    """Goals that are distinct, and well-formed where possible.

    Starts are endpoints far enough apart for bodies of any heading. Then robot after robot draws a goal whose disc of
    parking poses covers nobody else's start or goal; whoever is cut off all the same draws anew, and so does one that
    may bar it. On a floor too small for its robots some stay cut off after TRIALS of that: see `cut_off`.
    """

    def __init__(self, grid: GridMap, config: EnvConfig, state: GoalState | None = None, world: int = 0) -> None:
        super().__init__(grid, config, state, world)
        self._disc = disc_of(config, grid.cell_size)
        self._reach = int((self._disc**2).sum(axis=1).max())  # squared [cells]
        self._apart = (2 * config.widest_body.farthest + float(GAP)) / grid.cell_size  # [cells] between starts
        self._starts: list[Cell] = []
        self._ends = np.zeros((config.num_agents, 2), dtype=np.int64)  # the goals

    def starts(self, key: Key) -> list[Cell]:
        """Return all places, those first that are far enough from each other."""
        first: list[Cell] = []
        rest: list[Cell] = []
        for cell in super().starts(key):
            roomy = all(math.dist(cell, other) >= self._apart for other in first)
            (first if roomy else rest).append(cell)
        return first + rest

    def elsewhere(self, key: Key) -> list[Cell]:
        """Return none: goals are well-formed for starts on places."""
        return []

    def first_goals(self, starts: Sequence[Cell], key: Key) -> list[Cell]:
        """Draw goals; redraw one that is cut off and one that may block it, while no more are cut off."""
        self._starts = list(starts)
        for robot in range(len(starts)):
            self._redraw(robot, self._wanted(robot), key)
        lost, goals = np.flatnonzero(self._cut_off()), self._state.goal[self._world]
        for trial in range(TRIALS):
            if not len(lost):
                break
            robot, before = int(lost[below(key, TRIAL, 0, trial, 0, len(lost))]), goals.tolist()
            near = self._neighbours(robot)
            for one in sorted({robot, int(near[below(key, TRIAL, 0, trial, 1, len(near))])}):
                self._redraw(one, self._endpoints.all, key)
            cut_off = np.flatnonzero(self._cut_off())
            if len(cut_off) <= len(lost):
                lost = cut_off
            else:
                goals[:], self._ends[:] = before, [self.places[number] for number in before]
                self._state.taken[self._world] = np.isin(self._endpoints.all, before)
        return [self.places[number] for number in goals.tolist()]

    def assign(self, starts: Sequence[Cell], goals: Sequence[Cell]) -> None:
        """Take these as the robots' starts and goals."""
        super().assign(starts, goals)
        self._starts, self._ends[:] = list(starts), goals

    def next_goal(self, robot: int, at: Cell, key: Key) -> Cell:
        """Give a goal to a robot whose start has changed."""
        self._starts[robot] = at
        return self._redraw(robot, self._wanted(robot), key)

    def cut_off(self) -> float:
        """Return how many robots others parked at their goals could cut off from theirs; nan before the first reset."""
        return float(self._cut_off().sum()) if self._starts else math.nan

    def _wanted(self, robot: int) -> NDArray[np.int32]:
        """Return the endpoints of the kind of a robot's next goal."""
        return self._endpoints.kinds[self._state.next_kind[self._world, robot]]

    def _redraw(self, robot: int, wanted: NDArray[np.int32], key: Key) -> Cell:
        """Give a robot another goal, a wanted one if its disc can cover no other start or goal, else any free one."""
        state, at, start = self._state, (self._world, robot), self._number(self._starts[robot])
        taken, old = state.taken[self._world], state.goal[at]
        if old != NONE:
            taken[old] = False
        state.goal[at] = NONE
        state.drawn[at] += 1
        drawn, others = int(state.drawn[at]), self._others(robot)
        for numbers in (wanted, self._endpoints.all):
            roomy = self._apart_from(numbers, others)
            roomy = roomy[roomy != start]
            if len(roomy):
                goal = int(roomy[below(key, GOAL, robot, drawn, 0, len(roomy))])
                break
        else:
            goal = int(draw(self._endpoints.all, taken, start, key, robot, drawn))
            goal = start if goal == NONE else goal
        state.goal[at], taken[goal], self._ends[robot] = goal, True, self.places[goal]
        return self.places[goal]

    def _neighbours(self, robot: int) -> NDArray[np.int64]:
        """Return int64[K]: the robots whose goals lie nearest to a robot's start or goal, and so may bar it."""
        own = np.array([self._starts[robot], self._ends[robot]], dtype=np.int64)
        squared = ((self._ends[:, None] - own[None]) ** 2).sum(axis=2).min(axis=1)
        squared[robot] = squared.max() + 1
        return np.argsort(squared, kind="stable")[:NEAR]

    def _others(self, robot: int) -> NDArray[np.int64]:
        """Return int64[K, 2], the starts and goals of all other robots."""
        starts = [cell for k, cell in enumerate(self._starts) if k != robot]
        goals = self._ends[self._state.goal[self._world] != NONE]
        return np.concatenate([np.array(starts, dtype=np.int64).reshape(-1, 2), goals])

    def _cut_off(self) -> NDArray[np.bool_]:
        return cut_off(self._grid, np.array(self._starts, dtype=np.int64), self._ends, self._disc)

    def _apart_from(self, numbers: NDArray[np.int32], others: NDArray[np.int64]) -> NDArray[np.int32]:
        """Return those of some endpoints at which a parked body bars none of `others` int64[K, 2]."""
        if not len(others):
            return numbers
        apart = (self._endpoints.cells[numbers, None] - others[None]) ** 2
        roomy: NDArray[np.int32] = numbers[apart.sum(axis=2).min(axis=1) > self._reach]
        return roomy


TASKS: dict[str, Callable[..., Any]] = {"lifelong": Tasks, "one_shot": OneShotTasks}
"""What EnvConfig.tasks names: subclasses of Tasks, and samplers, which are made from an EnvConfig and a GridMap and
keep nothing from one call to the next."""

_MEMBERS = ("starts(rng)", "goal(rng, robot, at, taken)")


def add_tasks(text: str) -> None:
    """Load a user's sampler, "my_tasks.py:Mine" or "module:Mine", into TASKS; ConfigError if it is none."""
    plugins.add(text, "tasks", TASKS, _MEMBERS)


class SampledTasks(Tasks):
    """Starts and goals of a sampler, cells (row, column); goals are distinct at any moment."""

    bound = (*Tasks.bound, "_sampler")

    def __init__(self, grid: GridMap, config: EnvConfig, state: GoalState | None = None, world: int = 0) -> None:
        self._config, self._goals = config, dict[int, Cell]()
        super().__init__(grid, config, state, world)

    def _bind(self) -> None:
        super()._bind()
        self._sampler = plugins.make(self._config.tasks, "tasks", TASKS, {}, self._config, self._grid)
        plugins.check_has(self._config.tasks, "tasks", self._sampler, _MEMBERS)

    def reset(self, key: Key) -> None:
        """Forget all goals."""
        super().reset(key)
        self._goals.clear()

    def starts(self, key: Key) -> list[Cell]:
        """Return the sampler's starts, the first for robot 0, or fewer; robots beyond these start elsewhere."""
        with plugins.running(self._config.tasks):
            cells = list(self._sampler.starts(np.random.default_rng(key)))
        return [self._grid.check_cell(cell, f"start by {self._config.tasks}") for cell in cells]

    def assign(self, starts: Sequence[Cell], goals: Sequence[Cell]) -> None:
        """Take these as the robots' first goals."""
        super().assign(starts, goals)
        self._goals = dict(enumerate(goals))

    def next_goal(self, robot: int, at: Cell, key: Key) -> Cell:
        """Return the sampler's next goal of a robot that is at a cell; ConfigError if it is there or another's."""
        drawn, taken = self._state.drawn[self._world], {g for k, g in self._goals.items() if k != robot}
        drawn[robot] += 1
        with plugins.running(self._config.tasks):
            goal = self._sampler.goal(np.random.default_rng([*key, robot, drawn[robot]]), robot, at, taken)
        found = self._goals[robot] = self._grid.check_cell(goal, f"goal by {self._config.tasks}")
        if found in taken or found == at:
            raise ConfigError(f"{self._config.tasks} sends robot {robot} to {found}, where it is or another goes")
        return found
