"""The traditional ant colony, the baseline of the papers, and the potential-field ant colony of paper 001."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import ClassVar, Literal

import numpy as np

from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning.ants.colony import Colony
from warehouse_env.planning.ants.floor import AntFloor, Table
from warehouse_env.planning.ants.system import STEP, AntSystem, goal_distance
from warehouse_env.planning.ants.walks import Walks, deposit
from warehouse_env.planning.potential_field import descent_length, improved_potential, repulsion


@dataclass(frozen=True)
class Aco(AntSystem):
    """The traditional ant colony (Dorigo, Birattari & Stuetzle 2006), the baseline of papers 000, 001 and 004.

    p ~ pheromone * (1/d)^2; all arrived ants deposit Q / cost; evaporation 0.1; pheromone starts at 1.
    What the papers call traditional differs in d, so it is a choice: heuristic="goal" takes the distance from the next
    cell to the goal (the stronger baseline), "next_cell" that to the next cell, 1 or sqrt 2, which knows nothing of the
    goal (the text around eq. 8 of paper 000 describes this one). Local search is no part of the traditional system; it
    is there to see what it alone does.
    """

    heuristic: Literal["goal", "next_cell"] = "goal"
    exponent: int = 2  # of the heuristic
    evaporation: float = 0.1  # share an iteration
    strength: float = 1.0  # Q

    name: ClassVar[str] = "aco"
    shares: ClassVar[tuple[str, ...]] = ("evaporation",)

    def colony(self, grid: GridMap, floor: AntFloor, start: int) -> Colony:
        """Slots of eqs. 1-3 (paper 000): one heuristic for all iterations, all arrived ants deposit."""
        distance = STEP if self.heuristic == "next_cell" else goal_distance(floor)[floor.neighbour]
        eta = power(np.broadcast_to(1.0 / distance, floor.neighbour.shape), self.exponent)
        return Colony(np.ones_like(eta), lambda iteration: (eta, eta), partial(self._update, floor))

    def _update(self, floor: AntFloor, iteration: int, pheromone: Table, walks: Walks, best: Walks) -> None:
        """Every trail evaporates, every arrived ant adds Q / cost to its edges."""
        pheromone *= 1.0 - self.evaporation
        deposit(floor, pheromone, walks, self.strength / walks.cost)


def power(base: Table, exponent: int) -> Table:
    """base^exponent by multiplication, the same to the bit in compiled and in plain Python."""
    result = base.copy()
    for _ in range(exponent - 1):
        result *= base
    return result


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
