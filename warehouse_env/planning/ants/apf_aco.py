"""The potential-field ant colony of paper 001."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning.ants.aco import power
from warehouse_env.planning.ants.colony import Colony
from warehouse_env.planning.ants.floor import AntFloor, Table
from warehouse_env.planning.ants.system import AntSystem, goal_distance
from warehouse_env.planning.ants.walks import Walks, deposit
from warehouse_env.planning.potential_field import descent_length, improved_potential, repulsion


@dataclass(frozen=True)
class ApfAco(AntSystem):
    """The fusion of improved potential field and ant colony of paper 001 (Han & He 2022), eqs. 9-17.

    p ~ pheromone * eta^beta with eta = 1 / (d_jg + R_jg) (eq. 16): d_jg the straight distance from the next cell to
    the goal, R_jg the length of the steepest descent from there on the improved potential. All arrived ants deposit
    rho * Q / L (eq. 15); the best path of an iteration gets more and the worst less (eq. 17, weighed by `wolf_pack`).
    The paper prints ants, iterations, rho, Q and alpha = 1; the other constants are ours. docs/planners.md tells how
    doubtful equations are read. With a cost map or a floor that climbs, L is the cost.
    """

    exponent: int = 7  # beta, of eta
    attraction_gain: float = 1.0  # k_att, eq. 4
    repulsion_gain: float = 1.0  # k_rep, eq. 9
    repulsion_reach: float = 2.0  # rho_0 [cells]
    distance_exponent: float = 0.5  # n, eq. 9
    stuck_penalty: float = 4.0
    evaporation: float = 0.4  # rho
    strength: float = 10.0  # Q
    wolf_pack: float = 1.0  # weight of eq. 17's two terms
    least_pheromone: float = 0.001
    most_pheromone: float = 20.0

    name: ClassVar[str] = "apf_aco"
    shares: ClassVar[tuple[str, ...]] = ("evaporation",)

    def colony(self, grid: GridMap, floor: AntFloor, start: int) -> Colony:
        """Slots: one heuristic for all iterations; all ants deposit, the best more, the worst takes away."""
        goal = (floor.goal // floor.columns, floor.goal % floor.columns)
        _, energy = repulsion(grid.occupied, self.repulsion_gain, self.repulsion_reach)
        potential = improved_potential(energy, goal, self.attraction_gain, self.distance_exponent)
        way = descent_length(potential, grid.legal_moves, goal, self.stuck_penalty).reshape(-1)
        eta = power(1.0 / (goal_distance(floor) + way), self.exponent)[floor.neighbour]
        return Colony(np.ones_like(eta), lambda iteration: (eta, eta), partial(self._update, floor))

    def _update(self, floor: AntFloor, iteration: int, pheromone: Table, walks: Walks, best: Walks) -> None:
        """Slot: eqs. 15 and 17."""
        amount = self.evaporation * self.strength / walks.cost
        arrived = np.flatnonzero(walks.steps >= 0)
        if len(arrived):
            cost = walks.cost[arrived]
            shift = self.wolf_pack * self.evaporation * self.strength * (1.0 / cost.min() - 1.0 / cost.max())
            amount[arrived[cost.argmin()]] += (cost == cost.min()).sum() * shift
            amount[arrived[cost.argmax()]] -= (cost == cost.max()).sum() * shift
        pheromone *= 1.0 - self.evaporation
        deposit(floor, pheromone, walks, amount)
        np.clip(pheromone, self.least_pheromone, self.most_pheromone, out=pheromone)
