"""Starts and goals by name: those of the project, and a user's own sampler."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from warehouse_env import plugins
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.simulation.draws import Key
from warehouse_env.simulation.tasks.goals import GoalState
from warehouse_env.simulation.tasks.one_shot import OneShotTasks
from warehouse_env.simulation.tasks.tasks import Tasks

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
