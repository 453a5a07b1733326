"""The ant colony system, and its union with a shunting network: paper 003 and its baseline."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import ClassVar, Literal

import numpy as np

from warehouse_env.errors import ConfigError
from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning.ants.aco import power
from warehouse_env.planning.ants.colony import Colony
from warehouse_env.planning.ants.floor import AntFloor, Table
from warehouse_env.planning.ants.shunting import LEAST_DECAY, rise, settle
from warehouse_env.planning.ants.system import STEP, AntSystem, goal_distance
from warehouse_env.planning.ants.walks import Walks
from warehouse_env.planning.plan import MICRO

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
            np.full_like(eta, level),
            lambda iteration: (eta, eta),
            partial(self._update, floor),
            greedy=lambda iteration: self.greed,
            local_decay=self.local_decay,
            local_level=level,
        )

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

    So this is a reconstruction: x_j / x_i, by which activity rises along a move (shunting.py), times d_ij^-beta is
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
