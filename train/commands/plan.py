"""`warehouse plan`: planners against each other on the tasks of one map -> rows, a table, pictures."""

import itertools
import re
import statistics
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np

from train.commands.layouts import BY_MAP
from train.evaluation.pictures import plan_pictures
from train.evaluation.planning_runs import PlanningRun, PlanningTask, is_optimal, make_task, plan_once
from train.evaluation.rollout import MOST
from train.reporting.report import Table, grouped, make_progress, number, require_charts, with_interval
from train.reporting.rows import Row, RowFile, mean_interval
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError, MapError, MapWarning, counted
from warehouse_env.files import check_writable, write_text
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.layouts import NAMED_TASKS, make_layout
from warehouse_env.maps.movingai import Scenario, read_scen
from warehouse_env.planning import Planner, make_planner

_LAYOUT = "paper46"
_RANDOM_TASKS = 5  # on a floor without named tasks
_ROUNDING = 0.01  # [cells], of recorded lengths


@dataclass(frozen=True)
class PlanCommand(Checked):
    """Compare planners on the tasks of a map: share of shortest paths, turns, time."""

    layout: Annotated[str | None, BY_MAP] = None
    """The floor (paper46): a name of `warehouse layouts`, a file NAME.map or NAME.yaml, or your own, FILE.py:FUNCTION;
    its named tasks are planned unless other tasks are given."""
    scen: Path | None = None
    """A MovingAI .scen file with tasks; without --layout, the map of that name beside it is used."""
    planner: tuple[str, ...] = ("pf_aco", "aco", "astar_turns", "astar")
    """Planners to compare: names of `warehouse planners`, with parameters if need be, as in pf_aco:ants=20, or your
    own, FILE.py:CLASS or MODULE:CLASS."""
    start: str | None = None
    """Start of a single task, as ROW,COLUMN."""
    goal: str | None = None
    """Goal of a single task, as ROW,COLUMN."""
    tasks: int | None = None
    """Number of tasks, drawn from the scenario file, or at random from the floor without one."""
    runs: int = 30
    """Runs of each planner on each task, each with its own seed."""
    seed: int = 0
    """Seed of the runs, and of tasks that are drawn."""
    json: Path | None = None
    """Write the rows, one per run, to this file as JSON lines."""
    out: Path = Path("results/plan")
    """Folder for the table and the pictures of the paths and of the convergence."""
    pictures: bool = True
    """Draw the pictures."""
    ranges: ClassVar = {"runs": (1, MOST), "tasks": (1, MOST), "seed": (0, 2**62)}

    def run(self) -> None:
        """Plan all, print the table, write rows and pictures."""
        planners = {name: make_planner(name) for name in self.planner}
        if not planners:
            raise ConfigError("--planner needs at least one name")
        grid = self._grid()
        tasks = self._tasks(grid)
        check_writable(self.out / "table.md")
        if self.pictures:
            require_charts()
        kept: list[PlanningRun] = []
        with RowFile(self.json) as file, make_progress() as progress:
            bar = progress.add_task("planning", total=len(planners) * len(tasks) * self.runs)
            try:
                for run in self._runs(grid, planners, tasks):
                    kept.append(run)
                    file.add([run.row])
                    progress.update(bar, advance=1, description=f"{run.planner} · {run.task.name}")
            except KeyboardInterrupt:
                raise KeyboardInterrupt(file.kept()) from None
        table = plan_table([run.row for run in kept])
        table.print()
        write_text(self.out / "table.md", table.markdown())
        if self.pictures:
            plan_pictures(grid, kept, self.out)
        rows_too = "" if self.json is None else f"the rows to {self.json}, "
        print(f"wrote {rows_too}the table{' and the pictures' if self.pictures else ''} to {self.out}")

    def _runs(
        self, grid: GridMap, planners: Mapping[str, Planner], tasks: Sequence[PlanningTask]
    ) -> Iterator[PlanningRun]:
        """Yield all runs; the first plan of each planner may compile and is discarded."""
        for label, planner in planners.items():
            planner.plan(grid, tasks[0].start, tasks[0].goal, np.random.default_rng(self.seed))
            for (place, task), run in itertools.product(enumerate(tasks), range(self.runs)):
                yield plan_once(grid, planner, task, place, run, self.seed, label)

    def _grid(self) -> GridMap:
        if self.scen is not None and self.layout is None:
            names = {scenario.map_name for scenario in _scenarios(self.scen)}
            if len(names) != 1:
                raise MapError(f"{self.scen} names {len(names)} maps; choose one with --layout")
            return make_layout(str(self.scen.parent / Path(names.pop()).name))
        return make_layout(self.layout or _LAYOUT)

    def _tasks(self, grid: GridMap) -> list[PlanningTask]:
        """Return the tasks that the options ask for."""
        if (self.start is None) != (self.goal is None):
            raise ConfigError("--start and --goal belong together; give both")
        if self.start is not None and self.goal is not None:
            if self.tasks is not None or self.scen is not None:
                raise ConfigError("--start and --goal name the only task; leave --tasks and --scen out")
            return [make_task(grid, "start_goal", _cell(self.start, "--start"), _cell(self.goal, "--goal"))]
        if self.scen is not None:
            return _scenario_tasks(self.scen, grid, self.tasks, self.seed)
        named = NAMED_TASKS.get(self.layout or _LAYOUT, {}) if self.tasks is None else {}
        if named:
            return [make_task(grid, name, *cells) for name, cells in named.items()]
        return _random_tasks(grid, self.tasks or _RANDOM_TASKS, self.seed)


def _cell(text: str, option: str) -> Cell:
    found = re.fullmatch(r"\s*\(?\s*(-?\d+)\s*,\s*(-?\d+)\s*\)?\s*", text)
    if found is None:
        raise ConfigError(f"{option} {text!r} must be ROW,COLUMN, two whole numbers as in 22,1")
    return int(found[1]), int(found[2])


def _scenarios(path: Path) -> list[Scenario]:
    if not (scenarios := read_scen(path)):
        raise MapError(f"{path} holds no scenario, only its first line; name another file with --scen")
    return scenarios


def _scenario_tasks(path: Path, grid: GridMap, count: int | None, seed: int) -> list[PlanningTask]:
    scenarios = list(enumerate(_scenarios(path), start=1))
    for place, scenario in scenarios:
        if (scenario.height, scenario.width) != grid.shape:
            raise MapError(
                f"{path}: scenario {place} is for a map of {scenario.height} x {scenario.width} cells, "
                f"but the map has {grid.shape[0]} x {grid.shape[1]}"
            )
    if count is not None and count < len(scenarios):
        chosen = np.random.default_rng([seed, 0]).choice(len(scenarios), count, replace=False)
        scenarios = [scenarios[index] for index in sorted(chosen.tolist())]
    tasks = [make_task(grid, f"scenario_{place}", scenario.start, scenario.goal) for place, scenario in scenarios]
    lengths = [(scenario.length, task) for (_, scenario), task in zip(scenarios, tasks, strict=True)]
    wrong = [(length, task) for length, task in lengths if abs(length - task.optimal_length) > _ROUNDING]
    if wrong:
        length, task = wrong[0]
        text = f"{path}: {len(wrong)} of {len(tasks)} lengths are not those of the shortest paths, which count here"
        first = f"{task.name} says {length:g}, its shortest path has {task.optimal_length:g} cells"
        warnings.warn(f"{text}; {first}", MapWarning, stacklevel=2)
    return tasks


def _random_tasks(grid: GridMap, count: int, seed: int) -> list[PlanningTask]:
    rng, free = np.random.default_rng([seed, 0]), grid.free_cells
    if len(free) < 2:
        raise MapError(f"map {grid.name!r} has no two connected free cells to plan between")
    pairs = [free[rng.choice(len(free), 2, replace=False)].tolist() for _ in range(count)]
    return [make_task(grid, f"random_{k}", (a[0], a[1]), (b[0], b[1])) for k, (a, b) in enumerate(pairs, start=1)]


_HEADER = (
    "planner", "task", "success", "length [cells]", "optimum", "gap", "optimal", "turns", "fewest possible",
    "converged at", "median ms",
)  # fmt: skip


def plan_table(rows: Sequence[Row]) -> Table:
    """Return one line for each planner and task, means over its runs; a climb column where the floor is uneven."""
    uneven = any(row["climb_m"] for row in rows)
    cells = []
    for (planner, task), group in grouped(rows, ("planner", "task")).items():
        line = [
            str(planner), str(task), _share(row["success"] for row in group),
            with_interval(mean_interval(row["length"] for row in group), digits=5),
            number(group[0]["optimal_length"], 6), f"{number(round(100 * _mean(group, 'gap'), 7))}%",
            _share(is_optimal(row) for row in group), number(_mean(group, "turns")), str(group[0]["min_turns"]),
            number(_mean(group, "converged_at")), number(statistics.median(row["ms"] for row in group), 2),
        ]  # fmt: skip
        cells.append((*line, number(_mean(group, "climb_m"))) if uneven else tuple(line))
    runs = len({row["run"] for row in rows})
    title = (
        f"Planners on {rows[0]['layout']}, {counted(runs, 'run')} each: means [95% interval by Student's t over runs]"
    )
    return Table(title, _HEADER + (("climb [m]",) if uneven else ()), tuple(cells))


def _share(values: Iterable[bool]) -> str:
    flags = list(values)
    return f"{number(100 * sum(flags) / len(flags))}%"


def _mean(rows: Sequence[Row], name: str) -> float:
    return mean_interval(row[name] for row in rows).mean
