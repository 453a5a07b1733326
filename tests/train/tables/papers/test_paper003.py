"""The table of paper 003: maps that trap, printed shares, claims that can be judged."""

from __future__ import annotations

import math

import numpy as np
import pytest

from train.tables.papers.paper003 import (
    COMPLEX,
    CONCAVE,
    E_SHAPED,
    OURS,
    SHIPPED,
    SIMPLE,
    STUDIES,
    settings,
)

TABLE, MORE = STUDIES


def test_maps_are_as_the_text_says() -> None:
    maps = {setting.name: setting.tasks[0] for setting in settings()}
    assert list(maps) == [E_SHAPED, CONCAVE, SIMPLE, COMPLEX]
    assert [task.grid.shape for task in maps.values()] == [(20, 20), (20, 20), (20, 20), (50, 50)]
    for name, least in ((SIMPLE, 0.2), (COMPLEX, 0.3)):
        assert least <= maps[name].grid.occupied.mean() < least + 0.03
    for task in maps.values():
        assert math.isfinite(task.grid.distance_to(task.goal)[task.start])


@pytest.mark.parametrize("index", [0, 1])
def test_the_single_obstacles_trap(index: int) -> None:
    # Going straight to the goal ends inside: some cell is nearer to the goal than all its free neighbours.
    task = settings()[index].tasks[0]
    grid, goal = task.grid, task.goal
    rows, columns = np.indices(grid.shape)
    far = np.where(grid.occupied, np.inf, np.hypot(rows - goal[0], columns - goal[1]))
    inside = far[4:16, 6:13]
    row, column = np.unravel_index(np.argmin(inside), inside.shape)
    row, column = row + 4, column + 6
    assert far[row, column] == far[row - 1 : row + 2, column - 1 : column + 2].min()
    assert grid.distance_to(goal)[row, column] > 2 * far[row, column]


def test_more_maps_are_other_maps() -> None:
    keys = {task.grid.key for setting in (*settings(), *MORE.settings()) for task in setting.tasks}
    assert len(keys) == 4 + 24


def test_the_shipped_system_is_optimal_and_the_papers_is_at_the_traps() -> None:
    systems = {system.label: system.make() for system in TABLE.systems}
    for setting in settings():
        task = setting.tasks[0]
        grid, start, goal = task.grid, task.start, task.goal
        optimum = float(grid.distance_to(goal)[start])
        for label in (SHIPPED, OURS) if setting.name in (E_SHAPED, CONCAVE) else (SHIPPED,):
            for seed in range(3):
                plan = systems[label].plan(grid, start, goal, np.random.default_rng(seed))
                assert plan.best_by_iteration[-1] == pytest.approx(optimum)
