"""Paper 002's claims on obstacles that come into a robot's way, on its floor of 30 x 30 cells."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from train.tables.maps import clutter_task
from train.tables.papers.avoidance import FORESIGHT, LOOK, PATIENCE, REACH, avoid, cells_of
from train.tables.papers.coordinator import Path, clash
from train.tables.papers.six_agvs import resolves_all
from train.tables.study import Claim, Setting, Study, System, TableTask
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning import make_planner

STANDING, CROSSING, ONCOMING = "standing obstacle", "crossing obstacle", "oncoming obstacle"
SIZE, SHARE, MAPS = 30, 0.2, 24
START: Cell = (0, 0)
GOAL: Cell = (29, 27)
OURS, CLASSICAL, WITH_POINT = "improved field", "classical field", "improved field, intermediate point"
HEEDLESS, WAITING, NEW_ROUTE, BEST = "follows its path", "waits", "new route", "knows the obstacle's way"
_MODES = {
    HEEDLESS: "heedless", CLASSICAL: "classical field", OURS: "improved field", WITH_POINT: "improved field, point",
    WAITING: "wait", NEW_ROUTE: "new route", BEST: FORESIGHT,
}  # fmt: skip


def met_at(path: Path, other: Path) -> int | None:
    """Return the step in which two touch that start together along their paths, None if they do not."""
    steps = min(len(path), len(other)) - 1
    touched = (k for k in range(steps) if clash(path[k], path[k + 1], other[k], other[k + 1]))
    return next(touched, None)


def _met(seed: int) -> Iterator[tuple[str, TableTask]]:
    """Yield a map with an obstacle of each kind on it, which touches a robot that follows its path half-way or so."""
    grid = clutter_task(SIZE, SHARE, seed, START, GOAL).grid
    planner, rng = make_planner("astar_turns"), np.random.default_rng([SIZE, seed])
    path = cells_of(planner, grid, START, GOAL)
    middle = range(len(path) // 4, 3 * len(path) // 4)
    yield STANDING, _task(grid, *[path[int(rng.choice(middle))]] * 2)
    wanted = {CROSSING, ONCOMING}
    while wanted:
        cells = grid.free_cells if CROSSING in wanted else np.array(path)
        start, goal = ((int(row), int(column)) for row, column in cells[rng.integers(0, len(cells), 2)])
        other = cells_of(planner, grid, start, goal)
        step = met_at(path, other)
        if step is None or step not in middle:
            continue
        shared = len(set(path) & set(other))
        kind = CROSSING if shared <= 1 else ONCOMING if other[step - 2] in path[step:] and shared > 4 else ""
        if kind in wanted:
            wanted.remove(kind)
            yield kind, _task(grid, start, goal)


def _task(grid: GridMap, start: Cell, goal: Cell) -> TableTask:
    return TableTask(grid, START, GOAL, ((start, goal),))


def settings() -> tuple[Setting, ...]:
    """Return the floors with an obstacle that stands, crosses, or comes towards the robot."""
    every = [dict(_met(seed)) for seed in range(MAPS)]
    return tuple(Setting(kind, tuple(one[kind] for one in every)) for kind in (STANDING, CROSSING, ONCOMING))


MOVING_OBSTACLE = Study(
    name="002_moving_obstacle",
    paper="Paper 002 (about 2023), ant colony and improved artificial potential field for agricultural robots",
    title="Paper 002: an obstacle that the global path does not know",
    settings=settings,
    systems=tuple(System(label, "astar_turns", mode=mode) for label, mode in _MODES.items()),
    runs=1,
    measures=("found_share", "mean", "gap", "last", "apart", "turns"),
    claims=(
        *(
            Claim(f"The robot avoids {what} obstacles", check=partial(resolves_all, ours=WITH_POINT, settings=kinds))
            for what, kinds in (("temporary", (STANDING,)), ("dynamic", (CROSSING, ONCOMING)))
        ),
        Claim("The improved repulsion avoids more obstacles than the classical", OURS, CLASSICAL, "found_share"),
        Claim("The intermediate point avoids more of them", WITH_POINT, OURS, "found_share"),
        Claim("It has the shortest path: shorter than a new route in every step", WITH_POINT, NEW_ROUTE, "mean"),
        Claim(
            "Stronger obstacle avoidance: further off than a new route in every step", WITH_POINT, NEW_ROUTE, "apart"
        ),
    ),
    note="The paper says that it avoids temporary and dynamic obstacles by the improved field and then plans the "
    "rest of the path again, that the path is the shortest and the avoidance the stronger one; our copy has neither "
    f"figures nor a picture of it. Ours: its 30 x 30 cells, start and goal, {SHARE:.0%} of random clutter, {MAPS} "
    "maps; one obstacle that a robot which follows its path touches in the middle half of its way. It stands there, "
    "or drives a shortest path of its own at the robot's speed that shares one cell with the robot's or runs along it "
    f"the other way, and heeds nobody. The obstacle's field reaches {REACH:g} cells and pulls to the path's cell "
    f"{LOOK} cells on; gains were chosen on other maps. Found: the goal reached without touch, in {PATIENCE} times "
    "the path's steps. Length: cells driven; last arrival: with waits, a cell a second. Distance: least, between "
    "centres, 0.71 where one follows the other round a corner. All walks draw nothing.",
    pictured=(CROSSING, ONCOMING),
    experiment=avoid,
)
