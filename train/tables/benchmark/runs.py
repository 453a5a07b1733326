"""The benchmark in blocks: one planner on some pairs of one map -> small rows, one a run."""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
_BLOCK = 10  # pairs


class Block(NamedTuple):
    """A planner on the pairs first..last-1 of a map, each with `runs` random numbers of its own."""

    map: str
    planner: str
    first: int
    last: int
    pairs: int  # of the map in all
    runs: int
    seed: int


@cache
def planner_of(name: str) -> Planner:
    """Return a planner of PLANNERS at its defaults, or a peer."""
    return PEERS[name]() if name in PEERS else make_planner(name)


@cache
def identity(planner: str, name: str, seed: int) -> str:
    """Return 16 hex digits for all that a planner's rows on a map depend on; where they agree, only times differ."""
    made = planner_of(planner)
    parts = (made.key, code_key(type(made)), make_map(name).key, str(seed), __version__)
    return hashlib.blake2b("\n".join(parts).encode(), digest_size=8).hexdigest()


def limits(planner: str, pairs: int, runs: int) -> tuple[int, int]:
    """Return on how many pairs, and how often each, a planner runs: all, unless it is a slow peer."""
    peer = PEERS.get(planner)
    if peer is None:
        return pairs, runs
    return min(pairs, peer.most_pairs or pairs), min(runs, peer.most_runs or runs)


def blocks_of(maps: Sequence[str], planners: Sequence[str], pairs: int, runs: int, seed: int) -> list[Block]:
    """Return all blocks: the first pairs of every map and planner come first, so that a cut leaves a fair part."""
    blocks = []
    for first in range(0, pairs, _BLOCK):
        for name in maps:
            for planner in planners:
                own_pairs, own_runs = limits(planner, pairs, runs)
                if first < own_pairs:
                    blocks.append(Block(name, planner, first, min(first + _BLOCK, own_pairs), pairs, own_runs, seed))
    return blocks


class Watched:
    """A generator that tells whether anything was drawn from it."""

    def __init__(self, *seed: int) -> None:
        """Seed the generator `rng` with whole numbers."""
        self.rng = np.random.default_rng(seed)
        self._before = json.dumps(self.rng.bit_generator.state)

    @property
    def drawn(self) -> bool:
        """True once a number was drawn."""
        return json.dumps(self.rng.bit_generator.state) != self._before


@cache
def warm_up(planner: str, name: str, task: Task) -> None:
    """Prepare the map for a peer and plan once in this process, which may compile; slow peers need no such plan."""
    made, grid = planner_of(planner), make_map(name)
    if isinstance(made, Peer):
        made.ready(grid)
    if not (isinstance(made, Peer) and made.most_pairs):
        made.plan(grid, task.start, task.goal, np.random.default_rng(0))


def run_block(block: Block) -> list[Row]:
    """Plan all runs of a block, warmed up.

    A run that drew no random number would give the same path again; it then stands for all runs of its pair.
    """
    planner, grid = planner_of(block.planner), make_map(block.map)
    tasks = make_tasks(block.map, block.pairs, block.seed)
    warm_up(block.planner, block.map, tasks[0])
    rows = []
    for pair in range(block.first, block.last):
        for run in range(block.runs):
            watched = Watched(block.seed, pair, run)
            begin = time.thread_time()
            plan = planner.plan(grid, tasks[pair].start, tasks[pair].goal, watched.rng)
            seconds = time.thread_time() - begin
            stands_for = 1 if watched.drawn or run else block.runs
            rows.append(_row(block, pair, run, stands_for, measure(block.map, planner, tasks[pair], plan, seconds)))
            if stands_for == block.runs:
                break
    return rows


def _row(block: Block, pair: int, run: int, stands_for: int, measured: Row) -> Row:
    made = identity(block.planner, block.map, block.seed)
    row = {"map": block.map, "planner": block.planner, "pair": pair, "run": run, "stands_for": stands_for}
    return {**row, **measured, "made": made}


def measure(name: str, planner: Planner, task: Task, plan: Plan, seconds: float) -> Row:
    """Check a plan without its planner, and return its figures; PlanError for a path that breaks the rules.

    seconds: processor time that it took, the same on a busy machine.
    gap, line_gap: excess over the shortest path by legal moves (for a peer that cuts corners, by its own moves), of
    the cells and of the planner's line; turns and T* are those of the cells. clearance [cells]: of cells' centres.
    """
    grid, cuts = make_map(name), isinstance(planner, Peer) and planner.cuts_corners
    optimum = cutting_length(grid, task.start, task.goal) if cuts else task.optimal_length
    row: Row = {
        "success": plan.found,
        "optimal_length": round(optimum, 6),
        "min_turns": None if cuts else task.min_turns,
        "ms": round(1000 * seconds, 4),
        "iterations": len(plan.best_by_iteration),
        "anytime": anytime(plan, optimum, seconds),
    }
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


@dataclass(frozen=True)
class Known:
    """What is there already: the rows that are still true, and the blocks that are missing."""

    rows: list[Row]
    missing: list[Block]


def sort_out(blocks: Iterable[Block], old: Iterable[Row]) -> Known:
    """Divide: a pair's rows are kept if they cover all its runs and were made by the code and maps of today."""
    by_pair: dict[tuple[str, str, str, int], list[Row]] = defaultdict(list)
    for row in old:
        by_pair[row["made"], row["map"], row["planner"], row["pair"]].append(row)
    kept: list[Row] = []
    missing = []
    for block in blocks:
        made = identity(block.planner, block.map, block.seed)
        pairs = [by_pair.get((made, block.map, block.planner, pair), []) for pair in range(block.first, block.last)]
        complete = [_complete(rows, block.runs) for rows in pairs]
        kept += [row for rows in complete for row in rows]
        absent = [pair for pair, rows in zip(range(block.first, block.last), complete, strict=True) if not rows]
        if absent:
            missing.append(block._replace(first=absent[0], last=absent[-1] + 1))
    redone = {(b.map, b.planner, pair) for b in missing for pair in range(b.first, b.last)}
    return Known([row for row in kept if (row["map"], row["planner"], row["pair"]) not in redone], missing)


def _complete(rows: Sequence[Row], runs: int) -> list[Row]:
    """Return the rows of a pair's runs 0..runs-1, none if one of them is missing."""
    if rows and rows[0]["run"] == 0 and rows[0]["stands_for"] > 1:
        return [{**rows[0], "stands_for": runs}]
    own = {row["run"]: row for row in rows}
    return [own[run] for run in range(runs)] if all(run in own for run in range(runs)) else []
