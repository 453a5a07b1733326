"""The one ant loop: every ant system is an assembly of slots around `run`.

What systems differ in are the slots of `Colony`: attraction tables, greed, dead ends, pheromone update, and what is
done to an iteration's best path. What they share is here, compiled: ants that walk cell by cell over the moves of
eq. 26 (paper 000), each with its own tabu list, and pheromone on directed edges. Cells are flat indices
row * columns + column, an edge is (cell, move), and a path is its moves from the start.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import MOVES, Cell, GridMap

Table = NDArray[np.float64]  # [C, 8]: one number an edge

_SQRT2 = math.sqrt(2.0)
_SHIFT_13, _SHIFT_7, _SHIFT_17, _SHIFT_11 = np.uint64(13), np.uint64(7), np.uint64(17), np.uint64(11)
_TO_UNIT = 2.0**-53
MICROMETRES = 1e6  # heights are counted in whole micrometres, so that sums of them are exact


class Floor(NamedTuple):
    """A map and a task as the kernels want them, C = H * W cells."""

    legal: NDArray[np.bool_]  # [C, 8], may the move be made (eq. 26)
    neighbour: NDArray[np.int32]  # [C, 8], the cell that a move leads to; the cell itself if it is not legal
    height: NDArray[np.int64]  # [C] micrometres
    start: int
    goal: int
    columns: int

    @property
    def flat(self) -> bool:
        """True where all cells are equally high."""
        return bool((self.height == self.height[0]).all())


def make_floor(grid: GridMap, start: Cell, goal: Cell) -> Floor:
    """Prepare a map and a task for the colony."""
    rows, cols = grid.occupied.shape
    step = MOVES[:, 0] * cols + MOVES[:, 1]
    cell = np.arange(rows * cols)[:, None]
    legal = grid.legal_moves.reshape(-1, 8)
    return Floor(
        legal,
        np.where(legal, cell + step, cell).astype(np.int32),
        np.rint(grid.height.astype(np.float64).ravel() * MICROMETRES).astype(np.int64),
        start[0] * cols + start[1],
        goal[0] * cols + goal[1],
        cols,
    )


class Walks(NamedTuple):
    """The paths of one iteration's m ants; the buffers of the loop, overwritten by the next iteration."""

    moves: NDArray[np.int8]  # [m, C], valid up to steps
    steps: NDArray[np.int64]  # [m], -1 for an ant that did not arrive
    length: NDArray[np.float64]  # [m] cells
    turns: NDArray[np.int64]  # [m] direction changes
    spread: NDArray[np.float64]  # [m] metres, standard deviation of the path's heights (eq. 24, paper 000)
    cost: NDArray[np.float64]  # [m] cells, length + gentleness * metres climbed: what "best" means


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
    walks = Walks(
        np.empty((m, cells), np.int8),
        np.empty(m, np.int64),
        np.empty(m),
        np.empty(m, np.int64),
        np.empty(m),
        np.empty(m),
    )
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
    neighbour, moves, goal = floor.neighbour, walks.moves, floor.goal
    decay, level = local
    chance = np.zeros(8)
    for ant in range(len(seeds)):
        random = seeds[ant]
        tabu = stamp + ant
        cell, steps, heading = floor.start, 0, -1
        visited[cell] = tabu
        while cell != goal:
            total = 0.0
            for move in range(8):
                chance[move] = 0.0
                if visited[neighbour[cell, move]] != tabu:
                    along = straight[cell, move] if move == heading else turning[cell, move]
                    chance[move] = trail[cell, move] * along
                    total += chance[move]
            if not total > 0.0:
                for move in range(8):
                    chance[move] = 1.0 if visited[neighbour[cell, move]] != tabu else 0.0
                    total += chance[move]
            if total == 0.0:
                if not backtrack or steps == 0:
                    steps = -1
                    break
                steps -= 1
                cell = neighbour[cell, (moves[ant, steps] + 4) % 8]
                heading = moves[ant, steps - 1] if steps > 0 else -1
                continue
            random = _next_random(random)
            draw = (random >> _SHIFT_11) * _TO_UNIT
            if draw < q0:
                choice = _largest(chance)
            else:
                if q0 > 0.0:  # known to be at least q0, draw is uniform above it, and so serves again
                    draw = (draw - q0) / (1.0 - q0)
                left = draw * total
                choice = 0
                for move in range(8):
                    if chance[move] > 0.0:
                        choice = move
                        left -= chance[move]
                        if left < 0.0:
                            break
            if decay > 0.0:
                trail[cell, choice] += decay * (level - trail[cell, choice])
            moves[ant, steps] = choice
            steps += 1
            heading = choice
            cell = neighbour[cell, choice]
            visited[cell] = tabu
        walks.steps[ant] = steps


@njit(cache=True)
def _largest(chance: NDArray[np.float64]) -> int:
    """The first place of the largest of float64[8]."""
    best = 0
    for move in range(1, 8):
        if chance[move] > chance[best]:
            best = move
    return best


@njit(cache=True, error_model="numpy")
def measure(floor: Floor, gentleness: float, walks: Walks, first: int, last: int) -> int:
    """Fill length, turns, spread and cost of ants first..last-1; return the best of them by (cost, turns), -1 if none.

    gentleness: cells per metre climbed.
    """
    best = -1
    for ant in range(first, last):
        count = walks.steps[ant]
        if count < 0:
            walks.length[ant] = walks.cost[ant] = np.inf
            walks.turns[ant] = 0
            walks.spread[ant] = np.inf
            continue
        diagonal, turned, climbed, cell, heading = 0, 0, 0, floor.start, -1
        height_sum = floor.height[cell]
        for step in range(count):
            move = walks.moves[ant, step]
            to = floor.neighbour[cell, move]
            diagonal += move % 2
            if step > 0 and move != heading:
                turned += 1
            climbed += abs(floor.height[to] - floor.height[cell])
            height_sum += floor.height[to]
            heading, cell = move, to
        walks.length[ant] = (count - diagonal) + diagonal * _SQRT2
        walks.turns[ant] = turned
        walks.cost[ant] = walks.length[ant] + gentleness * climbed / MICROMETRES
        walks.spread[ant] = 0.0 if climbed == 0 else _spread(floor, walks.moves[ant], count, height_sum / (count + 1))
        better = best < 0 or walks.cost[ant] < walks.cost[best]
        if better or (walks.cost[ant] == walks.cost[best] and walks.turns[ant] < walks.turns[best]):
            best = ant
    return best


@njit(cache=True, error_model="numpy")
def _spread(floor: Floor, moves: NDArray[np.int8], count: int, mean: float) -> float:
    """Standard deviation [m] of the heights along a path with p - 1 = count steps (eq. 24, paper 000)."""
    cell = floor.start
    deviation = floor.height[cell] - mean
    total = deviation * deviation
    for step in range(count):
        cell = floor.neighbour[cell, moves[step]]
        deviation = floor.height[cell] - mean
        total += deviation * deviation
    return math.sqrt(total / count) / MICROMETRES


@njit(cache=True)
def deposit(floor: Floor, pheromone: Table, walks: Walks, amount: NDArray[np.float64]) -> None:
    """Add amount float64[m] of each arrived ant to every edge of its path, in place."""
    for ant in range(len(amount)):
        cell = floor.start
        for step in range(walks.steps[ant]):
            move = walks.moves[ant, step]
            pheromone[cell, move] += amount[ant]
            cell = floor.neighbour[cell, move]


def cells_of(floor: Floor, search: Search) -> NDArray[np.int64]:
    """The path as int64[L, 2] cells (row, col); (0, 2) where none was found."""
    if not search.found:
        return np.empty((0, 2), np.int64)
    start = np.array([divmod(floor.start, floor.columns)], dtype=np.int64)
    return np.concatenate([start, start + np.cumsum(MOVES[search.moves], axis=0)])
