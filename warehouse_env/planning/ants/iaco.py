"""The improved ant colony of paper 004, with its path smoothing."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import PlanError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning.ants.aco import power
from warehouse_env.planning.ants.colony import Colony
from warehouse_env.planning.ants.floor import AntFloor, Table
from warehouse_env.planning.ants.system import AntSystem, goal_distance
from warehouse_env.planning.ants.walks import Walks, deposit
from warehouse_env.planning.plan import Plan, validate_line
from warehouse_env.planning.smoothing import smooth

FIRST, LAST = 0.4, 0.6  # shares of the iterations between which eq. 14 is greedy


@dataclass(frozen=True)
class Iaco(AntSystem):
    """Gu, Duan, Su, Yuan, Path planning of warehouse logistics robot based on improved ant colony algorithm (2020).

    p ~ pheromone * (zeta / distance of the next cell to the goal)^7 (eqs. 5, 7); with probability q0 an ant takes the
    best edge (eq. 8), q0 by eq. 14; all arrived ants deposit Q / length (eq. 4) on trails that evaporate by a share
    that falls (eq. 9). The path of cells is then smoothed (eq. 13, smoothing.py) into the plan's line, whose length
    the paper's tables give. schedule="printed" is eq. 9 as printed (with evaporation=5), norms="printed" eq. 13 as
    printed. docs/planners.md tells how doubtful equations are read.
    """

    ants: int = 20  # m
    iterations: int = 20  # NC_max
    exponent: int = 7  # beta
    scale: float = 10.0  # zeta [cells]
    strength: float = 100.0  # Q [cells]
    evaporation: float = 0.5  # c, share of the first iteration
    decay: float = 3.0  # of schedule "scaled"
    schedule: Literal["scaled", "printed"] = "scaled"
    greed_first: float = 0.15  # q0 up to 0.4 of the iterations,
    greed_middle: float = 0.8  # between,
    greed_last: float = 0.1  # and from 0.6 on
    smoothing: bool = True
    deviation: float = 0.5  # lambda of eq. 13
    tension: float = 0.5  # mu of eq. 13
    norms: Literal["squared", "printed"] = "squared"  # of eq. 13
    clearance: float = 0.35  # [cells] of the line from shelves: half the robot's 0.6 m and a margin, on cells of 1 m

    name: ClassVar[str] = "iaco"
    shares: ClassVar[tuple[str, ...]] = ("greed_first", "greed_middle", "greed_last")

    def colony(self, grid: GridMap, floor: AntFloor, start: int) -> Colony:
        """Slots of eqs. 3-9 and 14."""
        eta = power(self.scale / goal_distance(floor)[floor.neighbour], self.exponent)
        return Colony(
            np.ones_like(eta), lambda iteration: (eta, eta), partial(self._update, floor), greedy=self.greedy_share
        )

    def greedy_share(self, iteration: int) -> float:
        """q0 of eq. 14; iterations count from 0, the paper's NC from 1."""
        number = iteration + 1
        if number <= FIRST * self.iterations:
            return self.greed_first
        return self.greed_middle if number < LAST * self.iterations else self.greed_last

    def evaporated(self, iteration: int) -> float:
        """Share of the pheromone that evaporates, eq. 9; iterations count from 0, the paper's from 1."""
        number = iteration + 1
        exponent = self.decay * (number / self.iterations) ** 2 if self.schedule == "scaled" else float(number**2)
        return min(self.evaporation * math.exp(-exponent), 1.0)

    def _update(self, floor: AntFloor, iteration: int, pheromone: Table, walks: Walks, best: Walks) -> None:
        """Eqs. 3 and 4; the deposit is Q / cost."""
        pheromone *= 1.0 - self.evaporated(iteration)
        deposit(floor, pheromone, walks, self.strength / walks.cost)

    def finish(self, grid: GridMap, plan: Plan) -> Plan:
        """Add the smoothed line (eq. 13), unless it cuts into a one-way cell against its direction."""
        if not (self.smoothing and plan.found):
            return plan
        line = smooth(
            plan.cells, grid.occupied,
            deviation=self.deviation, length=self.tension, clearance=self.clearance,
            power=2 if self.norms == "squared" else 1,
        )  # fmt: skip
        kept = line if not grid.one_way.any() or _is_valid(grid, line, plan.cells) else None
        return plan._replace(line=kept)


def _is_valid(grid: GridMap, line: NDArray[np.float64], cells: NDArray[np.int64]) -> bool:
    """Whether a line along a path int64[L, 2] keeps off shelves and to the directions of one-way cells."""
    first, last = (int(cells[0, 0]), int(cells[0, 1])), (int(cells[-1, 0]), int(cells[-1, 1]))
    try:
        validate_line(grid, line, first, last)
    except PlanError:
        return False
    return True
