"""`warehouse plan`: planners against each other on the tasks of one map -> rows, a table, pictures."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from train.evaluation.jobs import Job, Result, Runner, Tick
from train.evaluation.pictures import plan_pictures
from train.evaluation.planning_runs import Run, Task, make_task, plan_once
from train.evaluation.rollout import MOST
from train.reporting.plan_report import plan_note, plan_table
from train.reporting.report import require_charts
from train.reporting.rows import RowFile, check_writable, write_text
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError, MapError
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.layouts import NAMED_TASKS, make_layout
from warehouse_env.maps.movingai import read_map, read_scen
from warehouse_env.planning import Planner, make_planner

_RANDOM_TASKS = 5  # on a floor without named tasks


@dataclass(frozen=True)
class PlanCommand(Checked):
    """Compare planners on the tasks of a map: how often they find the shortest path, with how many turns, how fast."""

    layout: str = "paper46"
    """Name of the layout; its named tasks are planned unless other tasks are given."""
    map: Path | None = None
    """A MovingAI .map file instead of the layout."""
    scen: Path | None = None
    """A MovingAI .scen file with tasks for the map; without --map, the map of that name beside it is used."""
    planner: tuple[str, ...] = ("pf_aco", "aco", "astar_turns", "astar")
    """Planners to compare; a name may carry parameters, as in pf_aco:ants=20."""
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
        if not 1 <= self.runs <= MOST or self.seed < 0:
            raise ConfigError(f"--runs {self.runs} must lie in 1..{MOST:,} and --seed {self.seed} be at least 0")
        planners = {name: make_planner(name) for name in self.planner}
        if not planners:
            raise ConfigError("--planner needs at least one name")
        grid = self._grid()
        tasks = [make_task(grid, *task) for task in self._tasks(grid)]
        check_writable(self.out / "table.md")
        if self.pictures:
            require_charts()
        kept: list[Run] = []
        jobs = [
            PlanJob(grid, planner, label, task, number, run, self.seed)
            for label, planner in planners.items()
            for number, task in enumerate(tasks)
            for run in range(self.runs)
        ]
        with Runner(RowFile(self.json), hear=lambda number, run: kept.append(run)) as run:
            rows = run(jobs)
        table = plan_table(rows, plan_note(rows))
        table.print()
        write_text(self.out / "table.md", table.markdown())
        if self.pictures:
            plan_pictures(grid, kept, self.out)
        rows_too = "" if self.json is None else f"the rows to {self.json}, "
        print(f"wrote {rows_too}the table{' and the pictures' if self.pictures else ''} to {self.out}")

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
        if self.tasks is not None and not 1 <= self.tasks <= MOST:
            raise ConfigError(f"--tasks {self.tasks} must lie in 1..{MOST:,}")
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


@dataclass(frozen=True)
class PlanJob(Job):
    """A run of a planner on a task."""

    grid: GridMap
    planner: Planner
    label: str
    task: Task
    number: int  # of the task
    number_of_run: int
    seed: int

    titled = "{label} · {task.name}"

    def run(self, tick: Tick) -> Result:
        """Plan; a first plan of each planner, which may compile, is thrown away. more: the run."""
        if self.number == self.number_of_run == 0:
            self.planner.plan(self.grid, self.task.start, self.task.goal, np.random.default_rng(self.seed))
        run = plan_once(self.grid, self.planner, self.task, self.number, self.number_of_run, self.seed, self.label)
        return Result([run.row], run)


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
