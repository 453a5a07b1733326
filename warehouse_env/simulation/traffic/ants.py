"""The potential-field ant colony on the way: a small one at each look of a robot, which remembers the look before.

As in paper 000, p ~ pheromone * eta^exponent with eta = a*L + b*N + c*T (eqs. 8-15 on an even floor; planning/ants/
pf_aco.py reads them), and what ants have found marks their edges (eqs. 18-20). Ours is:

- L is the fall of the exact cost-to-go (planning/cost_to_go.py) for each unit of a move's cost, which
  others raise (prices.py), in place of the straight pull of the goal, so that few ants suffice;
- where ants find the cost-to-go to be too little for what others make the moves cost, they raise it (learning real-time
  A*, Korf 1990): the potential field learns as well as the pheromone, and bounds what is left of a way;
- ants walk as far as a robot looks, and turn back where they cannot beat the best way any more;
- what is left of the pheromone of a robot's last look is where its ants begin (a trail that survives a change of the
  floor, as in the dynamic ant systems of the literature);
- the best way is straightened: each stretch of it that two straight runs can replace for less is replaced.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, kernel, part, whole
from warehouse_env.maps.grid_map import MOVES, Cell
from warehouse_env.planning.cost_to_go import UNIT, UNREACHABLE
from warehouse_env.portable import Portable
from warehouse_env.simulation.traffic.prices import ANY, Look, is_beyond, most_for, price_of, rest_from
from warehouse_env.simulation.traffic.ways import START, is_hairpin, make_path, write_rest, write_tail

ANTS, ITERATIONS = 8, 20
PATIENCE = 3  # iterations without a better way, once there is one, after which ants are not sent again
PULL, EVEN, AHEAD = 1.0, 0.02, 0.1  # a, of the fall of the cost-to-go; b*N, so that every move is possible; c*T
BOLD = 0.9  # how often an ant takes the most attractive move (as in Ant Colony System, Dorigo & Gambardella 1997)
EVAPORATION = 0.3  # an iteration
KEPT = 0.5  # of a trail from one look to the next
STRENGTH = 2.0  # of the trail of an ant that lost nothing to others
FAINTEST = 1.05  # of a trail that is kept, where none is 1
MOST_STEPS = 160  # of an ant
MOST_KEPT = 256  # edges of a robot's trail
_RUNS = 8  # moves that are replaced by two straight runs at most
_SHIFT_13, _SHIFT_7, _SHIFT_17, _SHIFT_11 = np.uint64(13), np.uint64(7), np.uint64(17), np.uint64(11)
_TO_UNIT = 2.0**-53
_WORD = 2**64 - 1
_NO_TRAIL: tuple[Cell | None, NDArray[np.int32], NDArray[np.float32]] = (
    None,
    np.empty(0, np.int32),
    np.empty(0, np.float32),
)


class Trails(NamedTuple):
    """What a look's ants write; cells of other looks are told apart by `run`."""

    run: NDArray[np.int64]  # [1], how many looks there have been
    at: NDArray[np.int64]  # [C], the look in which a cell was touched
    touched: NDArray[np.int32]  # [C], the cells of this look, ...
    listed: NDArray[np.int64]  # [1], ... so many
    seen: NDArray[np.int64]  # [C], the look that has given a cell its potential
    rest: NDArray[np.int32]  # [C], the potential: what going on from a cell costs at least
    cost: NDArray[np.int32]  # [C, 8], what a move costs, others included; 0 where it cannot be made
    trail: NDArray[np.float32]  # [C, 8], pheromone
    tabu: NDArray[np.int64]  # [C], the last ant that has been on a cell
    weight: NDArray[np.float64]  # [8], of the moves of the ant that chooses
    walk: NDArray[np.int8]  # [2, MOST_STEPS], the moves of an ant, and of the best
    edges: NDArray[np.int32]  # [MOST_KEPT], 8 * cell + move of the trail that is kept
    levels: NDArray[np.float32]  # [MOST_KEPT]


def make_trails(cells: int) -> Trails:
    """Return room for the ants on so many cells."""
    return Trails(
        np.zeros(1, np.int64), np.zeros(cells, np.int64), np.zeros(cells, np.int32), np.zeros(1, np.int64),
        np.zeros(cells, np.int64), np.zeros(cells, np.int32), np.zeros((cells, 8), np.int32),
        np.zeros((cells, 8), np.float32),
        np.zeros(cells, np.int64), np.zeros(8), np.zeros((2, MOST_STEPS), np.int8),
        np.zeros(MOST_KEPT, np.int32), np.zeros(MOST_KEPT, np.float32),
    )  # fmt: skip


@inline
def _to(look, cell, move):
    """Return the cell that a move leads to."""
    return cell + MOVES[move, 0] * look.steps.shape[1] + MOVES[move, 1]


@inline
def _see(look, trails, cell):
    """Give a cell its first potential, unless this look has seen it before; return it."""
    if trails.seen[cell] != trails.run[0]:
        columns = look.steps.shape[1]
        trails.seen[cell] = trails.run[0]
        trails.rest[cell] = rest_from(look, cell // columns, cell % columns)
    return int(trails.rest[cell])


@part
def _touch(look, trails, cell):
    """Ask what a cell's moves cost, unless this look has touched it before."""
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
    """Raise a cell's potential to what its best move costs at least (learning real-time A*, Korf 1990)."""
    best = ANY
    for move in range(8):
        if trails.cost[cell, move] > 0:
            best = min(best, int(trails.cost[cell, move]) + int(trails.rest[_to(look, cell, move)]))
    trails.rest[cell] = max(int(trails.rest[cell]), best)


@inline
def _draw(state):
    """Return the next state of a generator (xorshift, Marsaglia 2003) and a number in [0, 1)."""
    state ^= state << _SHIFT_13
    state ^= state >> _SHIFT_7
    state ^= state << _SHIFT_17
    return state, np.float64(state >> _SHIFT_11) * _TO_UNIT


@part
def _choose(look, trails, cell, arrived, ant, draw):
    """Return an ant's next move, -1 at a dead end: mostly that of the most weight, else by chance (eq. 8)."""
    rest, total, last = trails.rest[cell], 0.0, -1
    for move in range(8):
        trails.weight[move] = 0.0
        cost = int(trails.cost[cell, move])
        if cost == 0 or trails.tabu[_to(look, cell, move)] == ant:
            continue
        if is_hairpin(arrived, move):
            cost += look.hairpin
        fall = (rest - int(trails.rest[_to(look, cell, move)])) / cost
        eta = PULL * max(fall, 0.0) + EVEN + (AHEAD if move == arrived else 0.0)
        eta *= eta
        eta *= eta
        trails.weight[move] = eta * eta * np.float64(trails.trail[cell, move])
        total += trails.weight[move]
    left = (draw - BOLD) / (1.0 - BOLD) * total
    for move in range(8):
        weight = trails.weight[move]
        if weight > 0.0:
            if draw < BOLD:
                last = move if last < 0 or weight > trails.weight[last] else last
                continue
            last = move
            left -= weight
            if left < 0.0:
                break
    return last


@inline
def _move_cost(look, cell, arrived, move):
    """Return (the cell that a move leads to, what it costs after another)."""
    to = _to(look, cell, move)
    columns = look.steps.shape[1]
    cost = int(look.steps[cell // columns, cell % columns, move]) + price_of(look, cell, move, to)
    return to, cost + (look.hairpin if is_hairpin(arrived, move) else 0)


@part
def _walk(look, most, trails, ant, state):
    """Let an ant walk from the robot on; return (its steps, its cost, its generator), -1 steps if it gave up.

    It gives up where it could only come to more than `most`. Its moves: trails.walk[0].
    """
    columns = look.steps.shape[1]
    cell, arrived, cost, count, found = look.row * columns + look.column, START, 0, 0, False
    while count < MOST_STEPS:
        trails.tabu[cell] = ant
        rest = _see(look, trails, cell)
        found = cost + rest <= most and (rest == 0 or is_beyond(look, cell // columns, cell % columns))
        if found:
            cost += rest
            break
        _touch(look, trails, cell)
        _raise(look, trails, cell)
        if cost + trails.rest[cell] > most:
            break
        state, draw = _draw(state)
        move = _choose(look, trails, cell, arrived, ant, draw)
        if move < 0:
            break
        cost += int(trails.cost[cell, move]) + (look.hairpin if is_hairpin(arrived, move) else 0)
        cell = _to(look, cell, move)
        trails.walk[0, count], arrived = move, move
        count += 1
    for k in range(count - 1, -1, -1):  # what it has learned, told back along its way
        cell = _to(look, cell, (whole(trails.walk[0, k]) + 4) % 8)
        _raise(look, trails, cell)
    return count if found else -1, cost, state


@part
def _mark(look, trails, walk, count, amount):
    """Leave pheromone on the edges of a way of so many steps (eq. 19)."""
    columns = look.steps.shape[1]
    cell = look.row * columns + look.column
    for k in range(count):
        move = whole(trails.walk[walk, k])
        _touch(look, trails, cell)
        trails.trail[cell, move] += amount
        cell = _to(look, cell, move)


@part
def _fade(trails):
    """Let pheromone evaporate towards 1 (eq. 18)."""
    for k in range(trails.listed[0]):
        cell = trails.touched[k]
        for move in range(8):
            trails.trail[cell, move] += np.float32(EVAPORATION) * (np.float32(1.0) - trails.trail[cell, move])


@part
def _remember(look, trails, edges, levels):
    """Lay what is left of the trail of a robot's last look, where its field still reaches."""
    columns = look.steps.shape[1]
    for k in range(len(edges)):
        cell = edges[k] // 8
        if rest_from(look, cell // columns, cell % columns) != UNREACHABLE:
            _touch(look, trails, cell)
            trails.trail[cell, edges[k] % 8] = np.float32(1.0) + np.float32(KEPT) * (levels[k] - np.float32(1.0))


@part
def _keep(trails):
    """Write the trail that a robot remembers to trails.edges and trails.levels; return of how many edges."""
    count = 0
    for k in range(trails.listed[0]):
        cell = trails.touched[k]
        for move in range(8):
            if trails.trail[cell, move] > FAINTEST and count < MOST_KEPT:
                trails.edges[count], trails.levels[count] = 8 * cell + move, trails.trail[cell, move]
                count += 1
    return count


@inline
def _direction(d_row, d_column):
    """Return the move that leads to rows and columns of these signs."""
    for move in range(8):
        if MOVES[move, 0] == np.sign(d_row) and MOVES[move, 1] == np.sign(d_column):
            return move
    return -1


@part
def _run(look, cell, d_row, d_column, diagonal_first, arrived, after, most, walk):
    """Write the moves of two straight runs over rows and columns to `walk`; return their cost, ANY if above `most`.

    after: the move that follows them, or START.
    """
    slant, long = min(abs(d_row), abs(d_column)), max(abs(d_row), abs(d_column))
    straight = _direction(d_row if abs(d_row) == long else 0, d_column if abs(d_column) == long else 0)
    if slant > 0 and abs(d_row) == abs(d_column):
        straight = -1
    diagonal = _direction(d_row, d_column) if slant > 0 else -1
    columns, cost = look.steps.shape[1], 0
    for k in range(long):
        move = diagonal if (k < slant if diagonal_first else k >= long - slant) else straight
        if look.steps[cell // columns, cell % columns, move] == 0:
            return ANY
        cell, more = _move_cost(look, cell, arrived, move)
        cost += more
        if cost > most:
            return ANY
        walk[k], arrived = move, move
    return cost + (look.hairpin if after != START and is_hairpin(arrived, after) else 0)


@part
def _straighten_at(look, trails, count, i, cell, arrived):
    """Replace the stretch from step i of the best way on that gains the most, if any does; return (steps, gain)."""
    columns, walk, scratch = look.steps.shape[1], trails.walk[1], trails.walk[0]
    row, column = cell // columns, cell % columns
    rest, at, before, cost = rest_from(look, row, column), cell, arrived, 0
    gain, end = 0, 0
    slanted = gain > end  # False, but for Numba no constant (kernel.py)
    for j in range(i + 1, min(i + _RUNS, count) + 1):
        at, more = _move_cost(look, at, before, whole(walk[j - 1]))
        before = whole(walk[j - 1])
        cost += more
        if j < i + 2 or cost - gain <= rest - rest_from(look, at // columns, at % columns):
            continue  # no way between these two costs less than their costs-to-go differ
        after = whole(walk[j]) if j < count else START
        present = cost + (look.hairpin if after != START and is_hairpin(before, after) else 0)
        for first in range(2):
            other = _run(
                look, cell, at // columns - row, at % columns - column, first == 0, arrived, after,
                present - gain - 1, scratch,
            )  # fmt: skip
            if other < present - gain:
                gain, end, slanted = present - other, j, first == 0
    if gain == 0:
        return count, 0
    at = cell
    for k in range(i, end):
        at += MOVES[walk[k], 0] * columns + MOVES[walk[k], 1]
    d_row, d_column = at // columns - row, at % columns - column
    after = whole(walk[end]) if end < count else START
    _run(look, cell, d_row, d_column, slanted, arrived, after, ANY, scratch)
    fresh = max(abs(d_row), abs(d_column))
    for k in range(fresh):
        walk[i + k] = scratch[k]
    for k in range(end, count):
        walk[i + fresh + k - end] = walk[k]
    return count - (end - i) + fresh, gain


@part
def _straighten(look, trails, count):
    """Straighten the best way, trails.walk[1]; return (its steps, what that saves)."""
    columns = look.steps.shape[1]
    cell, arrived, i, saved = look.row * columns + look.column, START, whole(0), 0
    while i < count - 1:
        count, gain = _straighten_at(look, trails, count, i, cell, arrived)
        saved += gain
        arrived = whole(trails.walk[1, i])
        cell += MOVES[arrived, 0] * columns + MOVES[arrived, 1]
        i += 1
    return count, saved


@part
def colonise(look, most, seed, edges, levels, trails):
    """Let a colony look for a way; return (steps of the best, its cost), (-1, ANY) if it found none of at most `most`.

    The best way's moves: trails.walk[1]. seed: of the ants' chance; edges, levels: the trail of the look before.
    """
    trails.run[0] += 1
    trails.listed[0] = 0
    _remember(look, trails, edges, levels)
    start = look.row * look.steps.shape[1] + look.column
    least = _see(look, trails, start)
    best, cost, since, state = whole(-1), ANY, 0, np.uint64(seed)
    for iteration in range(ITERATIONS):
        since += 1
        for k in range(ANTS):
            ant = (trails.run[0] * ITERATIONS + iteration) * ANTS + k
            count, walked, state = _walk(look, min(most, cost - 1), trails, ant, state)
            if count < 0:
                if trails.rest[start] > min(most, cost - 1):
                    break  # nothing better is left
                continue
            best, since = count, 0
            for step in range(count):
                trails.walk[1, step] = trails.walk[0, step]
            cost = walked
        if best >= 0:
            if since == 0:
                best, saved = _straighten(look, trails, best)
                cost -= saved
            _mark(look, trails, 1, best, np.float32(STRENGTH * UNIT / (UNIT + cost - least)))
        if (best >= 0 and since >= PATIENCE) or trails.rest[start] > min(most, cost - 1):
            break
        _fade(trails)
    return best, cost


@kernel
def send_ants(look, cells, saving, runs_out, path, seed, edges, levels, trails):
    """Write the way that ants find to `path`, and return (of how many cells, edges of their trail that is kept).

    path: see ways.make_path; seed, edges, levels: see `colonise`; all else: ways.find_way.
    """
    best, most = -1, most_for(look, cells, saving)
    kept = 0
    if rest_from(look, look.row, look.column) <= most:
        best, _ = colonise(look, most, seed, edges, levels, trails)
        kept = _keep(trails)
    if best < 0:
        return (write_rest(look, cells, path) if runs_out else 0), kept
    path[0, 0], path[0, 1] = look.row, look.column
    for k in range(best):
        move = trails.walk[1, k]
        path[k + 1, 0], path[k + 1, 1] = path[k, 0] + MOVES[move, 0], path[k, 1] + MOVES[move, 1]
    return write_tail(look, best + 1, int(trails.walk[1, best - 1]) if best > 0 else START, path), kept


class Ants(Portable):
    """Finds ways by ants; remembers the trail of each robot's last look as long as it has the same goal."""

    bound = ("_trails", "_path")

    def __init__(self, shape: tuple[int, int]) -> None:
        self._shape = shape
        self._known: dict[tuple[int, int], tuple[Cell, NDArray[np.int32], NDArray[np.float32]]] = {}
        self._bind()

    def _bind(self) -> None:
        cells = self._shape[0] * self._shape[1]
        self._trails, self._path = make_trails(cells), make_path(cells)

    def begin(self, world: int) -> None:
        """Forget the trails of a world: its robots begin anew."""
        self._known = {who: known for who, known in self._known.items() if who[0] != world}

    def find(
        self, look: Look, cells: NDArray[np.int32], saving: int, runs_out: bool, goal: Cell, step: int
    ) -> NDArray[np.int32]:
        """Return the cells int32[L, 2] of a way, none if there is none; see `send_ants`.

        goal, step: of the robot and its world's clock, from which alone the ants' chance is drawn.
        """
        who = (look.world, look.me)
        aim, edges, levels = self._known.get(who, _NO_TRAIL)
        if aim != goal:
            _, edges, levels = _NO_TRAIL
        seed = _mixed(step, int(look.me), look.row, look.column, *goal)
        count, kept = send_ants(look, cells, saving, runs_out, self._path, seed, edges, levels, self._trails)
        if kept:
            self._known[who] = goal, self._trails.edges[:kept].copy(), self._trails.levels[:kept].copy()
        return self._path[:count].astype(np.int32)


def _mixed(*numbers: int) -> int:
    """Return a whole number from 1 to below 2^63 that looks like chance, from others (splitmix, Steele 2014)."""
    mixed = 0
    for number in numbers:
        mixed = (mixed + number + 0x9E3779B97F4A7C15) & _WORD
        mixed = ((mixed ^ (mixed >> 30)) * 0xBF58476D1CE4E5B9) & _WORD
        mixed = ((mixed ^ (mixed >> 27)) * 0x94D049BB133111EB) & _WORD
        mixed ^= mixed >> 31
    return (mixed >> 1) or 1
