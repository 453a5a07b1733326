"""`warehouse tables papers`: every comparison table of the papers, from fixed seeds.

Studies are run in blocks: all runs of one system on one task, known again by what made their rows.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from train.evaluation.jobs import Job, Known, Result, Tick, of_all_runs
from train.evaluation.planning_runs import Run, make_task, plan_once
from train.reporting.report import require_charts
from train.reporting.rows import Row, whole_rows
from train.tables.code import DRIVING, code_key, code_of
from train.tables.options import StudyOptions
from train.tables.page import write_pages
from train.tables.study import Experiment, Setting, Study, System, TableTask
from warehouse_env import __version__
from warehouse_env.errors import unknown_name


@dataclass(frozen=True)
class Block(Job):
    """All runs of one system on one task of a setting, in names and numbers only."""

    module: str
    study: str
    setting: str
    number: int  # of the task in its setting
    system: str
    runs: int
    seed: int

    titled = "{study} · {system}"
    times = ("ms", "cpu_ms")

    def subject(self) -> tuple[TableTask, System, Experiment | None]:
        """Return the task, the system, and what is run with them if not a single plan."""
        task = settings_of(self.module, self.study)[self.setting].tasks[self.number]
        study = studies_of(self.module)[self.study]
        return task, next(one for one in study.systems if one.label == self.system), study.experiment

    @property
    def identity(self) -> Row:
        """What its rows are known by."""
        task, system, experiment = self.subject()
        planner = system.make()
        code = code_key(type(planner))
        if experiment is not None:
            code = code_of(experiment.__module__, type(planner).__module__, within=DRIVING)
        return {
            "study": self.study, "setting": self.setting, "number": self.number, "system": self.system,
            "runs": self.runs, "seed": self.seed, "map": task.grid.key, "start": list(task.start),
            "goal": list(task.goal), "others": [[list(start), list(goal)] for start, goal in task.others],
            "mode": system.mode, "parameters": planner.key, "version": __version__, "code": code,
        }  # fmt: skip

    def left(self, rows: Sequence[Row]) -> tuple[Sequence[Row], Block | None]:
        """Return the rows of all runs, if none is missing."""
        whole = of_all_runs(rows, self.runs)
        return (whole, None) if whole else ([], self)

    def run(self, tick: Tick) -> Result:
        """Plan all runs; a first plan, which may compile and fill caches, is not timed."""
        task, system, experiment = self.subject()
        identity = self.identity
        if experiment is not None:  # each run with random numbers of its own
            seeds = [np.random.default_rng([self.seed, self.number, run]) for run in range(self.runs)]
            rows = [experiment(task, system, rng) for rng in seeds]
            return Result([{**row, **identity, "run": run, "curve": []} for run, row in enumerate(rows)])
        planner = system.make()
        truth = make_task(task.grid, f"{self.setting}_{self.number}", task.start, task.goal)
        planner.plan(task.grid, truth.start, truth.goal, np.random.default_rng(self.seed))
        runs = [plan_once(task.grid, planner, truth, self.number, run, self.seed) for run in range(self.runs)]
        rows = [{**run.row, **identity, "curve": _curve(run)} for run in runs]
        found = [k for k, run in enumerate(runs) if run.plan.found]
        if found:  # the shortest driven line is drawn, that of the fewest turns where several are as short
            best = min(found, key=lambda k: (round(runs[k].plan.line_length, 9), runs[k].row["turns"]))
            plan = runs[best].plan
            line = None if plan.line is None else plan.line.round(4).tolist()
            rows[best] |= {"cells": plan.cells.tolist(), "line": line}
        return Result(rows)


def blocks_of(module: str, study: Study, runs: int | None, seed: int) -> list[Block]:
    """Return the blocks of a study, in the order of its table; `runs` replaces its own number of runs."""
    return [
        Block(module, study.name, setting.name, number, system.label, runs or study.runs, seed)
        for setting in settings_of(module, study.name).values()
        for system in study.systems
        for number in range(len(setting.tasks))
    ]


def _curve(run: Run) -> list[list[float]]:
    """Return the best length by iteration as [iteration, length] where it falls; nothing before the first path."""
    best = run.plan.best_by_iteration
    falls = np.flatnonzero(np.isfinite(best) & (best != np.concatenate([[np.inf], best])[:-1]))
    return [[int(k) + 1, round(float(best[k]), 6)] for k in falls]


MODULES = {number: f"train.tables.papers.paper{number}" for number in ("000", "001", "002", "003", "004")}


@cache
def studies_of(module: str) -> dict[str, Study]:
    """Return the studies of a module by name."""
    return {study.name: study for study in importlib.import_module(module).STUDIES}


@cache
def settings_of(module: str, study: str) -> dict[str, Setting]:
    """Return the settings of a study by name, built once in a process."""
    return {setting.name: setting for setting in studies_of(module)[study].settings()}


def chosen(papers: Sequence[str], tables: Sequence[str]) -> list[tuple[str, Study]]:
    """Return (module, study) of the named papers and tables, all if none are named; WarehouseError for a wrong name."""
    for paper in papers:
        if paper not in MODULES:
            raise unknown_name("paper", paper, MODULES)
    every = [(key, module, study) for key, module in MODULES.items() for study in studies_of(module).values()]
    for table in tables:
        if table not in {study.name for _, _, study in every}:
            raise unknown_name("table", table, {study.name for _, _, study in every})
    return [
        (module, study)
        for key, module, study in every
        if (not papers and not tables) or key in papers or study.name in tables
    ]


@dataclass(frozen=True)
class Papers(StudyOptions):
    """Make the tables of the papers: ours beside theirs, a verdict on every claim, and pictures."""

    papers: tuple[str, ...] = ()
    """Papers by number, as 000 (all if neither papers nor tables are named)."""
    tables: tuple[str, ...] = ()
    """Single tables by name, as 000_table_1."""
    runs: int | None = None
    """Runs of each system on each task (each study's own number if left out)."""
    pictures: bool = True
    """Draw paths and convergence."""

    def run(self) -> None:
        """Run what is missing, then write tables, verdicts and pictures."""
        if self.pictures:
            require_charts()
        begin = time.perf_counter()
        studies = chosen(self.papers, self.tables)
        self.check_writable()
        names = {study.name for _, study in studies}
        blocks = [block for module, study in studies for block in blocks_of(module, study, self.runs, self.seed)]
        rows = self.rows_of(blocks, lambda row: row.get("study") in names)
        before = self._made_before(studies)
        write_pages([study for _, study in studies], rows, before, self.folder, pictures=self.pictures)
        print(self.written(begin))

    def _made_before(self, studies: Sequence[tuple[str, Study]]) -> list[tuple[Study, list[Row]]]:
        """Return the other studies whose rows are all in the file, for the index."""
        known, found = Known(whole_rows(self.rows_path)), []
        for module, study in (one for one in chosen((), ()) if one not in studies):
            done = [block.left(known.of(block)) for block in blocks_of(module, study, self.runs, self.seed)]
            if all(left is None for _, left in done):
                found.append((study, [row for rows, _ in done for row in rows]))
        return found
