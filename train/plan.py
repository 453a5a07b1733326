"""`warehouse plan`: planners against each other on the tasks of one map -> rows, a table, pictures."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.plan_report import plan_note, plan_table
from train.report import make_progress, require_charts
from train.rows import Row, RowFile, check_writable, write_text
from warehouse_env import __version__
from warehouse_env.errors import ConfigError, MapError, PlanError
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.layouts import NAMED_TASKS, make_layout
from warehouse_env.maps.movingai import read_map, read_scen
from warehouse_env.planning import Plan, Planner, climb, make_planner, min_turns, path_length, turns, validate

_RANDOM_TASKS = 5  # on a floor without named tasks


class Task(NamedTuple):
    """A start and a goal with the length that no path can beat and the fewest turns of a path of that length."""

    name: str
    start: Cell
    goal: Cell
    optimal_length: float  # [cells]
    min_turns: int


@dataclass(frozen=True)
class PlanCommand:
    """Compare planners on the tasks of a map: how often they find the shortest path, with how many turns, how fast."""

    layout: str = "paper46"
    """Name of the layout; its named tasks are planned unless other tasks are given."""
    map: Path | None = None
    """A MovingAI .map file instead of the layout."""
    scen: Path | None = None
    """A MovingAI .scen file with tasks for the map; without --map, the map of that name beside it is used."""
    planner: tuple[str, ...] = ("pf_aco", "aco", "astar_turns", "astar")
    """Planners to compare."""
    start: str | None = None
    """Start of a single task, as ROW,COLUMN."""
    goal: str | None = None
    """Goal of a single task, as ROW,COLUMN."""
    tasks: int | None = None
    """Number of tasks: drawn from the scenario file where one is given, else at random from the floor."""
    runs: int = 30
    """Runs of each planner on each task, each with its own seed."""
    seed: int = 0
    """Seed of the runs, and of tasks that are drawn."""
    json: Path | None = None
    """Write the rows, one a run, to this file as JSON lines."""
    out: Path = Path("results/plan")
    """Folder for the table and the pictures of the paths and of the convergence."""
    pictures: bool = True
    """Draw the pictures."""

    def run(self) -> None:
        """Plan all, print the table, write rows and pictures."""
        if self.runs < 1 or self.seed < 0:
            raise ConfigError(f"--runs {self.runs} must be at least 1 and --seed {self.seed} at least 0")
        planners = [make_planner(name) for name in dict.fromkeys(self.planner)]
        if not planners:
            raise ConfigError("--planner needs at least one name")
        grid = self._grid()
        tasks = [_task(grid, *task) for task in self._tasks(grid)]
        check_writable(self.out / "table.md")
        if self.pictures:
            require_charts()
        file, rows, kept = RowFile(self.json), [], []
        try:
            for run in _runs(grid, planners, tasks, self.runs, self.seed):
                rows.append(run.row)
                kept.append(run)
                file.add([run.row])
        except KeyboardInterrupt:
            raise KeyboardInterrupt(file.kept()) from None
        table = plan_table(rows, plan_note(rows))
        table.print()
        write_text(self.out / "table.md", table.markdown())
        if self.pictures:
            from train.pictures import plan_pictures

            plan_pictures(grid, kept, self.out)
        print(f"wrote the table{' and the pictures' if self.pictures else ''} to {self.out}")

    def _grid(self) -> GridMap:
        if self.map is not None:
            return read_map(self.map)
        if self.scen is not None:
            names = {scenario.map_name for scenario in read_scen(self.scen)}
            if len(names) != 1:
                raise MapError(f"{self.scen} names {len(names)} maps; choose one with --map")
            return read_map(self.scen.parent / Path(names.pop()).name)
        return make_layout(self.layout)

    def _tasks(self, grid: GridMap) -> list[tuple[str, Cell, Cell]]:
        """Return (name, start, goal) of the tasks that the options ask for."""
        if self.tasks is not None and self.tasks < 1:
            raise ConfigError(f"--tasks {self.tasks} must be at least 1")
        if (self.start is None) != (self.goal is None):
            raise ConfigError("--start and --goal belong together; give both")
        if self.start is not None and self.goal is not None:
            if self.tasks is not None or self.scen is not None:
                raise ConfigError("--start and --goal name the only task; leave --tasks and --scen out")
            return [("start_goal", _cell(self.start, "--start"), _cell(self.goal, "--goal"))]
        if self.scen is not None:
            return _scenario_tasks(self.scen, grid, self.tasks, self.seed)
        named = NAMED_TASKS.get(self.layout, {}) if self.map is None and self.tasks is None else {}
        if named:
            return [(name, task.start, task.goal) for name, task in named.items()]
        return _random_tasks(grid, self.tasks or _RANDOM_TASKS, self.seed)


def _cell(text: str, option: str) -> Cell:
    found = re.fullmatch(r"\s*\(?\s*(-?\d+)\s*,\s*(-?\d+)\s*\)?\s*", text)
    if found is None:
        raise ConfigError(f"{option} {text!r} must be ROW,COLUMN, two whole numbers as in 22,1")
    return int(found[1]), int(found[2])


def _scenario_tasks(path: Path, grid: GridMap, count: int | None, seed: int) -> list[tuple[str, Cell, Cell]]:
    scenarios = list(enumerate(read_scen(path), start=1))
    for number, scenario in scenarios:
        if (scenario.height, scenario.width) != grid.shape:
            raise MapError(
                f"{path}: scenario {number} is for a map of {scenario.height} x {scenario.width} cells, "
                f"but the map has {grid.shape[0]} x {grid.shape[1]}"
            )
    if count is not None and count < len(scenarios):
        chosen = np.random.default_rng([seed, 0]).choice(len(scenarios), count, replace=False)
        scenarios = [scenarios[index] for index in sorted(chosen.tolist())]
    return [(f"scenario_{number}", scenario.start, scenario.goal) for number, scenario in scenarios]


def _random_tasks(grid: GridMap, count: int, seed: int) -> list[tuple[str, Cell, Cell]]:
    rng, free = np.random.default_rng([seed, 0]), grid.free_cells
    if len(free) < 2:
        raise MapError(f"map {grid.name!r} has no two connected free cells to plan between")
    pairs = [free[rng.choice(len(free), 2, replace=False)].tolist() for _ in range(count)]
    return [(f"random_{k}", (a[0], a[1]), (b[0], b[1])) for k, (a, b) in enumerate(pairs, start=1)]


def _task(grid: GridMap, name: str, start: Cell, goal: Cell) -> Task:
    """Return the task with its truth, by exact search; MapError or PlanError if it has no solution."""
    start, goal = grid.check_cell(start, "start"), grid.check_cell(goal, "goal")
    length = float(grid.distance_to(goal)[start])
    if not math.isfinite(length):
        raise PlanError(f"no path leads from {start} to {goal} on map {grid.name!r}; choose connected cells")
    return Task(name, start, goal, length, min_turns(grid, start, goal))


@dataclass(frozen=True)
class Run:
    """One plan with its row; the cells and the convergence curve are for the pictures."""

    task: Task
    planner: str
    row: Row
    cells: NDArray[np.int64] = field(repr=False)
    best_by_iteration: NDArray[np.float64] = field(repr=False)


def _runs(grid: GridMap, planners: list[Planner], tasks: list[Task], runs: int, seed: int) -> Iterator[Run]:
    """Yield every run, under a progress bar; a first plan of each planner, which may compile, is thrown away."""
    with make_progress() as progress:
        bar = progress.add_task("", total=len(planners) * len(tasks) * runs)
        for planner in planners:
            progress.update(bar, description=f"{planner.name}: warming up")
            planner.plan(grid, tasks[0].start, tasks[0].goal, np.random.default_rng(seed))
            for number, task in enumerate(tasks):
                progress.update(bar, description=f"{planner.name} · {task.name}")
                for run in range(runs):
                    plan = planner.plan(grid, task.start, task.goal, np.random.default_rng([seed, number, run]))
                    yield _run(grid, planner, task, run, seed, plan)
                    progress.advance(bar)


def _run(grid: GridMap, planner: Planner, task: Task, run: int, seed: int, plan: Plan) -> Run:
    if plan.found:
        validate(grid, plan.cells, task.start, task.goal)
    length = path_length(plan.cells)
    row: Row = {
        "planner": planner.name,
        "layout": grid.name,
        "task": task.name,
        "start": list(task.start),
        "goal": list(task.goal),
        "run": run,
        "seed": seed,
        "success": plan.found,
        "length": length if plan.found else None,
        "optimal_length": task.optimal_length,
        "gap": length / task.optimal_length - 1 if plan.found and task.optimal_length else None,
        "turns": turns(plan.cells) if plan.found else None,
        "min_turns": task.min_turns,
        "climb_m": climb(grid, plan.cells) if plan.found else None,
        "converged_at": plan.converged_at or None,
        "iterations": len(plan.best_by_iteration),
        "ms": 1000 * plan.seconds,
        "parameters": planner.key,
        "version": __version__,
    }
    return Run(task, planner.name, row, plan.cells, plan.best_by_iteration)
