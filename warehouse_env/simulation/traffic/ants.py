"""The potential-field ant colony on the way: a small colony for each replan of a robot.

The ants walk as in all colonies (planning/ants/colony.py). As in paper 000, p ~ pheromone * eta^exponent with
eta = a*L + b*N + c*T (eqs. 8-15 on an even floor; planning/ants/pf_aco.py), and ants mark the edges of their ways (eqs.
18-20). Different here:

- L is the fall of the exact cost-to-go (planning/cost_to_go.py) per unit of a move's cost, including the prices of
  other robots (prices.py). It replaces the straight pull of the goal, so that few ants suffice.
- Where prices make the cost-to-go too low, ants raise it (learning real-time A*, Korf 1990). So the potential field
  learns as the pheromone does, and bounds the rest of a way.
- Ants walk up to the replanning horizon, and give up when they cannot beat the best way any more.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, part, whole
from warehouse_env.maps.grid_map import MOVES
from warehouse_env.planning.ants.colony import ARRIVED, Trip, WalkRule, sender
from warehouse_env.planning.cost_to_go import UNIT, UNREACHABLE
from warehouse_env.planning.graph_search import START, is_hairpin
from warehouse_env.simulation.traffic.prices import ANY, is_beyond, price_of, rest_from

ANTS, ITERATIONS = 8, 20
PATIENCE = 8  # iterations without a better way, once there is one, after which ants are not sent again
PULL, EVEN, AHEAD = 1.0, 0.02, 0.2  # a, of the fall of the cost-to-go; b*N, so that every move is possible; c*T
BOLD = 0.8  # how often an ant takes the most attractive move (as in Ant Colony System, Dorigo & Gambardella 1997)
EVAPORATION = 0.3  # an iteration
STRENGTH = 0.5  # of the trail of an ant that lost nothing to others
MOST_STEPS = 160  # of an ant


class Trails(NamedTuple):
    """What the ants of a query write; `run` marks the cells of the present query."""

    run: NDArray[np.int64]  # [1], number of queries
    at: NDArray[np.int64]  # [C], the query in which a cell's moves were priced
    touched: NDArray[np.int32]  # [C], these cells, ...
    listed: NDArray[np.int64]  # [1], ... so many
    seen: NDArray[np.int64]  # [C], the query that has given a cell its potential
    rest: NDArray[np.int32]  # [C], the potential: a lower bound of the cost from a cell
    cost: NDArray[np.int32]  # [C, 8], what a move costs, others included; 0 where it cannot be made
    trail: NDArray[np.float32]  # [C, 8], pheromone
    tabu: NDArray[np.int64]  # [C], the last ant that has been on a cell
    price: NDArray[np.int64]  # [8], costs of the moves for the choosing ant, hairpins included
    chance: NDArray[np.float64]  # [8], their weights
    spent: NDArray[np.int64]  # [1], what an ant's way has cost
    moves: NDArray[np.int8]  # [MOST_STEPS], an ant's
    best: NDArray[np.int8]  # [MOST_STEPS], those of the best way


def make_trails(rows: int, columns: int) -> Trails:
    """Return room for the ants on a floor."""
    cells = rows * columns
    return Trails(
        np.zeros(1, np.int64), np.zeros(cells, np.int64), np.zeros(cells, np.int32), np.zeros(1, np.int64),
        np.zeros(cells, np.int64), np.zeros(cells, np.int32), np.zeros((cells, 8), np.int32),
        np.zeros((cells, 8), np.float32), np.zeros(cells, np.int64), np.zeros(8, np.int64), np.zeros(8),
        np.zeros(1, np.int64), np.zeros(MOST_STEPS, np.int8), np.zeros(MOST_STEPS, np.int8),
    )  # fmt: skip


@inline
def _to(look, cell, move):
    """Return the cell that a move leads to."""
    return cell + MOVES[move, 0] * look.steps.shape[1] + MOVES[move, 1]


@inline
def _see(look, trails, cell):
    """Return a cell's potential; set it first if this query has not."""
    if trails.seen[cell] != trails.run[0]:
        columns = look.steps.shape[1]
        trails.seen[cell] = trails.run[0]
        trails.rest[cell] = rest_from(look, cell // columns, cell % columns)
    return int(trails.rest[cell])


@part
def _touch(look, trails, cell):
    """Price a cell's moves, unless this query has done so."""
    if trails.at[cell] == trails.run[0]:
        return
    trails.at[cell] = trails.run[0]
    trails.touched[trails.listed[0]] = cell
    trails.listed[0] += 1
    columns = look.steps.shape[1]
    for move in range(8):
        step = int(look.steps[cell // columns, cell % columns, move])
        trails.trail[cell, move] = np.float32(1.0)
        trails.cost[cell, move] = 0
        if step > 0 and _see(look, trails, _to(look, cell, move)) != UNREACHABLE:
            trails.cost[cell, move] = step + price_of(look, cell, move, _to(look, cell, move))


@part
def _raise(look, trails, cell):
    """Raise a cell's potential to the lower bound of its best move."""
    best = ANY
    for move in range(8):
        if trails.cost[cell, move] > 0:
            best = min(best, int(trails.cost[cell, move]) + int(trails.rest[_to(look, cell, move)]))
    trails.rest[cell] = max(int(trails.rest[cell]), best)


@inline
def _weigh(ground, ant, cell, arrived, chance):
    """Weigh the moves of a cell (eq. 8) for an ant, which arrives at the horizon or the goal."""
    look, trails, most = ground
    columns, arrived = look.steps.shape[1], arrived if arrived >= 0 else START
    trails.tabu[cell] = ant
    trails.spent[0] = trails.spent[0] + trails.price[arrived] if arrived != START else 0
    rest = _see(look, trails, cell)
    if rest == 0 or is_beyond(look, cell // columns, cell % columns):
        trails.spent[0] += rest
        return ARRIVED if trails.spent[0] <= most else 0.0
    _touch(look, trails, cell)
    _raise(look, trails, cell)
    rest, total = int(trails.rest[cell]), 0.0
    if trails.spent[0] + rest > most:
        return total
    for move in range(8):
        chance[move] = 0.0
        cost, to = int(trails.cost[cell, move]), _to(look, cell, move)
        if cost == 0 or trails.tabu[to] == ant:
            continue
        if is_hairpin(arrived, move):
            cost += look.hairpin
        eta = PULL * max((rest - int(trails.rest[to])) / cost, 0.0) + EVEN + (AHEAD if move == arrived else 0.0)
        eta *= eta
        eta *= eta
        trails.price[move], chance[move] = cost, eta * eta * np.float64(trails.trail[cell, move])
        total += chance[move]
    return total


_send = sender(_weigh)


@part
def _mark(look, trails, count, amount):
    """Leave pheromone on the edges of the best way, of so many steps (eq. 19)."""
    cell = look.row * look.steps.shape[1] + look.column
    for k in range(count):
        trails.trail[cell, trails.best[k]] += amount
        cell = _to(look, cell, whole(trails.best[k]))


@part
def _fade(trails):
    """Let pheromone evaporate towards 1 (eq. 18)."""
    for k in range(trails.listed[0]):
        cell = trails.touched[k]
        for move in range(8):
            trails.trail[cell, move] += np.float32(EVAPORATION) * (np.float32(1.0) - trails.trail[cell, move])


@part
def _send_one(look, most, trails, ant, random):
    """Let an ant walk from the robot; return (its steps, -1 if it gave up; its random generator).

    It gives up once its way must cost over `most`. Its moves: trails.moves; their cost: trails.spent.
    """
    columns = look.steps.shape[1]
    rule = WalkRule(BOLD, False, 0.0, 0.0)  # an ant at a dead end gives up
    trip = Trip(look.row * columns + look.column, ant, columns, trails.trail, trails.moves, trails.chance)
    count, arrived, random = _send((look, trails, most), rule, trip, random)
    cell = trip.start
    for k in range(count):
        cell = _to(look, cell, whole(trails.moves[k]))
    for k in range(count - 1, -1, -1):  # pass what it has learned back along its way
        cell = _to(look, cell, (whole(trails.moves[k]) + 4) % 8)
        _raise(look, trails, cell)
    return count if arrived else -1, random


@part
def colonise(look, most, seed, trails):
    """Run a colony; return (steps of its best way, cost), or (-1, ANY) if it finds none that costs at most `most`.

    The moves of the best way: trails.best. seed: of the ants' random numbers.
    """
    trails.run[0] += 1
    trails.listed[0] = 0
    start = look.row * look.steps.shape[1] + look.column
    least = _see(look, trails, start)
    best, cost, since, random = whole(-1), ANY, 0, np.uint64(seed)
    for iteration in range(ITERATIONS):
        since += 1
        for k in range(ANTS):
            ant = (trails.run[0] * ITERATIONS + iteration) * ANTS + k
            count, random = _send_one(look, min(most, cost - 1), trails, ant, random)
            if count >= 0:
                best, cost, since = count, trails.spent[0], 0
                for step in range(count):
                    trails.best[step] = trails.moves[step]
            elif trails.rest[start] > min(most, cost - 1):
                break  # no better way is left
        if best >= 0:
            _mark(look, trails, best, np.float32(STRENGTH * UNIT / (UNIT + cost - least)))
        if (best >= 0 and since >= PATIENCE) or trails.rest[start] > min(most, cost - 1):
            break
        _fade(trails)
    return best, cost


@inline
def lead(look, most, seed, trails, path):
    """Write the ants' way up to the horizon to `path`; return (number of cells, the move to the last one)."""
    best, _ = colonise(look, most, seed, trails)
    path[0, 0], path[0, 1] = look.row, look.column
    for k in range(best):
        move = trails.best[k]
        path[k + 1, 0], path[k + 1, 1] = path[k, 0] + MOVES[move, 0], path[k, 1] + MOVES[move, 1]
    return best + 1, whole(trails.best[best - 1]) if best > 0 else START
