"""Routes of 16, 32 and 64 robots by every system, k shortest paths (Yen 1971) among them: conflicts, and cost."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from itertools import islice
from typing import Any

import numpy as np

from train.reporting.rows import Row
from train.tables.traffic.jobs import Piece, floor
from warehouse_env.errors import WarehouseError
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning import make_planner, path_length
from warehouse_env.planning.ants.pf_aco import PfAco
from warehouse_env.traffic.alternatives import differences, penalty_routes
from warehouse_env.traffic.conflicts import Route, conflicts
from warehouse_env.traffic.diverse import routes
from warehouse_env.traffic.expected import endpoint_tasks
from warehouse_env.traffic.together import Task, choose_together, plan_together


def require_networkx() -> Any:
    """Return networkx; WarehouseError if it is not installed."""
    try:
        return importlib.import_module("networkx")
    except ImportError:
        raise WarehouseError('k shortest paths need networkx; pip install "warehouse-env[tables]"') from None


@cache
def _graph(grid: GridMap) -> Any:
    graph = require_networkx().Graph()
    for row, column in grid.free_cells.tolist():
        for move in np.flatnonzero(grid.legal_moves[row, column]).tolist():
            to = (row + int(MOVES[move, 0]), column + int(MOVES[move, 1]))
            graph.add_edge((row, column), to, length=2**0.5 if move % 2 else 1.0)
    return graph


def k_shortest(grid: GridMap, start: Cell, goal: Cell, k: int) -> list[Route]:
    """Return the k shortest simple paths int64[L, 2], the shortest first."""
    paths = require_networkx().shortest_simple_paths(_graph(grid), start, goal, weight="length")
    return [np.array(path, dtype=np.int64) for path in islice(paths, k)]


ROBOTS = (16, 32, 64)
PLANNERS = ("astar", "astar_turns", "pf_aco")
PRICE = 2.0  # [cells] of detour that avoiding a conflict is worth
PRICES = (0.5, 1.0, 4.0, 8.0)  # further ones, by astar and 32 robots alone
SLOW_ROBOTS = 32  # robots up to which what takes long is measured
K = 8  # routes for a robot to choose from
YEN_DRAWS = 5  # draws of k shortest paths, with 16 robots only: each path takes a tenth of a second

Alternatives = Callable[[Cell, Cell, int, np.random.Generator], list[Route]]


def measure_routes(job: Piece) -> Iterator[Row]:
    """Measure every system on one draw of tasks: its first 16, 32 and 64."""
    grid = floor(job.map)
    tasks = endpoint_tasks(grid, max(ROBOTS), np.random.default_rng([job.seed, job.number]))
    for name in PLANNERS:
        _warm_up(name, grid)
        begin = time.perf_counter()
        rngs = (np.random.default_rng((job.seed, job.number, k)) for k in range(len(tasks)))
        alone = [make_planner(name).plan(grid, *task, rng).cells for task, rng in zip(tasks, rngs, strict=True)]
        seconds = (time.perf_counter() - begin) / len(tasks)
        for robots in ROBOTS:
            yield _measured(name, grid, tasks[:robots], alone[:robots], seconds)
            yield _together(job, name, grid, tasks[:robots], True, PRICE)
            if name == "astar" or robots == SLOW_ROBOTS:
                yield _together(job, name, grid, tasks[:robots], False, PRICE)
    for price in PRICES:
        yield _together(job, "astar", grid, tasks[:SLOW_ROBOTS], True, price)
    yield from _choices(job, grid, tasks)


def _warm_up(name: str, grid: GridMap) -> None:
    """Plan once with and once without a cost map, which may compile."""
    planner, (start, goal) = make_planner(name), endpoint_tasks(grid, 1, np.random.default_rng(0))[0]
    plan_together(planner, grid, [(start, goal), (goal, start)])


def _together(job: Piece, name: str, grid: GridMap, tasks: Sequence[Task], directed: bool, price: float) -> Row:
    begin = time.perf_counter()
    plans = plan_together(make_planner(name), grid, tasks, job.seed + job.number, price=price, directed=directed)
    seconds = (time.perf_counter() - begin) / len(tasks)
    label = f"{name}, cost a {'move' if directed else 'cell'}"
    return {**_measured(label, grid, tasks, [plan.cells for plan in plans], seconds), "price": price}


def _choices(job: Piece, grid: GridMap, tasks: Sequence[Task]) -> Iterator[Row]:
    """Measure the choice among K routes of each robot, and how different these are."""
    ways: tuple[tuple[str, int, Alternatives], ...] = (  # with the most robots for which each is measured
        ("astar with penalties", ROBOTS[-1], lambda *task: penalty_routes(make_planner("astar"), grid, *task)),
        ("pf_aco routes", SLOW_ROBOTS, lambda *task: routes(PfAco(), grid, *task)),
        ("k shortest paths", ROBOTS[0], lambda start, goal, k, rng: k_shortest(grid, start, goal, k)),
    )
    for label, most, way in ways if job.number < YEN_DRAWS else ways[:-1]:
        way(*tasks[0], K, np.random.default_rng(0))
        begin = time.perf_counter()
        rngs = (np.random.default_rng([job.seed, job.number, k]) for k in range(most))
        sets = [way(*task, K, rng) for task, rng in zip(tasks[:most], rngs, strict=True)]
        seconds = (time.perf_counter() - begin) / len(sets)
        for robots in (robots for robots in ROBOTS if robots <= most):
            begin = time.perf_counter()
            choice = choose_together(sets[:robots], grid.shape, PRICE)
            chosen = [own[k] for own, k in zip(sets, choice, strict=False)]
            own_seconds = seconds + (time.perf_counter() - begin) / robots
            row = _measured(f"{label}, choice of {K}", grid, tasks[:robots], chosen, own_seconds)
            yield {**row, **_spread(grid, tasks[:robots], sets[:robots])}


def _measured(label: str, grid: GridMap, tasks: Sequence[Task], paths: Sequence[Route], seconds: float) -> Row:
    """Conflicts of a robot and task, and the length paid over the shortest."""
    lifelong, start = (conflicts(paths, grid.shape, timing) for timing in ("lifelong", "start"))
    shortest = sum(float(grid.distance_to(goal)[begin]) for begin, goal in tasks)
    count = len(tasks)
    return {
        "system": label,
        "robots": count,
        "crossings": lifelong.crossings / count,
        "opposing": lifelong.opposing / count,
        "start_crossings": start.crossings / count,
        "start_opposing": start.opposing / count,
        "paid": sum(map(path_length, paths)) / shortest - 1,
        "ms": 1000 * seconds,
        "price": 0.0,
    }


def _spread(grid: GridMap, tasks: Sequence[Task], sets: Sequence[Sequence[Route]]) -> Row:
    """How many routes there are for a robot, how different, and how much longer than the shortest."""
    apart = [differences(own, grid.shape)[np.triu_indices(len(own), 1)] for own in sets]
    longer = [
        np.mean([path_length(path) for path in own]) / grid.distance_to(goal)[start] - 1
        for own, (start, goal) in zip(sets, tasks, strict=True)
    ]
    return {
        "alternatives": float(np.mean([len(own) for own in sets])),
        "difference": float(np.mean([pairs.mean() if len(pairs) else 0.0 for pairs in apart])),
        "alternatives_paid": float(np.mean(longer)),
    }
