"""Several good routes for one task from a colony's final pheromone.

Beyond the papers. Pheromone lies on all good paths, not only on the best, so ants that walk over the tempered final
pheromone (planning/ants/warm.py) find other near-optimal routes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning.ants.colony import EdgeWeights, Search, WalkRule, cells_of, walk
from warehouse_env.planning.ants.floor import Floor, Table
from warehouse_env.planning.ants.system import AntSystem
from warehouse_env.planning.ants.walks import Walks, empty_walks, measure
from warehouse_env.planning.ants.warm import tempered
from warehouse_env.traffic.alternatives import varied
from warehouse_env.traffic.conflicts import Route

SPREAD = (0.25, 0.5, 1.0)  # tempers for other routes: less strays from good ones, more repeats the best


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
    floor, search = system.search(grid, start, goal, rng, cost)
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
    start = int(search.best.start[0])
    turning, straight = system.colony(grid, floor, start).attraction(system.iterations - 1)
    walks = empty_walks(start, samples, len(floor.height))
    seeds = rng.integers(1, 2**63, samples, dtype=np.uint64)
    visited = np.zeros(len(floor.height), np.int64)
    edges, rule = EdgeWeights(trail, turning, straight), WalkRule(backtrack=system.dead_end == "backtrack")
    walk(floor, edges, rule, seeds, visited, 1, walks)
    measure(floor, walks, 0, samples)
    return walks
