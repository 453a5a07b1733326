"""One run of a planner on a task: a checked plan and its row, for `plan`, the tables and the benchmark."""

import itertools
import math
import time
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.reporting.rows import Row
from warehouse_env import __version__
from warehouse_env.errors import PlanError
from warehouse_env.maps.clearance import segment_gap
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning import Plan, Planner, climb, min_turns, path_length, turns, validate
from warehouse_env.planning.plan import validate_line

OPTIMAL = 1e-9  # relative excess of a length that counts as rounding
_FIGURES = ("length", "gap", "turns", "climb_m", "line_length", "turn_angle", "clearance")  # None without a path
_FAR = 5.0  # [cells], largest clearance that is measured


class PlanningTask(NamedTuple):
    """A start and a goal with the shortest length and the fewest turns of a path of that length."""

    name: str
    start: Cell
    goal: Cell
    optimal_length: float  # [cells]
    min_turns: int


def make_task(grid: GridMap, name: str, start: Cell, goal: Cell) -> PlanningTask:
    """Return the task with its truth, by exact search; MapError or PlanError if it has no solution."""
    start, goal = grid.check_cell(start, "start"), grid.check_cell(goal, "goal")
    length = float(grid.distance_to(goal)[start])
    if not math.isfinite(length):
        raise PlanError(f"no path leads from {start} to {goal} on map {grid.name!r}; choose connected cells")
    return PlanningTask(name, start, goal, length, min_turns(grid, start, goal))


@dataclass(frozen=True)
class PlanningRun:
    """One plan with its row; the plan is for the pictures."""

    task: PlanningTask
    planner: str
    row: Row
    plan: Plan = field(repr=False)


def plan_once(
    grid: GridMap, planner: Planner, task: PlanningTask, number: int, run: int, seed: int, label: str = ""
) -> PlanningRun:
    """Plan run `run` of task number `number` with its own random numbers, and check the path independently.

    Equal numbers give equal plans; PlanError if a path breaks the rules of the map. label: name of the planner.
    """
    begin = time.thread_time()
    plan = planner.plan(grid, task.start, task.goal, np.random.default_rng([seed, number, run]))
    worked = time.thread_time() - begin
    if plan.found:
        validate(grid, plan.cells, task.start, task.goal)
        if plan.line is not None:
            validate_line(grid, plan.line, task.start, task.goal)
    row: Row = {
        "planner": label or planner.name, "layout": grid.name, "task": task.name, "start": list(task.start),
        "goal": list(task.goal), "run": run, "seed": seed, "success": plan.found,
        "optimal_length": task.optimal_length, "min_turns": task.min_turns,
        **(_figures(grid, plan, task.optimal_length) if plan.found else dict.fromkeys(_FIGURES)),
        "converged_at": plan.converged_at or None, "iterations": len(plan.best_by_iteration),
        "ms": 1000 * plan.seconds, "cpu_ms": 1000 * worked,  # the latter is the same on a busy machine
        "parameters": planner.key, "version": __version__,
    }  # fmt: skip
    return PlanningRun(task, row["planner"], row, plan)


def _figures(grid: GridMap, plan: Plan, optimal: float) -> Row:
    """Return the values of _FIGURES for a found path."""
    length, line = path_length(plan.cells), driven(plan)
    gap = length / optimal - 1 if optimal else length  # 0 from a cell to itself
    of_cells = length, gap, turns(plan.cells), climb(grid, plan.cells)
    of_line = plan.line_length, turn_angle(line), least_gap(grid, line)
    return dict(zip(_FIGURES, (*of_cells, *of_line), strict=True))


def is_optimal(row: Row) -> bool:
    """True where the run found a shortest path."""
    return row["gap"] is not None and row["gap"] < OPTIMAL


def driven(plan: Plan) -> NDArray[np.float64]:
    """Return the polyline float64[K, 2] (row, col) of a found plan: its line, or the corners of its cells."""
    points = plan.cells.astype(np.float64) if plan.line is None else plan.line
    inner = [k for k, bend in enumerate(_bends(points), start=1) if bend > 0.0]
    return points[[0, *inner, len(points) - 1]] if len(points) > 1 else points


def turn_angle(line: NDArray[np.float64]) -> float:
    """Return the sum of all changes of direction of a polyline float64[K, 2] [degrees]."""
    return math.degrees(sum(_bends(line)))


def _bends(line: NDArray[np.float64]) -> list[float]:
    """Return the change of direction of a polyline at each of its inner points [rad]."""
    steps = itertools.pairwise(np.diff(line, axis=0))
    return [abs(math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1])) for a, b in steps]


def least_gap(grid: GridMap, line: NDArray[np.float64]) -> float:
    """Return the least distance [cells] of a polyline float64[K, 2] to shelves and the map's edge, at most 5."""
    solid = np.pad(grid.occupied, 1, constant_values=True).astype(np.uint8)
    gap, corners = _FAR, (line[:, ::-1] + 0.5).tolist()  # (x, y) with cell corners on whole numbers
    for a, b in zip(corners, corners[1:] or corners, strict=False):
        gap = min(gap, float(segment_gap(solid, *a, *b, 1.0, gap)))  # type: ignore[call-arg]
    return gap
