"""The one ant loop: every ant system is an assembly of slots around `run`.

What systems differ in are the slots of `Colony`: attraction tables, greed, dead ends, pheromone update, and what is
done to an iteration's best path. What they share is here, compiled: ants that walk cell by cell over the moves of
eq. 26 (paper 000), each with its own tabu list, and pheromone on directed edges.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import MOVES
from warehouse_env.planning.floor import Floor, Table
from warehouse_env.planning.walks import Walks, empty_walks, measure

_SHIFT_13, _SHIFT_7, _SHIFT_17, _SHIFT_11 = np.uint64(13), np.uint64(7), np.uint64(17), np.uint64(11)
_TO_UNIT = 2.0**-53


@dataclass(frozen=True)
class Colony:
    """The slots. Iterations count from 0."""

    ants: int
    iterations: int
    pheromone: Table  # at the start; run() works on a copy
    attraction: Callable[[int], tuple[Table, Table]]  # iteration -> eta^beta of an edge (at a turn, straight on)
    update: Callable[[int, Table, Walks], None]  # evaporation and deposit, in place
    improve: Callable[[NDArray[np.int8]], NDArray[np.int8]] | None = None  # best path of an iteration -> a better one
    trail_power: float = 1.0  # alpha: p ~ pheromone^alpha * attraction
    greedy: Callable[[int], float] | None = None  # iteration -> q0, the share of moves that take the best edge
    local_decay: float = 0.0  # ant colony system: each step moves its edge's pheromone by this share ...
    local_level: float = 0.0  # ... towards this level (needs trail_power 1)
    backtrack: bool = True  # at a dead end: step back, the cell stays tabu; False: the ant dies
    gentleness: float = 0.0  # cells of detour that one metre of climbing is worth


class Search(NamedTuple):
    """What `run` found."""

    moves: NDArray[np.int8]  # [L - 1], of the best path
    found: bool
    best_by_iteration: NDArray[np.float64]  # [iterations] length [cells] of the best path so far, inf before any


def run(floor: Floor, colony: Colony, rng: np.random.Generator) -> Search:
    """Let the ants walk, improve, and mark, `colony.iterations` times.

    The best path has the least (cost, turns). All random numbers follow from one draw of `rng`. If ants step back
    from dead ends, one that does not arrive has visited all it can reach: the goal is unreachable, and the loop ends.
    """
    history = np.full(colony.iterations, np.inf)
    if floor.start == floor.goal:
        return Search(np.empty(0, np.int8), True, np.zeros(colony.iterations))
    cells, m = len(floor.height), colony.ants
    walks = empty_walks(m, cells)
    pheromone = colony.pheromone.copy()
    seeds = rng.integers(1, 2**63, size=(colony.iterations, m), dtype=np.uint64)
    visited = np.zeros(cells, np.int64)
    best: tuple[float, int] = (math.inf, 0)
    best_moves, best_length = np.empty(0, np.int8), math.inf
    for iteration in range(colony.iterations):
        trail = pheromone if colony.trail_power == 1.0 else pheromone**colony.trail_power
        turning, straight = colony.attraction(iteration)
        q0 = colony.greedy(iteration) if colony.greedy else 0.0
        local = (colony.local_decay, colony.local_level)
        stamp = 1 + iteration * m
        walk(floor, trail, turning, straight, seeds[iteration], q0, colony.backtrack, local, visited, stamp, walks)
        if colony.backtrack and walks.steps[0] < 0:
            break
        winner = measure(floor, colony.gentleness, walks, 0, m)
        if winner >= 0:
            if colony.improve:
                moves = colony.improve(walks.moves[winner, : walks.steps[winner]])
                walks.moves[winner, : len(moves)] = moves
                walks.steps[winner] = len(moves)
                measure(floor, colony.gentleness, walks, winner, winner + 1)
            if (walks.cost[winner], walks.turns[winner]) < best:
                best = (walks.cost[winner], walks.turns[winner])
                best_moves, best_length = walks.moves[winner, : walks.steps[winner]].copy(), walks.length[winner]
        history[iteration] = best_length
        colony.update(iteration, pheromone, walks)
    return Search(best_moves, math.isfinite(best_length), history)


def cells_of(floor: Floor, search: Search) -> NDArray[np.int64]:
    """The path as int64[L, 2] cells (row, col); (0, 2) where none was found."""
    if not search.found:
        return np.empty((0, 2), np.int64)
    start = np.array([divmod(floor.start, floor.columns)], dtype=np.int64)
    return np.concatenate([start, start + np.cumsum(MOVES[search.moves], axis=0)])


@njit(cache=True)
def _next_random(state: np.uint64) -> np.uint64:
    """One step of xorshift64 (Marsaglia 2003); the state must not be 0."""
    state ^= state << _SHIFT_13
    state ^= state >> _SHIFT_7
    state ^= state << _SHIFT_17
    return state


@njit(cache=True, error_model="numpy")
def walk(
    floor: Floor,
    trail: Table,
    turning: Table,
    straight: Table,
    seeds: NDArray[np.uint64],
    q0: float,
    backtrack: bool,
    local: tuple[float, float],
    visited: NDArray[np.int64],
    stamp: int,
    walks: Walks,
) -> None:
    """Send every ant from start to goal; writes walks.moves and walks.steps.

    An edge's chance is trail * straight if it goes straight on, else trail * turning, over the neighbours that are not
    tabu; with probability q0 the largest is taken instead (pseudo-random-proportional rule). Underflow to an
    all-zero roulette falls back to equal chances. seeds: uint64[m], one generator an ant. visited: int64[C], holds
    numbers below `stamp`.
    """
    neighbour, goal = floor.neighbour, floor.goal
    decay, level = local
    chance = np.zeros(8)
    for ant in range(len(seeds)):
        moves, random, tabu = walks.moves[ant], seeds[ant], stamp + ant
        cell, steps, heading = floor.start, 0, -1
        visited[cell] = tabu
        while cell != goal:
            total = _weigh(neighbour, trail, turning, straight, visited, tabu, cell, heading, chance)
            if total == 0.0:
                if not backtrack or steps == 0:
                    steps = -1
                    break
                steps -= 1
                cell = neighbour[cell, (moves[steps] + 4) % 8]
                heading = moves[steps - 1] if steps > 0 else -1
                continue
            random = _next_random(random)
            draw = (random >> _SHIFT_11) * _TO_UNIT
            if draw < q0:
                heading = _largest(chance)
            else:  # the roulette stands here in line, since in a function of its own it takes a quarter longer
                if q0 > 0.0:  # known to be at least q0, draw is uniform above it, and so serves again
                    draw = (draw - q0) / (1.0 - q0)
                left = draw * total
                heading = 0
                for move in range(8):
                    if chance[move] > 0.0:
                        heading = move
                        left -= chance[move]
                        if left < 0.0:
                            break
            if decay > 0.0:
                trail[cell, heading] += decay * (level - trail[cell, heading])
            moves[steps] = heading
            steps += 1
            cell = neighbour[cell, heading]
            visited[cell] = tabu
        walks.steps[ant] = steps


@njit(cache=True, forceinline=True, error_model="numpy")
def _weigh(
    neighbour: NDArray[np.int32],
    trail: Table,
    turning: Table,
    straight: Table,
    visited: NDArray[np.int64],
    tabu: int,
    cell: int,
    heading: int,
    chance: NDArray[np.float64],
) -> float:
    """Write the weight of each move to chance float64[8], 0 for those not allowed; return the sum, 0 at a dead end."""
    total = 0.0
    for move in range(8):
        chance[move] = 0.0
        if visited[neighbour[cell, move]] != tabu:
            along = straight[cell, move] if move == heading else turning[cell, move]
            chance[move] = trail[cell, move] * along
            total += chance[move]
    if not total > 0.0:  # a dead end, or all weights underflow
        total = 0.0
        for move in range(8):
            chance[move] = 1.0 if visited[neighbour[cell, move]] != tabu else 0.0
            total += chance[move]
    return total


@njit(cache=True)
def _largest(chance: NDArray[np.float64]) -> int:
    """The first place of the largest of float64[8]."""
    best = 0
    for move in range(1, 8):
        if chance[move] > chance[best]:
            best = move
    return best
