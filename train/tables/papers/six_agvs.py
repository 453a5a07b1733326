"""Section 3.3 of paper 001: six AGVs, and what its rules for conflicts cost."""

from __future__ import annotations

import itertools

import numpy as np

from train.reporting.rows import Row
from train.tables.papers.coordinator import Coordinator, duration, meet, path_of
from train.tables.study import TableSetting, TableTask, driven_row
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.planning import Planner

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


def settings() -> tuple[TableSetting, ...]:
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
