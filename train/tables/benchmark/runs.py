"""The benchmark in pairs of cells: a planner on a pair of a map -> small rows, one a run."""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from train.evaluation.jobs import Job, Result, Tick, of_all_runs
from train.evaluation.planning_runs import Task
from train.reporting.rows import Row
from train.tables.benchmark.maps import clearance_field, make_map, make_tasks
from train.tables.benchmark.peers import PEERS, Peer, cutting_length, touches_corner
from train.tables.code import code_key
from warehouse_env import __version__
from warehouse_env.errors import PlanError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning import Plan, Planner, make_planner, path_length, turns, validate

# Times [ms] at which the best gap so far is kept.
MOMENTS = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0)


@cache
def planner_of(name: str) -> Planner:
    """Return a planner of PLANNERS at its defaults, or a peer."""
    return PEERS[name]() if name in PEERS else make_planner(name)


@cache
def made_by(planner: str, name: str, seed: int) -> str:
    """Return 16 hex digits for all that a planner's rows on a map depend on; where they agree, only times differ."""
    made = planner_of(planner)
    parts = (made.key, code_key(type(made)), make_map(name).key, str(seed), __version__)
    return hashlib.blake2b("\n".join(parts).encode(), digest_size=8).hexdigest()


@dataclass(frozen=True)
class Pair(Job):
    """A planner on pair number `pair` of a map, with `runs` random numbers."""

    map: str
    planner: str
    pair: int
    pairs: int  # of the map in all
    runs: int
    seed: int

    titled = "{map} · {planner}"

    @property
    def identity(self) -> Row:
        """What its rows are known by."""
        made = made_by(self.planner, self.map, self.seed)
        return {"map": self.map, "planner": self.planner, "pair": self.pair, "made": made}

    def left(self, rows: Sequence[Row]) -> tuple[Sequence[Row], Pair | None]:
        """Return the rows of all runs, if none is missing."""
        if rows and rows[0].get("stands_for", 1) > 1:
            return [{**rows[0], "stands_for": self.runs}], None
        whole = of_all_runs(rows, self.runs)
        return (whole, None) if whole else ([], self)

    def run(self, tick: Tick) -> Result:
        """Plan all runs, warmed up; a run that drew no random number stands for all, which would give the same."""
        planner, grid, tasks = planner_of(self.planner), make_map(self.map), make_tasks(self.map, self.pairs, self.seed)
        warm_up(self.planner, self.map, tasks[0])
        task, rows = tasks[self.pair], []
        for run in range(self.runs):
            rng = np.random.default_rng([self.seed, self.pair, run])
            before = json.dumps(rng.bit_generator.state)
            begin = time.thread_time()
            plan = planner.plan(grid, task.start, task.goal, rng)
            seconds = time.thread_time() - begin
            drawn = json.dumps(rng.bit_generator.state) != before
            stands_for = 1 if drawn or run else self.runs
            measured = measure(self.map, planner, task, plan, seconds)
            rows.append(self.identity | {"run": run, "stands_for": stands_for} | measured)
            if stands_for == self.runs:
                break
        return Result(rows)


def pairs_of(maps: Sequence[str], planners: Sequence[str], pairs: int, runs: int, seed: int) -> list[Pair]:
    """Return all jobs, in the order of the options; a slow peer has fewer pairs and runs."""
    jobs = []
    for name in maps:
        for planner in planners:
            peer = PEERS.get(planner)
            own_pairs = min(pairs, peer.most_pairs or pairs) if peer else pairs
            own_runs = min(runs, peer.most_runs or runs) if peer else runs
            jobs += [Pair(name, planner, pair, pairs, own_runs, seed) for pair in range(own_pairs)]
    return jobs


@cache
def warm_up(planner: str, name: str, task: Task) -> None:
    """Prepare the map for a peer and plan once in this process, which may compile; slow peers need no such plan."""
    made, grid = planner_of(planner), make_map(name)
    if isinstance(made, Peer):
        made.ready(grid)
    if not (isinstance(made, Peer) and made.most_pairs):
        made.plan(grid, task.start, task.goal, np.random.default_rng(0))


def measure(name: str, planner: Planner, task: Task, plan: Plan, seconds: float) -> Row:
    """Check a plan without its planner, and return its figures; PlanError for a path that breaks the rules.

    seconds: processor time that it took, the same on a busy machine.
    gap, line_gap: excess over the shortest path by legal moves (for a peer that cuts corners, by its own moves), of
    the cells and of the planner's line; turns and T* are those of the cells. clearance [cells]: of cells' centres.
    """
    grid, cuts = make_map(name), isinstance(planner, Peer) and planner.cuts_corners
    optimum = cutting_length(grid, task.start, task.goal) if cuts else task.optimal_length
    row: Row = {
        "success": plan.found, "optimal_length": round(optimum, 6), "min_turns": None if cuts else task.min_turns,
        "ms": round(1000 * seconds, 4), "iterations": len(plan.best_by_iteration),
        "anytime": anytime(plan, optimum, seconds),
    }  # fmt: skip
    if not plan.found:
        return row
    _check(grid, task, plan, cuts)
    near = clearance_field(name)[tuple(plan.cells.T)]
    return {
        **row,
        "gap": _gap(path_length(plan.cells), optimum),
        "line_gap": None if plan.line is None else _gap(plan.line_length, optimum),
        "turns": turns(plan.cells),
        "converged_at": plan.converged_at or None,
        "clearance": 0.0 if cuts and touches_corner(grid, plan.cells) else round(float(near.min()), 4),
        "mean_clearance": round(float(near.mean()), 4),
    }


def _check(grid: GridMap, task: Task, plan: Plan, cuts: bool) -> None:
    if not cuts:
        validate(grid, plan.cells, task.start, task.goal)
        return
    steps = np.abs(np.diff(plan.cells, axis=0)).max(axis=1)
    ends = (tuple(plan.cells[0].tolist()), tuple(plan.cells[-1].tolist()))
    if ends != (task.start, task.goal) or (steps != 1).any() or grid.occupied[tuple(plan.cells.T)].any():
        raise PlanError(f"a path from {task.start} to {task.goal} that may cut corners jumps, or enters a shelf")


def _gap(length: float, optimum: float) -> float:
    return round(length / optimum - 1.0, 9) + 0.0


def anytime(plan: Plan, optimum: float, seconds: float) -> list[float | None]:
    """Return the gap of the best path known at each of MOMENTS, None before the first path.

    The times of the iterations are brought from wall time to the processor time of the whole.
    """
    best, at = plan.best_by_iteration, 1000 * plan.elapsed * min(1.0, seconds / max(plan.seconds, 1e-9))
    if len(best) == 0 or len(at) != len(best):
        best, at = np.array([path_length(plan.cells)]), np.array([1000 * seconds])
    known = np.searchsorted(at, MOMENTS, side="right")
    lengths: NDArray[np.float64] = np.concatenate([[np.inf], best])[known]
    return [_gap(length, optimum) if math.isfinite(length) else None for length in lengths.tolist()]
