"""The one ant loop: every ant system is a set of slots around `run`.

Systems differ in the slots of `Colony`: attraction tables, greed and pheromone update. They share the compiled ants:
`send` lets one walk cell by cell over the moves of eq. 26 (paper 000) with its own tabu list. Live replanning
(simulation/traffic/ants.py) uses `send` with another weighing function.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, kernel, part, whole
from warehouse_env.maps.grid_map import MOVES
from warehouse_env.planning.ants.walks import AntFloor, Table, Walks, empty_walks, keep, measure

_SHIFT_13, _SHIFT_7, _SHIFT_17, _SHIFT_11 = np.uint64(13), np.uint64(7), np.uint64(17), np.uint64(11)
_TO_UNIT = 2.0**-53
ARRIVED = -1.0  # in place of a sum of weights

Slot = Callable[[AntFloor, int, Table, Walks, Walks], None]


@dataclass(frozen=True)
class Colony:
    """The slots. Iterations count from 0."""

    pheromone: Table  # at the start; run() works on a copy
    attraction: Callable[[int], tuple[Table, Table]]  # iteration -> eta^beta of an edge (at a turn, straight on)
    update: Slot  # (floor, iteration, pheromone, its walks, best so far): evaporation and deposit, in place
    trail_power: float = 1.0  # alpha: p ~ pheromone^alpha * attraction
    greedy: Callable[[int], float] | None = None  # iteration -> q0, the share of moves that take the best edge
    local_decay: float = 0.0  # ant colony system: each step moves its edge's pheromone by this share ...
    local_level: float = 0.0  # ... towards this level (needs trail_power 1)


class EdgeWeights(NamedTuple):
    """The tables by which ants choose their moves."""

    trail: Table  # pheromone^alpha; the local update writes it
    turning: Table  # eta^beta of an edge at a turn
    straight: Table  # eta^beta of an edge straight on


class WalkRule(NamedTuple):
    """How ants choose a move and mark it."""

    q0: float = 0.0  # share of moves that take the best edge
    backtrack: bool = True  # step back at a dead end; False: the ant dies
    local_decay: float = 0.0  # as in Colony
    local_level: float = 0.0


class Search(NamedTuple):
    """The result of `run`."""

    best: Walks  # [1], the best path; steps -1 where none was found
    best_by_iteration: NDArray[np.float64]  # [I] length [cells] of the best path so far, inf before any


def run(
    floor: AntFloor, colony: Colony, start: int, ants: int, iterations: int, rng: np.random.Generator, *,
    patience: int | None = None, backtrack: bool = True, appraise: Callable[[Walks], int] | None = None,
) -> Search:  # fmt: skip
    """Let ants walk from a cell to the goal on a floor of C cells, appraise their paths, and mark.

    The best path has the least (cost, turns). All random numbers follow from one draw of `rng`. patience: stop after so
    many iterations without a better path. backtrack: at a dead end ants step back, and the cell stays tabu; False: they
    die. appraise: measures the walks, may improve them, and returns the best ant, -1 if none; `measure` by default.
    """
    cells = len(floor.height)
    walks, best = empty_walks(start, ants, cells), empty_walks(start, 1, cells)
    seeds = rng.integers(1, 2**63, size=(iterations, ants), dtype=np.uint64)
    pheromone, visited = colony.pheromone.copy(), np.zeros(cells, np.int64)
    history, changed = np.full(iterations, np.inf), 0
    for iteration in range(iterations):
        edges = EdgeWeights(_raised(pheromone, colony.trail_power), *colony.attraction(iteration))
        q0 = colony.greedy(iteration) if colony.greedy else 0.0
        rule = WalkRule(q0, backtrack, colony.local_decay, colony.local_level)
        walk(floor, edges, rule, seeds[iteration], visited, 1 + iteration * ants, walks)
        winner = appraise(walks) if appraise else measure(floor, walks, 0, ants)
        if winner >= 0 and (walks.cost[winner], walks.turns[winner]) < (best.cost[0], best.turns[0]):
            keep(walks, winner, best)
            changed = iteration
        history[iteration:] = best.length[0]
        # an ant that steps back and does not arrive has visited all in its reach: the goal is cut off
        if iteration == 0 and (walks.steps[0] == 0 or (backtrack and walks.steps[0] < 0)):
            break
        colony.update(floor, iteration, pheromone, walks, best)
        if patience and iteration - changed >= patience and iteration + 1 < iterations:
            history = history[: iteration + 1]
            break
    return Search(best, history)


def _raised(table: Table, power: float) -> Table:
    """Return table^power; 1.5 (paper 002) by a root, in an eighth of the time."""
    if power == 1.0:
        return table
    raised: Table = table * np.sqrt(table) if power == 1.5 else table**power
    return raised


def cells_of(floor: AntFloor, walks: Walks, ant: int) -> NDArray[np.int64]:
    """The path of one ant as int64[L, 2] cells (row, col); (0, 2) where it did not arrive."""
    if walks.steps[ant] < 0:
        return np.empty((0, 2), np.int64)
    start = np.array([divmod(int(walks.start[ant]), floor.columns)], dtype=np.int64)
    return np.concatenate([start, start + np.cumsum(MOVES[walks.moves[ant, : walks.steps[ant]]], axis=0)])


@inline
def _next_random(state):
    """One step of xorshift64 (Marsaglia 2003); the state must not be 0."""
    state ^= state << _SHIFT_13
    state ^= state >> _SHIFT_7
    state ^= state << _SHIFT_17
    return state


@inline
def _offset(trip, move):
    """Return by how much a move changes the number of a cell."""
    return MOVES[move, 0] * trip.columns + MOVES[move, 1]


@inline
def _drawn(chance, left):
    """Return the place of float64[8] at which the sum of the weights up to it exceeds `left`."""
    found = whole(0)
    for move in range(8):
        if chance[move] > 0.0:
            found = move
            left -= chance[move]
            if left < 0.0:
                break
    return found


@inline
def _chosen(chance, total, q0, draw):
    """Return the move of a draw in [0, 1): with probability q0 the largest, else each by its share of the total."""
    if draw < q0:
        move = np.argmax(chance)
    else:
        if q0 > 0.0:  # known to be at least q0, draw is uniform above it, and so serves again
            draw = (draw - q0) / (1.0 - q0)
        move = _drawn(chance, draw * total)
    return move


class Trip(NamedTuple):
    """One ant's walk."""

    start: int  # cell
    ant: int  # its number, unique in the search
    columns: int  # of the floor
    trail: Table  # pheromone, which the walk changes by WalkRule.local_decay
    moves: NDArray[np.int8]  # output: its moves; as long as a path may be
    chance: NDArray[np.float64]  # [8], scratch for the weights of a cell's moves


def sender(weigh: Any) -> Any:
    """Return the compiled function (ground, rule, trip, generator) by which an ant walks; ground: what `weigh` needs.

    weigh: inlined function (ground, ant, cell, move by which it came or -1, chance) -> total. It writes the weight of
    each move to chance float64[8], 0 for those not allowed, and returns their sum, 0 at a dead end, or ARRIVED.
    """

    @part
    def send(ground, rule, trip, random):
        """Let an ant walk; return (its moves, whether it arrived, its generator).

        A move's chance is its share of the weights; with probability q0 the ant takes the largest instead (pseudo-
        random-proportional rule).
        """
        cell, steps, heading = trip.start, whole(0), whole(-1)
        q0, backtrack, decay, level = rule
        chance = trip.chance
        while True:
            total = weigh(ground, trip.ant, cell, heading, chance)
            if total == ARRIVED:
                return steps, True, random
            if total == 0.0 or steps == len(trip.moves):
                if not backtrack or steps == 0:
                    return steps, False, random
                steps -= 1
                cell -= _offset(trip, whole(trip.moves[steps]))
                heading = whole(trip.moves[steps - 1]) if steps > 0 else whole(-1)
                continue
            random = _next_random(random)
            heading = _chosen(chance, total, q0, (random >> _SHIFT_11) * _TO_UNIT)
            if decay > 0.0:
                trip.trail[cell, heading] += decay * (level - trip.trail[cell, heading])
            trip.moves[steps] = heading
            steps += 1
            cell += _offset(trip, heading)

    return send


@inline
def _weigh(ground, ant, cell, heading, chance):
    """Weigh the moves of a cell for `send`: trail * straight on, else trail * turning, over cells that are not tabu.

    Underflow to an all-zero roulette falls back to equal chances.
    """
    floor, edges, visited = ground
    visited[cell] = ant
    if cell == floor.goal:
        return ARRIVED
    total = 0.0
    for move in range(8):
        chance[move] = 0.0
        if visited[floor.neighbour[cell, move]] != ant:
            along = edges.straight[cell, move] if move == heading else edges.turning[cell, move]
            chance[move] = edges.trail[cell, move] * along
            total += chance[move]
    if not total > 0.0:  # a dead end, or all weights underflow
        total = 0.0
        for move in range(8):
            chance[move] = 1.0 if visited[floor.neighbour[cell, move]] != ant else 0.0
            total += chance[move]
    return total


_send = sender(_weigh)


@kernel
def walk(floor, edges, rule, seeds, visited, stamp, walks):
    """Send every ant from its start to the goal; writes walks.moves and walks.steps.

    seeds: uint64[m], one generator an ant. visited: int64[C], holds numbers below `stamp`.
    """
    chance, ground = np.zeros(8), (floor, edges, visited)
    for ant in range(len(seeds)):
        walks.steps[ant] = -1
        trip = Trip(walks.start[ant], stamp + ant, floor.columns, edges.trail, walks.moves[ant], chance)
        steps, arrived, _ = _send(ground, rule, trip, seeds[ant])
        if arrived:
            walks.steps[ant] = steps
