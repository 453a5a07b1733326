"""The potential-field ant colony of paper 000, and what we add to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.maps.moves import beyond
from warehouse_env.planning import potential_field
from warehouse_env.planning.ants.colony import Colony
from warehouse_env.planning.ants.floor import Floor, Table
from warehouse_env.planning.ants.system import AntSystem
from warehouse_env.planning.ants.walks import Walks, deposit
from warehouse_env.planning.plan import MICRO


@dataclass(frozen=True)
class PfAco(AntSystem):
    """The potential-field ant colony of paper 000 (Wang & Xie), eqs. 8-26, and a local search of our own.

    p ~ pheromone * eta^2 with eta = a*L + b*H + c*T (eq. 8). The paper prints none of its constants; those here are
    ours. fr = 1 - iteration / iterations (eq. 9). Where the print is doubtful, it is read so:

    - L (eqs. 10-11) = fr * max(0, cos theta), theta between the move and the resultant force. Dividing by
      d_ij + d_jg as printed would make L some hundredths, drowned by H and T, and fr enters once though eqs. 10 and 11
      each multiply by it. Moves against the force get L = 0, not a negative chance. Where the force vanishes, the
      straight pull of the goal takes its place.
    - H (eqs. 12-14) = (h_max - |dh|) / (h_max - h_min + Q) * fr * M + N over the legal neighbours; Q only keeps the
      denominator from zero (the text swaps it with N_max). On a flat floor H is the constant N, which keeps every
      move possible: without it the ants are caught in front of shelves.
    - T (eq. 15) = rho*u*fr + sigma straight on, (1-rho)*u*fr / S at a turn, S the number of legal moves; ants have no
      heading at the start, so there all moves count as turns.
    - eq. 7 as printed is the distance from start to goal, the same for all moves; it cancels and is left out.
    - Initial pheromone (eq. 17): P, "the nodes between start and goal", is the rectangle they span. Its factor
      phi > 1 is another constant than eq. 18's phi < 1: `initial_boost` and `evaporation`.
    - Update (eqs. 18-25): all arrived ants; A*Q/L + B*Q/(100*max(H_k, smallest_spread)) + C*Q/max(1, turns). As
      printed eq. 21 divides by zero on even paths and eq. 22 on straight ones; on a flat floor the height term,
      equal for all, is left out. The length L is the walk's cost: with tolls, where the floor or a cost map takes them.

    "Best" is the least length + gentleness * metres climbed, then the fewest turns: the paper names length, gentleness
    and smoothness as its aims but no order of them. PfAco(local_search=False, patience=None) is the paper's own system;
    with local search the best paths of an iteration are straightened (local_search.py) before they count and deposit,
    and the search ends when 8 iterations have found none better.

    attraction="distance_field" replaces the straight pull by the descent of the true cost-to-go. It knows the answer
    beforehand: a hybrid of exact search and colony, for which 10 ants and 5 iterations suffice if the heuristic is
    sharp (b = 0.1, exponent = 4).
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
    attraction: Literal["straight", "distance_field"] = "straight"

    name: ClassVar[str] = "pf_aco"
    shares: ClassVar[tuple[str, ...]] = ("evaporation", "straight_share")

    def colony(self, grid: GridMap, floor: Floor, start: int) -> Colony:
        """Slots of eqs. 8-25: the force's pull, gentleness and smoothness in the heuristic, and in the deposit."""
        pull = self.a * self._pull(grid, divmod(floor.goal, floor.columns)).reshape(-1, 8)
        fading = pull + self.b * self.gentle_gain * gentle_share(floor, self.gentle_offset)
        return Colony(
            pheromone=initial_pheromone(floor, start, self.initial_boost),
            attraction=self._attraction(floor, fading),
            update=partial(self._update, floor),
        )

    def _pull(self, grid: GridMap, goal: Cell) -> NDArray[np.float64]:
        """float64[H, W, 8] max(0, cos theta) of eqs. 10-11, or in its place the descent of the distance field."""
        if self.attraction == "distance_field":
            return descent(grid, goal)
        force = potential_field.resultant(grid.occupied, goal, self.repulsion, self.repulsion_reach)
        return np.maximum(potential_field.alignment(force), 0.0)

    def _attraction(self, floor: Floor, fading: Table) -> Callable[[int], tuple[Table, Table]]:
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

    def _update(self, floor: Floor, iteration: int, pheromone: Table, walks: Walks, best: Walks) -> None:
        """Slot: eqs. 18-25 over all arrived ants."""
        amount = self.length_weight / walks.cost + self.turn_weight / np.maximum(walks.turns, 1)
        if not floor.flat:
            amount += self.height_weight / (100.0 * np.maximum(walks.spread, self.smallest_spread))
        pheromone *= 1.0 - self.evaporation
        deposit(floor, pheromone, walks, self.evaporation * self.strength * amount)


def descent(grid: GridMap, goal: Cell) -> NDArray[np.float64]:
    """Fall float64[H, W, 8] of the exact cost-to-go per cell of length of each move: 1 along a shortest path.

    0 where a move does not lead nearer, is not legal, or the goal cannot be reached. Not of the papers: it knows the
    answer beforehand.
    """
    here = grid.distance_to(goal)[..., None]
    usable = grid.legal_moves & np.isfinite(here)
    fall = np.zeros(usable.shape)
    np.subtract(here, beyond(grid.distance_to(goal), np.inf), out=fall, where=usable)
    return np.asarray(np.maximum(fall / np.hypot(*MOVES.T), 0.0))


def initial_pheromone(floor: Floor, start: int, boost: float) -> Table:
    """float64[C, 8]: `boost` on edges of cells in the rectangle between start and goal, 1 elsewhere (eq. 17)."""
    rows, columns = np.divmod(np.arange(len(floor.height)), floor.columns)
    (row, column), (goal_row, goal_column) = divmod(start, floor.columns), divmod(floor.goal, floor.columns)
    between = (rows >= min(row, goal_row)) & (rows <= max(row, goal_row))
    between &= (columns >= min(column, goal_column)) & (columns <= max(column, goal_column))
    return np.repeat(np.where(between, boost, 1.0)[:, None], 8, axis=1)


def gentle_share(floor: Floor, offset: float) -> Table:
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
