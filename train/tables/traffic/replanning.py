"""Replanning after something was moved: from the warm colony, from nothing, and by exact search."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from train.reporting.rows import Row
from train.tables.traffic.jobs import Piece, floor
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning import Plan, make_planner, path_length
from warehouse_env.planning.ants.pf_aco import PfAco
from warehouse_env.planning.ants.warm import replan
from warehouse_env.traffic.conflicts import Route
from warehouse_env.traffic.expected import endpoint_tasks
from warehouse_env.traffic.together import Task

Trails = dict[str, NDArray[np.float64]]  # the pheromone that each colony left behind
CASES = ("pallet", "closed aisle", "moved shelf")


def measure_replanning(job: Piece) -> Iterator[Row]:
    """Change the floor on a colony's best path and plan again: warm, cold, and by astar."""
    grid, rng = floor(job.map), np.random.default_rng([job.seed, job.number, 1])
    make_planner("astar").plan(grid, *endpoint_tasks(grid, 1, rng)[0], rng)  # may compile; the colonies do below
    for case in CASES:
        task, changed, trails = _changed_floor(grid, case, rng)
        optimum = float(changed.distance_to(task[1])[task[0]])
        plan = make_planner("astar").plan(changed, *task, rng)
        yield _again("astar", case, plan, optimum)
        for label, system in _colonies().items():
            for begin, pheromone in (("cold", None), ("warm", trails[label])):
                plan, _ = replan(system, changed, *task, np.random.default_rng([job.seed, job.number, 2]), pheromone)
                yield _again(f"{label}, {begin}", case, plan, optimum)


def _colonies() -> dict[str, PfAco]:
    return {"pf_aco": PfAco(), "pf_aco (paper)": PfAco(local_search=False, patience=None)}


def _changed_floor(grid: GridMap, case: str, rng: np.random.Generator) -> tuple[Task, GridMap, Trails]:
    """Draw tasks until the best path of one can be blocked and its goal still be reached."""
    while True:
        (task,) = endpoint_tasks(grid, 1, rng)
        trails = {}
        for label, system in _colonies().items():
            plan, trails[label] = replan(system, grid, *task, np.random.default_rng(rng.integers(2**63)), None)
            if label == "pf_aco":
                path = plan.cells
        if len(path) < 12:
            continue
        occupied = _block(grid.occupied, path, case, rng)
        if occupied[task[0]] or occupied[task[1]]:
            continue
        changed = GridMap(occupied, grid.height, grid.cell_size, name=grid.name)
        if np.isfinite(changed.distance_to(task[1])[task[0]]):
            return task, changed, trails


def _block(occupied: NDArray[np.bool_], path: Route, case: str, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return the shelves with a pallet, a barrier or a shelf on the middle half of a path."""
    now = occupied.copy()
    row, column = path[int(rng.integers(len(path) // 4, 3 * len(path) // 4))]
    if case == "pallet":
        now[row, column] = True
    elif case == "closed aisle":
        lines = [_across(occupied, row, column, *step) for step in ((0, 1), (1, 0))]
        for cell in min(lines, key=len):
            now[cell] = True
    else:  # a 2 x 2 shelf is taken from its place and left on the path
        full = occupied[:-1, :-1] & occupied[1:, :-1] & occupied[:-1, 1:] & occupied[1:, 1:]
        shelves = np.argwhere(full)
        a, b = shelves[int(rng.integers(len(shelves)))]
        now[a : a + 2, b : b + 2] = False
        now[row : row + 2, column : column + 2] = True
    return now


def _across(occupied: NDArray[np.bool_], row: int, column: int, d_row: int, d_column: int) -> list[Cell]:
    """Free cells in a line through a cell, up to the next shelves or the edge."""
    cells = [(row, column)]
    for sign in (1, -1):
        r, c = row + sign * d_row, column + sign * d_column
        while 0 <= r < occupied.shape[0] and 0 <= c < occupied.shape[1] and not occupied[r, c]:
            cells.append((r, c))
            r, c = r + sign * d_row, c + sign * d_column
    return cells


def _again(label: str, case: str, plan: Plan, optimum: float) -> Row:
    """The gap after the first iteration and at the end, and when the last improvement came."""
    gap = plan.best_by_iteration / optimum - 1 if len(plan.best_by_iteration) else np.array([0.0])
    settled = max(plan.converged_at, 1)
    ms = 1000 * float(plan.elapsed[settled - 1]) if len(plan.elapsed) else 1000 * plan.seconds
    return {
        "system": label, "case": case, "first_gap": float(gap[0]), "gap": float(path_length(plan.cells) / optimum - 1),
        "optimal": bool(path_length(plan.cells) <= optimum + 1e-9), "settled_at": settled, "settled_ms": ms,
        "ms": 1000 * plan.seconds,
    }  # fmt: skip
