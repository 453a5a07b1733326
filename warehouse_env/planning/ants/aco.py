"""The traditional ant colony, the baseline of the papers."""

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
