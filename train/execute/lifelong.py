"""Lifelong plans by a grid planner in the loop: it plans a window again and again, while robots get new goals.

A planner is a class made with the floor, with a method `plan`: see GridPlanner. `pibt` is ours.
"""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from train.execute.plan import GridPlan, check_plan
from warehouse_env import plugins
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, PlanError
from warehouse_env.maps.distance import distance_field
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.maps.moves import MOVES, beyond
from warehouse_env.simulation.draws import Draws
from warehouse_env.simulation.tasks.tasks import Tasks


class GridPlanner(Protocol):
    """A planner of other robots than ours: they go to a cell beside theirs in each step, or wait."""

    def __init__(self, grid: GridMap) -> None:
        """Take the floor, whose `closed` bool[H, W] tells where robots cannot be."""

    def plan(self, state: Sequence[Cell], goals: Sequence[Cell], window: int) -> Sequence[Sequence[Cell]]:
        """Return for each robot its cells (row, column) after each of the next `window` steps."""
        ...


class Pibt:
    """Priority inheritance with backtracking (Okumura et al. 2022), one step at a time.

    The robot that has been on its way longest chooses first; one that stands on the chosen cell inherits its priority.
    Of equally near cells it takes the one straight ahead, since bodies turn slowly.
    """

    def __init__(self, grid: GridMap) -> None:
        free = ~grid.closed
        self._legal = beyond(free) & free[..., None] & (np.arange(8) % 2 == 0)  # of MOVES, none of them diagonal
        self._fields: dict[Cell, NDArray[np.float64]] = {}
        self._goals: list[Cell] = []
        self._age: list[int] = []
        self._last: list[Cell] = []

    def plan(self, state: Sequence[Cell], goals: Sequence[Cell], window: int) -> list[list[Cell]]:
        """Return the cells after each step (see GridPlanner)."""
        self._age, self._goals = self._age or [0] * len(goals), self._goals or list(goals)
        self._last = self._last or list(state)
        steps = [list(state)]
        for _ in range(window):
            arrived = (cell == goal for cell, goal in zip(steps[-1], goals, strict=True))
            fresh = (goal != before for goal, before in zip(goals, self._goals, strict=True))
            self._age = [
                0 if new or there else age + 1 for new, there, age in zip(fresh, arrived, self._age, strict=True)
            ]
            self._goals = list(goals)
            steps.append(self._step(steps[-1], goals))
        return [list(cells) for cells in zip(*steps[1:], strict=True)]

    def _step(self, state: list[Cell], goals: Sequence[Cell]) -> list[Cell]:
        after: list[Cell | None] = [None] * len(state)
        at, taken = {cell: i for i, cell in enumerate(state)}, set[Cell]()

        def chooses(i: int, pushed_from: Cell | None) -> bool:
            for cell in self._wanted(i, state[i], goals[i]):
                other = at.get(cell)
                swaps = other is not None and other != i and after[other] == state[i]
                if cell in taken or cell == pushed_from or swaps:
                    continue
                after[i] = cell
                taken.add(cell)
                if other is None or other == i or after[other] is not None or chooses(other, state[i]):
                    return True
            after[i] = state[i]
            taken.add(state[i])
            return False

        for i in sorted(range(len(state)), key=lambda i: (-self._age[i], i)):
            if after[i] is None:
                chooses(i, None)
        found = [cell for cell in after if cell is not None]
        self._last = [
            old if new == old else (2 * new[0] - old[0], 2 * new[1] - old[1])
            for old, new in zip(state, found, strict=True)
        ]
        return found

    def _wanted(self, i: int, cell: Cell, goal: Cell) -> list[Cell]:
        """Return the cells that a robot may take, the best first: by the steps from there to its goal."""
        if goal not in self._fields:
            self._fields[goal] = distance_field(self._legal, MOVES, *goal)
        field, (row, column) = self._fields[goal], cell
        free = [cell, *((row + down, column + right) for down, right in MOVES[self._legal[cell]].tolist())]
        return sorted(free, key=lambda one: (field[one], one != self._last[i], one != cell))


GRID_PLANNERS: dict[str, Callable[..., Any]] = {"pibt": Pibt}


def add_grid_planner(text: str) -> None:
    """Load a user's planner, FILE.py:CLASS or MODULE:CLASS, into GRID_PLANNERS; ConfigError if it is none."""
    plugins.add(text, "grid_planner", GRID_PLANNERS, ("plan(state, goals, window)",))


def plan_lifelong(
    name: str, config: EnvConfig, steps: int, window: int, seed: int, tick: Callable[[int], None] = lambda step: None
) -> GridPlan:
    """Return the plan of a planner for lifelong tasks, drawn as those of an episode with this seed.

    window: steps after which it plans anew; a goal that is reached in between is replaced at once, but known to it
    only then. tick: called with the steps done. PlanError if the plan breaks the rules, ConfigError for a planner that
    is none.
    """
    grid = make_layout(config.layout)
    tasks, draws = Tasks(grid, config), Draws(1)
    draws.begin(0, [seed, 0])
    key, robots = draws.keys[0], config.num_agents
    tasks.reset(key)
    state = tasks.starts(key)[:robots]
    if len(state) < robots:
        raise ConfigError(f"num_agents={robots} is too many for {config.layout}: it has {len(state)} endpoints")
    goals, cells, done = tasks.first_goals(state, key), [state], [list[int]() for _ in range(robots)]
    planner = plugins.make(name, "grid_planner", GRID_PLANNERS, {}, grid)
    while len(cells) <= steps:
        with plugins.running(name):
            paths = [
                [(int(row), int(column)) for row, column in path]
                for path in planner.plan(list(cells[-1]), list(goals), window)
            ]
        if len(paths) != robots or not all(len(path) >= window for path in paths):
            raise PlanError(f"{name} must plan {window} cells (row, column) for each of {robots} robots")
        rows = np.array([path[:window] for path in paths])
        for after in rows.transpose(1, 0, 2)[: steps + 1 - len(cells)].tolist():
            cells.append([(row, column) for row, column in after])
            for i in [i for i in range(robots) if cells[-1][i] == goals[i]]:
                done[i].append(len(cells) - 1)
                goals[i] = tasks.next_goal(i, goals[i], key)
        tick(len(cells) - 1)
    plan = GridPlan(np.array(cells, np.int64), tuple(map(tuple, done)))
    check_plan(plan.cells, grid)
    return plan
