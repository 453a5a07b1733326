"""One planner on one task, one run -> a checked plan and its row; shared by `plan`, the tables and the benchmark."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from train.rows import Row
from warehouse_env import __version__
from warehouse_env.errors import PlanError
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning import Plan, Planner, climb, min_turns, path_length, turns, validate


class Task(NamedTuple):
    """A start and a goal with the length that no path can beat and the fewest turns of a path of that length."""

    name: str
    start: Cell
    goal: Cell
    optimal_length: float  # [cells]
    min_turns: int


def make_task(grid: GridMap, name: str, start: Cell, goal: Cell) -> Task:
    """Return the task with its truth, by exact search; MapError or PlanError if it has no solution."""
    start, goal = grid.check_cell(start, "start"), grid.check_cell(goal, "goal")
    length = float(grid.distance_to(goal)[start])
    if not math.isfinite(length):
        raise PlanError(f"no path leads from {start} to {goal} on map {grid.name!r}; choose connected cells")
    return Task(name, start, goal, length, min_turns(grid, start, goal))


@dataclass(frozen=True)
class Run:
    """One plan with its row; the plan's cells and convergence are for the pictures."""

    task: Task
    planner: str
    row: Row
    plan: Plan = field(repr=False)


def plan_once(grid: GridMap, planner: Planner, task: Task, number: int, run: int, seed: int) -> Run:
    """Plan run `run` of task number `number` with random numbers of its own, and check the path without the planner.

    Equal numbers give equal plans. Raises PlanError where the planner's path breaks the rules of the map.
    """
    plan = planner.plan(grid, task.start, task.goal, np.random.default_rng([seed, number, run]))
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
    return Run(task, planner.name, row, plan)
