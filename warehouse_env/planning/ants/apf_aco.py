"""The potential-field ant colony of paper 001."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning.ants.aco import power
from warehouse_env.planning.ants.colony import Colony
from warehouse_env.planning.ants.floor import Floor, Table
from warehouse_env.planning.ants.system import AntSystem, goal_distance
from warehouse_env.planning.ants.walks import Walks, deposit
from warehouse_env.planning.potential_field import descent_length, improved_potential, repulsive_potential


@dataclass(frozen=True)
class ApfAco(AntSystem):
    """The fusion of improved potential field and ant colony of paper 001 (Han & He 2022), eqs. 9-17.

    p ~ pheromone * eta^beta with eta = 1 / (d_jg + R_jg) (eq. 16), d_jg the straight distance from the next cell to the
    goal, R_jg the length of the potential field's way from there. The paper prints ants, iterations, rho, Q and
    alpha = 1; the other constants are ours. Where the print is doubtful, it is read so:

    - R_jg: the steepest descent on the improved potential (eq. 9; eq. 5's lost square restored, n = 0.5 though it is
      called an integer). A way that ends in a local minimum, of which the paper says nothing, goes on straight to the
      goal at `stuck_penalty` times the distance.
    - eq. 16's factor (N_max - N_c) / N_max is the same for all moves and cancels in eq. 14; it is left out.
    - beta: not printed. 7 of ours; with a small one the heuristic hardly tells neighbours apart.
    - eq. 15: all arrived ants deposit rho * Q / L.
    - eq. 17 (wolf-pack rule): as printed, the change of the best and worst path is a number of metres beside Q / L; it
      drives pheromone below zero. So the difference of the two deposits stands in its place, Q * |1/L_b - 1/L_w|,
      times rho and M, the number of ants as good as the best (as bad as the worst); and pheromone keeps to a range,
      [`least_pheromone`, `most_pheromone`]. Best and worst are those of the iteration. `wolf_pack` weighs the rule;
      0 leaves eq. 15 alone.

    With a cost map or a floor that climbs, L is the cost.
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

    def colony(self, grid: GridMap, floor: Floor, start: int) -> Colony:
        """Slots: one heuristic for all iterations; all ants deposit, the best more, the worst takes away."""
        goal = (floor.goal // floor.columns, floor.goal % floor.columns)
        energy = repulsive_potential(grid.occupied, self.repulsion_gain, self.repulsion_reach)
        potential = improved_potential(energy, goal, self.attraction_gain, self.distance_exponent)
        way = descent_length(potential, grid.legal_moves, goal, self.stuck_penalty).reshape(-1)
        eta = power(1.0 / (goal_distance(floor) + way), self.exponent)[floor.neighbour]
        return Colony(np.ones_like(eta), lambda iteration: (eta, eta), partial(self._update, floor))

    def _update(self, floor: Floor, iteration: int, pheromone: Table, walks: Walks, best: Walks) -> None:
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
