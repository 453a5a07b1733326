"""What else the final pheromone holds: several good routes, and a head start after the floor has changed.

Beyond the papers. Ants lay pheromone on all that they found good, not on the best path alone, so ants that walk over
the final pheromone draw other near-optimal routes from it, and a colony that begins with it knows most of the floor.
A converged colony has forgotten nearly all but its trail (0.8^100 of the pheromone is left off it), so both first
temper it: pheromone^temper, largest 1.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning.alternatives import varied
from warehouse_env.planning.ants.colony import Search, cells_of, walk
from warehouse_env.planning.ants.floor import Floor, Table
from warehouse_env.planning.ants.system import AntSystem
from warehouse_env.planning.ants.walks import Walks, empty_walks, measure
from warehouse_env.planning.plan import Plan
from warehouse_env.planning.traffic import Route

SPREAD = (0.25, 0.5, 1.0)  # tempers for other routes: less strays from good ones, more repeats the best
WARM = 0.05  # temper for a new search: the more is remembered, the sooner it settles, too often on the old way


def tempered(pheromone: Table, temper: float) -> Table:
    """Return (pheromone / its largest)^temper float64[C, 8]: 1 leaves its contrasts, 0 forgets everything."""
    if not 0.0 <= temper <= 1.0:
        raise ConfigError(f"temper={temper} must be a share between 0 and 1")
    level: Table = (pheromone / pheromone.max()) ** temper
    return level


def routes(
    system: AntSystem,
    grid: GridMap,
    start: Cell,
    goal: Cell,
    k: int,
    rng: np.random.Generator,
    cost: NDArray[np.float64] | None = None,
    *,
    slack: float = 0.1,
    samples: int = 100,
    tempers: tuple[float, ...] = SPREAD,
) -> list[Route]:
    """Return up to k routes int64[L, 2] that differ much, the colony's best first; empty where it found none.

    One search, then `samples` ants over its pheromone for each of the `tempers`; of all their walks within (1 + slack)
    of the cheapest, `varied` chooses. Fewer than k where the colony knows fewer. The colony runs all its iterations,
    whatever its patience: until its pheromone has settled, ants stray too far from every good route.
    """
    system = replace(system, patience=None)
    floor, search = system.search(grid, [start], goal, rng, cost)
    best = cells_of(floor, search.best, 0)
    if len(best) < 2:
        return [best] if len(best) else []
    found = {best.tobytes(): best}
    costs = [float(search.best.cost[0])]
    for temper in tempers:
        walks = _sample(system, grid, floor, search, samples, tempered(search.pheromone, temper), rng)
        for ant in np.flatnonzero(walks.cost <= costs[0] * (1.0 + slack)).tolist():
            path = cells_of(floor, walks, ant)
            if path.tobytes() not in found:
                found[path.tobytes()] = path
                costs.append(float(walks.cost[ant]))
    paths = list(found.values())
    return [paths[index] for index in varied(paths, np.array(costs), grid.shape, k, slack)]


def replan(
    system: AntSystem,
    grid: GridMap,
    start: Cell,
    goal: Cell,
    rng: np.random.Generator,
    pheromone: Table | None,
    cost: NDArray[np.float64] | None = None,
    *,
    temper: float = WARM,
) -> tuple[Plan, Table]:
    """Return a plan and the pheromone to begin the next one with, for a floor on which something was moved.

    pheromone: float64[C, 8] that a search to the same goal on a floor of the same shape left behind; None to begin
    from nothing. The start may be another: a robot that has driven on.
    """
    begin = time.perf_counter()
    if pheromone is not None:
        if pheromone.shape != (grid.occupied.size, 8):
            raise ConfigError(f"pheromone of shape {pheromone.shape} is not from a floor of {grid.occupied.size} cells")
        pheromone = tempered(pheromone, temper)
    floor, search = system.search(grid, [start], goal, rng, cost, pheromone)
    cells = cells_of(floor, search.best, 0)
    seconds = time.perf_counter() - begin
    ahead = max(seconds - float(search.elapsed[-1]), 0.0)
    plan = Plan(cells, search.best_by_iteration[0], seconds, search.elapsed + ahead)
    return system.finish(grid, plan), search.pheromone


def _sample(
    system: AntSystem,
    grid: GridMap,
    floor: Floor,
    search: Search,
    samples: int,
    trail: Table,
    rng: np.random.Generator,
) -> Walks:
    """Let ants walk from the search's start over a trail that they leave as it is."""
    start = np.full(samples, search.best.start[0])
    turning, straight = system.colony(grid, floor, start).attraction(system.iterations - 1)
    walks = empty_walks(start, len(floor.height))
    seeds = rng.integers(1, 2**63, samples, dtype=np.uint64)
    visited = np.zeros(len(floor.height), np.int64)
    walk(floor, trail, turning, straight, seeds, 0.0, system.dead_end == "backtrack", (0.0, 0.0), visited, 1, walks)
    measure(floor, walks, 0, samples)
    return walks
