"""A study in blocks: all runs of one system on one task, done in one piece, known again by what made its rows."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from train.evaluation.planning_runs import Run, make_task, plan_once
from train.reporting.rows import Row
from train.tables.catalogue import settings_of, studies_of
from train.tables.code import code_key, code_of
from train.tables.study import Experiment, Study, System, TableTask
from warehouse_env import __version__

_OF_EXPERIMENTS = ("train.tables.", "warehouse_env.", "agents.")  # code that their rows depend on


class Block(NamedTuple):
    """All runs of one system on one task of a setting, in names and numbers only."""

    module: str
    study: str
    setting: str
    number: int  # of the task in its setting
    system: str
    runs: int
    seed: int

    def parts(self) -> tuple[TableTask, System, Experiment | None]:
        """Return the task, the system, and what is run with them if not a single plan."""
        task = settings_of(self.module, self.study)[self.setting].tasks[self.number]
        study = studies_of(self.module)[self.study]
        return task, next(one for one in study.systems if one.label == self.system), study.experiment

    def identity(self) -> Row:
        """Return what its rows are known by: equal identities mean equal rows, but for the times."""
        task, system, experiment = self.parts()
        planner = system.make()
        shared = {
            "study": self.study,
            "setting": self.setting,
            "number": self.number,
            "system": self.system,
            "runs": self.runs,
            "seed": self.seed,
            "map": task.grid.key,
            "start": list(task.start),
            "goal": list(task.goal),
            "parameters": planner.key,
            "version": __version__,
            "code": code_key(type(planner)),
        }
        if experiment is None:
            return shared
        others = [[list(start), list(goal)] for start, goal in task.others]
        code = code_of(experiment.__module__, type(planner).__module__, within=_OF_EXPERIMENTS)
        return {**shared, "others": others, "mode": system.mode, "code": code}


def blocks_of(module: str, study: Study, runs: int | None, seed: int) -> list[Block]:
    """Return the blocks of a study, in the order of its table; `runs` replaces its own number of runs."""
    return [
        Block(module, study.name, setting.name, number, system.label, runs or study.runs, seed)
        for setting in settings_of(module, study.name).values()
        for system in study.systems
        for number in range(len(setting.tasks))
    ]


def mixed(blocks: Iterable[Block]) -> list[Block]:
    """Return the blocks in an order that mixes slow and fast ones, so that the remaining time can be told."""
    return sorted(blocks, key=lambda block: zlib.crc32(repr(block[1:5]).encode()))


def run_block(block: Block) -> list[Row]:
    """Plan all runs of a block and return their rows; a first plan, which may compile and fill caches, is not timed."""
    task, system, experiment = block.parts()
    if experiment is not None:
        return _experiments(block, task, system, experiment)
    planner = system.make()
    truth = make_task(task.grid, f"{block.setting}_{block.number}", task.start, task.goal)
    planner.plan(task.grid, truth.start, truth.goal, np.random.default_rng(block.seed))
    runs = [plan_once(task.grid, planner, truth, block.number, run, block.seed) for run in range(block.runs)]
    identity, best = block.identity(), _best(runs)
    return [{**run.row, **identity, "curve": _curve(run), **(_path(run) if run is best else {})} for run in runs]


def _experiments(block: Block, task: TableTask, system: System, experiment: Experiment) -> list[Row]:
    """Run a study's own experiment, each run with random numbers of its own."""
    seeds = [np.random.default_rng([block.seed, block.number, run]) for run in range(block.runs)]
    rows = [experiment(task, system, rng) for rng in seeds]
    return [{**row, **block.identity(), "run": run, "curve": []} for run, row in enumerate(rows)]


def _best(runs: Sequence[Run]) -> Run | None:
    """Return the run with the shortest driven line, the one of the fewest turns where several are as short."""
    found = [run for run in runs if run.plan.found]
    return min(found, key=lambda run: (round(run.plan.line_length, 9), run.row["turns"]), default=None)


def _path(run: Run) -> Row:
    """Return what is drawn of a plan: its cells, and its line where it leaves the lattice."""
    line = run.plan.line
    return {"cells": run.plan.cells.tolist(), "line": None if line is None else line.round(4).tolist()}


def _curve(run: Run) -> list[list[float]]:
    """Return the best length by iteration as [iteration, length] where it falls; nothing before the first path."""
    best = run.plan.best_by_iteration
    falls = np.flatnonzero(np.isfinite(best) & (best != np.concatenate([[np.inf], best])[:-1]))
    return [[int(k) + 1, round(float(best[k]), 6)] for k in falls]


def split(blocks: Sequence[Block], old: Iterable[Row]) -> tuple[list[Row], list[Block]]:
    """Return the rows that blocks have already among `old`, and the blocks that are still to be run."""
    names = ("study", "setting", "number", "system")
    key = lambda row: tuple(row[name] for name in names)  # noqa: E731
    known = {name: list(rows) for name, rows in groupby(sorted(old, key=key), key)}
    kept: list[Row] = []
    missing = []
    for block in blocks:
        same = block.identity().items()
        own = {row["run"]: row for row in known.get(block[1:5], []) if all(row.get(k) == v for k, v in same)}
        if all(run in own for run in range(block.runs)):
            kept += [own[run] for run in range(block.runs)]
        else:
            missing.append(block)
    return kept, missing
