"""The artificial potential field as a planner of its own: a walker that always follows the force, and its repairs.

It sees only the shelves near it, so it is fast and can fail; a walk that fails gives an empty Plan.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning.base import BasePlanner
from warehouse_env.planning.plan import CostMap, Plan
from warehouse_env.planning.potential_field import force_at, intermediate_point, repulsion

_EQUAL = 1e-9  # [cosine] closer alignments count as equal, so that rounding does not choose the move
_HALF = float(np.sqrt(0.5))


@dataclass(frozen=True)
class Apf(BasePlanner):
    """The classical artificial potential field (Khatib 1986), what papers 001 and 002 set out to improve.

    Attraction k * d to the goal, repulsion k_rep * (1/d - 1/rho0) / d^2 from every shelf cell nearer than rho0. The
    walker makes the legal move with the smallest angle to the resultant. It is stuck, and the Plan is empty, where the
    force vanishes, where all legal moves lead more sideways or back than along it, and where it comes to a cell a
    second time. Neither paper prints a gain.
    """

    attraction_gain: float = 1.0  # k [1/cell]
    repulsion_gain: float = 1.0  # k_rep
    repulsion_reach: float = 2.0  # rho0 of 001, d0 of 002 [cells]

    name: ClassVar[str] = "apf"

    def find(self, grid: GridMap, start: Cell, goal: Cell, rng: np.random.Generator, cost: CostMap) -> Plan:
        """Walk; `rng` is not used."""
        return self._walk(grid, start, goal, exponent=0.0, points=0)

    def _walk(self, grid: GridMap, start: Cell, goal: Cell, exponent: float, points: int) -> Plan:
        """Walk to the goal; where stuck, walk to an intermediate point first, `points` times at most."""
        parts = repulsion(grid.occupied, self.repulsion_gain, self.repulsion_reach)
        tried = np.zeros(grid.shape, np.bool_)
        way, target = [np.array([start], dtype=np.int64)], goal
        while True:
            here = (int(way[-1][-1, 0]), int(way[-1][-1, 1]))
            leg, arrived = follow(grid.legal_moves, *parts, here, target, goal, self.attraction_gain, exponent)
            way.append(leg)
            here = (int(leg[-1, 0]), int(leg[-1, 1]))
            if here == goal:
                return Plan(np.concatenate([leg[1:] if i else leg for i, leg in enumerate(way)]))
            target = goal
            if not arrived:
                points -= 1
                target = intermediate_point(grid.closed, here, goal, tried) if points >= 0 else (-1, -1)
                if target[0] < 0:
                    return Plan(np.empty((0, 2), np.int64))
                tried[target] = True


@dataclass(frozen=True)
class ApfImproved(Apf):
    """The potential field with the repairs of papers 001 (eqs. 9-13) and 002 (eqs. 16-20 and the intermediate point).

    exponent: the repulsive potential is multiplied by d^n, d the distance to the goal, so that the goal is the lowest
    cell of the field and can be reached between shelves; the force is the exact negative gradient. 0 leaves it out.

    intermediate_point: a walker that is stuck heads for the point P of 002 (`potential_field.intermediate_point`), by
    the same force, and then for the goal again; stuck once more it takes the next point, `points` at the most. The
    Plan is the way as it was walked, detours and loops included.
    """

    exponent: float = 0.5  # n
    intermediate_point: bool = True
    points: int = 20  # intermediate points on one walk

    name: ClassVar[str] = "apf_improved"

    def find(self, grid: GridMap, start: Cell, goal: Cell, rng: np.random.Generator, cost: CostMap) -> Plan:
        """Walk; `rng` is not used."""
        return self._walk(grid, start, goal, self.exponent, self.points if self.intermediate_point else 0)


@kernel
def follow(legal, push, energy, start, target, goal, gain, exponent):
    """Walk along the force to the target: (cells int64[L, 2] with the start, whether it arrived).

    Ends at the target or where it happens upon the goal, or on the last cell before it would be stuck or come to a
    cell again.
    """
    rows, cols = energy.shape
    cells = np.empty((rows * cols, 2), np.int64)
    seen = np.zeros((rows, cols), np.bool_)
    row, col = start
    for count in range(rows * cols):
        cells[count, 0], cells[count, 1] = row, col
        if (row == target[0] and col == target[1]) or (row == goal[0] and col == goal[1]):
            return cells[: count + 1], True
        seen[row, col] = True
        pull = (float(target[0] - row), float(target[1] - col))
        force = force_at(pull[0], pull[1], push[row, col, 0], push[row, col, 1], energy[row, col], gain, exponent)
        move = along(legal[row, col], force[0], force[1])
        if move >= 0:
            row, col = row + MOVES[move, 0], col + MOVES[move, 1]
        if seen[row, col]:
            break
    return cells[: count + 1], False


@kernel
def along(legal, force_row, force_col):
    """The legal move (bool[8]) with the smallest angle to a force, under 90 degrees; -1 where there is none."""
    size = np.sqrt(force_row * force_row + force_col * force_col)
    best, largest = -1, _EQUAL
    for move in range(8):
        along = (force_row * MOVES[move, 0] + force_col * MOVES[move, 1]) * (_HALF if move % 2 else 1.0)
        if legal[move] and along > largest * size + _EQUAL * size:
            best, largest = move, along / size
    return best
