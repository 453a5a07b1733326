"""The potential-field ant colony of paper 000, and what we add to it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning import potential_field
from warehouse_env.planning.ants.aco import AntSystem
from warehouse_env.planning.ants.colony import Colony
from warehouse_env.planning.ants.walks import AntFloor, Table, Walks, deposit
from warehouse_env.planning.plan import MICRO


@dataclass(frozen=True)
class PfAco(AntSystem):
    """The potential-field ant colony of paper 000 (Wang & Xie), eqs. 8-26, and a local search of our own.

    p ~ pheromone * eta^2 with eta = a*L + b*H + c*T (eq. 8): L the pull of the potential field, H gentleness, T
    smoothness; fr = 1 - iteration / iterations (eq. 9) scales all three. All arrived ants deposit. The best path has
    the least length + gentleness * metres climbed, then the fewest turns. The paper prints no constants: these are
    ours. docs/planners.md tells how doubtful equations are read.

    local_search: the best paths of an iteration are straightened (local_search.py) before they count and deposit, and
    the search ends after 8 iterations without a better path. PfAco(local_search=False, patience=None) is the paper's
    own system.
    """

    local_search: bool = True
    elite: int = 10
    gentleness: float = 10.0
    patience: int | None = 8
    a: float = 1.0  # weight of the potential field
    b: float = 1.0  # weight of gentleness
    c: float = 0.3  # weight of smoothness; from 1 on paths get longer
    exponent: int = 2  # of eta
    repulsion: float = 0.02  # against a unit attraction
    repulsion_reach: float = 1.5  # [cells]: the 8 neighbours
    gentle_gain: float = 1.0  # M, eq. 12
    gentle_base: float = 1.0  # N, eq. 12
    gentle_offset: float = 0.001  # [m] Q, eq. 12
    straight_share: float = 0.5  # rho, eq. 15
    flexibility: float = 1.0  # u, eq. 15
    straight_base: float = 0.2  # sigma, eq. 15
    initial_boost: float = 1.5  # phi * D, eq. 17
    evaporation: float = 0.2  # phi, eq. 18
    strength: float = 3.0  # Q, eqs. 20-22
    length_weight: float = 1.0  # A, eq. 20
    height_weight: float = 0.05  # B, eq. 21 [m]
    turn_weight: float = 0.2  # C, eq. 22
    smallest_spread: float = 0.01  # [m] H_k below this counts as this, eq. 21

    name: ClassVar[str] = "pf_aco"
    shares: ClassVar[tuple[str, ...]] = ("evaporation", "straight_share")

    def colony(self, grid: GridMap, floor: AntFloor, start: int) -> Colony:
        """Slots of eqs. 8-25: the force's pull, gentleness and smoothness in the heuristic, and in the deposit."""
        goal = divmod(floor.goal, floor.columns)
        force = potential_field.resultant(grid.occupied, goal, self.repulsion, self.repulsion_reach)
        pull = self.a * np.maximum(potential_field.alignment(force), 0.0).reshape(-1, 8)
        fading = pull + self.b * self.gentle_gain * gentle_share(floor, self.gentle_offset)
        return Colony(
            pheromone=initial_pheromone(floor, start, self.initial_boost),
            attraction=self._attraction(floor, fading),
            update=self._update,
        )

    def _attraction(self, floor: AntFloor, fading: Table) -> Callable[[int], tuple[Table, Table]]:
        """Slot: eta^exponent of eq. 8 for an iteration; `fading` holds what fr scales."""
        fading = np.ascontiguousarray(fading)
        turning, straight = np.empty_like(fading), np.empty_like(fading)
        degree = np.maximum(floor.legal.sum(axis=1), 1).astype(np.float64)  # S(a_i)
        turn_gain = self.c * (1.0 - self.straight_share) * self.flexibility / degree
        straight_gain = self.c * self.straight_share * self.flexibility

        def tables(iteration: int) -> tuple[Table, Table]:
            fr = 1.0 - iteration / self.iterations
            at_turn = self.b * self.gentle_base + fr * turn_gain
            ahead = self.b * self.gentle_base + fr * straight_gain + self.c * self.straight_base
            _mix(fading, fr, at_turn, ahead, self.exponent, turning, straight)
            return turning, straight

        return tables

    def _update(self, floor: AntFloor, iteration: int, pheromone: Table, walks: Walks, best: Walks) -> None:
        """Slot: eqs. 18-25 over all arrived ants."""
        amount = self.length_weight / walks.cost + self.turn_weight / np.maximum(walks.turns, 1)
        if not floor.flat:
            amount += self.height_weight / (100.0 * np.maximum(walks.spread, self.smallest_spread))
        pheromone *= 1.0 - self.evaporation
        deposit(floor, pheromone, walks, self.evaporation * self.strength * amount)


def initial_pheromone(floor: AntFloor, start: int, boost: float) -> Table:
    """float64[C, 8]: `boost` on edges of cells in the rectangle between start and goal, 1 elsewhere (eq. 17)."""
    rows, columns = np.divmod(np.arange(len(floor.height)), floor.columns)
    (row, column), (goal_row, goal_column) = divmod(start, floor.columns), divmod(floor.goal, floor.columns)
    between = (rows >= min(row, goal_row)) & (rows <= max(row, goal_row))
    between &= (columns >= min(column, goal_column)) & (columns <= max(column, goal_column))
    return np.repeat(np.where(between, boost, 1.0)[:, None], 8, axis=1)


def gentle_share(floor: AntFloor, offset: float) -> Table:
    """The fraction of eq. 12 float64[C, 8]: (h_max - |dh|) / (h_max - h_min + offset), heights in metres.

    h_max and h_min (eqs. 13-14) are taken over the legal moves of each cell; 0 where a move is not legal.
    """
    if floor.flat:
        return np.zeros(floor.neighbour.shape)
    difference = np.abs(floor.height[floor.neighbour] - floor.height[:, None]) / MICRO
    highest = np.where(floor.legal, difference, 0.0).max(axis=1, keepdims=True)
    lowest = np.minimum(np.where(floor.legal, difference, np.inf).min(axis=1, keepdims=True), highest)
    return np.where(floor.legal, (highest - difference) / (highest - lowest + offset), 0.0)


@kernel
def _mix(fading, fr, at_turn, ahead, exponent, turning, straight):
    """Write (fr * fading + at_turn[cell])^exponent to turning and (fr * fading + ahead)^exponent to straight."""
    for cell in range(fading.shape[0]):
        for move in range(8):
            turn, go = fr * fading[cell, move] + at_turn[cell], fr * fading[cell, move] + ahead
            turn_power, go_power = turn, go
            for _ in range(exponent - 1):
                turn_power *= turn
                go_power *= go
            turning[cell, move], straight[cell, move] = turn_power, go_power
