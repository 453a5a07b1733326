"""The ant colony system, and its union with a shunting network (SHAA): paper 003 and its baseline.

The shunting neural network is activity that spreads from the goal over the free cells. A cell is a neuron. Its steady
state is x = S / (A + S) (Grossberg 1988; for robots Yang & Meng 2000), excited by S = I + sum of w_ij * x_j over the
cells j that a move leads to, with I = E at the goal and 0 elsewhere; shelves stay at 0. With `strongest`, the largest
w_ij * x_j alone excites, not the sum. Activity falls to between a third and a tenth from cell to cell, so plain floats
would end some 300 to 650 cells from the goal: a state is a mantissa with a whole exponent of its own.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError
from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import MOVES, GridMap
from warehouse_env.planning.ants.aco import STEP, AntSystem, goal_distance, power
from warehouse_env.planning.ants.colony import Colony
from warehouse_env.planning.ants.walks import AntFloor, Table, Walks
from warehouse_env.planning.plan import MICRO

LEAST_DECAY = 4.0 + 4.0 / math.sqrt(2.0)  # the sum of the weights 1/d of 8 moves; up to it activity saturates
_TOLERANCE = 1e-3  # share by which no state changes any more in a sweep
_SWEEPS = 1_000
_NO_ACTIVITY = -(2**40)  # an exponent below all others
_FAR = 1_000  # binary places between two numbers beyond which the smaller does not count
_HALVED = 2.0 ** -np.arange(_FAR)  # exact


class Activity(NamedTuple):
    """x = mantissa * 2^exponent of each cell."""

    mantissa: NDArray[np.float64]  # [C], from 0.5 to below 1; 0 where no activity arrives
    exponent: NDArray[np.int64]  # [C]


@kernel
def settle(floor, weight, decay, source, strongest):
    """Return the steady state for A = `decay`, E = `source` and w_ij = `weight` float64[C, 8] of the move from i to j.

    A must exceed the sum of each cell's weights. Sweeps over the cells in the order of their moves from the goal, in
    which activity spreads, each cell from the newest states of its neighbours (Gauss-Seidel), until all is settled.
    """
    cells = floor.neighbour.shape[0]
    state = Activity(np.zeros(cells), np.full(cells, _NO_ACTIVITY, np.int64))
    order = _flood(floor)
    for _ in range(_SWEEPS):
        change = 0.0
        for k in range(len(order)):
            change = max(change, _renew(floor, weight, decay, source, strongest, state, order[k]))
        if change <= _TOLERANCE:
            break
    return state


@kernel
def _renew(floor, weight, decay, source, strongest, state, cell):
    """Set a cell to S / (A + S) and return by what share it changed."""
    mantissa, exponent = state
    at_goal = cell == floor.goal
    top = 0 if at_goal else _NO_ACTIVITY
    for move in range(8):
        to = floor.neighbour[cell, move]
        if to != cell and exponent[to] > top:
            top = exponent[to]
    excited = source if at_goal else 0.0  # S / 2^top
    for move in range(8):
        to = floor.neighbour[cell, move]
        if to != cell and exponent[to] > top - _FAR:
            arriving = weight[cell, move] * mantissa[to] * _HALVED[top - exponent[to]]
            excited = max(excited, arriving) if strongest else excited + arriving
    saturation = math.ldexp(excited, int(top)) if top > -_FAR else 0.0
    new = excited / (decay + saturation)
    fraction, shift = math.frexp(new)
    change = 1.0
    if exponent[cell] != _NO_ACTIVITY and abs(exponent[cell] - top - shift) <= 1:
        change = abs(math.ldexp(mantissa[cell], int(exponent[cell] - top)) / new - 1.0)
    mantissa[cell], exponent[cell] = fraction, top + shift
    return change


@kernel
def _flood(floor):
    """Cells int64[R] from which moves lead to the goal, in the order of their number."""
    rows, columns = floor.neighbour.shape[0] // floor.columns, floor.columns
    cells = floor.neighbour.shape[0]
    order, known = np.empty(cells, np.int64), np.zeros(cells, np.bool_)
    order[0], size, at = floor.goal, 1, 0
    known[floor.goal] = True
    while at < size:
        for move in range(8):
            row, column = order[at] // columns + MOVES[move, 0], order[at] % columns + MOVES[move, 1]
            to = row * columns + column
            inside = 0 <= row < rows and 0 <= column < columns
            if inside and floor.legal[to, (move + 4) % 8] and not known[to]:
                known[to] = True
                order[size] = to
                size += 1
        at += 1
    return order[:size]


def rise(floor: AntFloor, activity: Activity) -> Table:
    """Return float64[C, 8], x_j / x_i of the move from i to j; 1 on cells that no activity reaches."""
    mantissa, exponent = activity
    silent = mantissa == 0.0
    fraction = mantissa[floor.neighbour] / np.where(silent, 1.0, mantissa)[:, None]
    shift = np.where(silent[:, None], 0, exponent[floor.neighbour] - exponent[:, None])
    return np.where(silent[:, None], 1.0, np.ldexp(fraction, shift.clip(-_FAR, _FAR).astype(np.int32)))


_LEAST_WEIGHT = 1e-300  # so that no toll, however high, cuts the network in two


@dataclass(frozen=True)
class Acs(AntSystem):
    """The ant colony system (Dorigo & Gambardella 1997), the baseline of paper 003.

    With probability q0 an ant takes the best edge by pheromone * (1/d)^beta, otherwise it draws. Each step moves its
    edge towards tau0 by a share. After an iteration the edges of the best path so far, and no others, move towards
    1 / cost by a share. heuristic: d is the distance to the goal, or to the next cell, which knows nothing of the goal.

    tau0 = 1 / (n * (d_sg + 1)), n the free cells and d_sg the straight distance from start to goal. Without n a mark
    of 1 / cost would lie below the level to which it evaporates, and the best path would repel ants.
    """

    ants: int = 30
    heuristic: Literal["goal", "next_cell"] = "goal"
    exponent: int = 2  # beta
    greed: float = 0.8  # q0
    local_decay: float = 0.1  # share a step
    evaporation: float = 0.1  # share an iteration

    name: ClassVar[str] = "acs"
    shares: ClassVar[tuple[str, ...]] = ("greed", "local_decay", "evaporation")

    def colony(self, grid: GridMap, floor: AntFloor, start: int) -> Colony:
        """Slots: one heuristic and one q0 for all iterations, a local update, marks on the best path only."""
        eta = self.heuristic_table(floor)
        free = int(floor.legal.any(axis=1).sum())
        level = 1.0 / (max(free, 1) * (float(goal_distance(floor)[start]) + 1.0))
        return Colony(
            np.full_like(eta, level), lambda iteration: (eta, eta), self._update,
            greedy=lambda iteration: self.greed, local_decay=self.local_decay, local_level=level,
        )  # fmt: skip

    def heuristic_table(self, floor: AntFloor) -> Table:
        """(1/d)^beta float64[C, 8] of every edge."""
        distance = STEP if self.heuristic == "next_cell" else goal_distance(floor)[floor.neighbour]
        return power(np.broadcast_to(1.0 / distance, floor.neighbour.shape), self.exponent)

    def evaporates(self, iteration: int) -> float:
        """Share by which the edges of the best path move in an iteration."""
        return self.evaporation

    def _update(self, floor: AntFloor, iteration: int, pheromone: Table, walks: Walks, best: Walks) -> None:
        draw_towards_best(floor, pheromone, best, self.evaporates(iteration))


@dataclass(frozen=True)
class ShaaAcs(Acs):
    """The adaptive ant colony system with a shunting network of paper 003; its equations are lost in the text.

    So this is a reconstruction: x_j / x_i, by which activity rises along a move, times d_ij^-beta is
    the heuristic (eqs. 13-14). The share of the global update rises from first to last iteration (eqs. 6-7). All
    constants are ours; A must exceed 4 + 4/sqrt 2. Tolls of a cost map count as length.

    The paper's own system is weights="inverse", excitation="sum", local_search=False. It misses the optimum in half of
    the runs on large cluttered maps: with w_ij = 1/d_ij a diagonal move costs as much activity as 1.15 straight ones,
    and activities that arrive on different ways add up. So here w_ij = A^(1 - length), and only the strongest
    neighbour excites. Then log x is nearly the true distance to the goal: a hybrid that knows the answer beforehand.
    """

    local_search: bool = True
    heuristic: Literal["goal", "next_cell"] = "next_cell"
    weights: Literal["length", "inverse"] = "length"
    excitation: Literal["strongest", "sum"] = "strongest"
    decay: float = 10.0  # A
    source: float = 100.0  # E
    evaporation_last: float = 0.4

    name: ClassVar[str] = "shaa_acs"
    shares: ClassVar[tuple[str, ...]] = (*Acs.shares, "evaporation_last")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.decay > LEAST_DECAY:
            raise ConfigError(f"shaa_acs parameter decay={self.decay} must be more than {LEAST_DECAY:.3f}")

    def heuristic_table(self, floor: AntFloor) -> Table:
        """d_ij^-beta * x_j / x_i float64[C, 8] of every edge."""
        activity = settle(floor, self.network_weights(floor), self.decay, self.source, self.excitation == "strongest")
        return super().heuristic_table(floor) * rise(floor, activity)

    def network_weights(self, floor: AntFloor) -> Table:
        """w_ij float64[C, 8] of every edge."""
        length = STEP + floor.toll / MICRO
        return 1.0 / length if self.weights == "inverse" else np.maximum(self.decay ** (1.0 - length), _LEAST_WEIGHT)

    def evaporates(self, iteration: int) -> float:
        """Share by which the edges of the best path move in an iteration, linear from first to last."""
        along = iteration / max(1, self.iterations - 1)
        return self.evaporation + (self.evaporation_last - self.evaporation) * along


@kernel
def draw_towards_best(floor, pheromone, best, share):
    """Move the edges of each best path towards 1 / cost by a share, in place."""
    for row in range(len(best.steps)):
        cell = best.start[row]
        for step in range(best.steps[row]):
            move = best.moves[row, step]
            pheromone[cell, move] += share * (1.0 / best.cost[row] - pheromone[cell, move])
            cell = floor.neighbour[cell, move]
