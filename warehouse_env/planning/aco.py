"""The papers' ant systems: each a short assembly of the colony's slots, with its source and its constants."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning import potential_field
from warehouse_env.planning.colony import Colony, cells_of, run
from warehouse_env.planning.floor import MICROMETRES, Floor, Table, make_floor
from warehouse_env.planning.local_search import shorten, straight_runs
from warehouse_env.planning.plan import Plan, check_endpoints, check_parameters, planner_key
from warehouse_env.planning.walks import Walks, deposit

_AT_GOAL = 0.1  # [cells] stands for the distance 0 of the goal cell to itself


@dataclass(frozen=True)
class Aco:
    """The traditional ant colony (Dorigo, Birattari & Stuetzle 2006), the baseline of papers 000, 001 and 004.

    p ~ pheromone * (1/d)^2; all arrived ants deposit Q / length; evaporation 0.1; pheromone starts at 1.
    What the papers call traditional differs in d, so it is a choice: heuristic="goal" takes the distance from the next
    cell to the goal (the stronger baseline), "next_cell" that to the next cell, 1 or sqrt 2, which knows nothing of the
    goal (the text around eq. 8 of paper 000 describes this one). An ant at a dead end steps back
    (dead_end="backtrack"), or dies as in the papers ("die"), which can leave a run without any path.
    """

    ants: int = 50
    iterations: int = 100
    heuristic: Literal["goal", "next_cell"] = "goal"
    exponent: int = 2  # of the heuristic
    evaporation: float = 0.1  # share an iteration
    strength: float = 1.0  # Q
    dead_end: Literal["backtrack", "die"] = "backtrack"
    local_search: bool = False  # no part of the traditional system; to see what it alone does

    name: ClassVar[str] = "aco"

    def __post_init__(self) -> None:
        check_parameters(self, shares=("evaporation",))

    @property
    def key(self) -> str:
        """Name and parameters."""
        return planner_key(self)

    def plan(self, grid: GridMap, start: Cell, goal: Cell, rng: np.random.Generator) -> Plan:
        """Search; the same state of `rng` gives the same plan, to the bit."""
        begin = time.perf_counter()
        start, goal = check_endpoints(grid, start, goal)
        floor = make_floor(grid, start, goal)
        eta = _power(self._distance_heuristic(floor), self.exponent)
        colony = Colony(
            ants=self.ants,
            iterations=self.iterations,
            pheromone=np.ones_like(eta),
            attraction=lambda iteration: (eta, eta),
            update=partial(self._update, floor),
            improve=partial(shorten, floor, straight_runs(floor), 0.0) if self.local_search else None,
            backtrack=self.dead_end == "backtrack",
        )
        search = run(floor, colony, rng)
        return Plan(cells_of(floor, search), search.best_by_iteration, time.perf_counter() - begin)

    def _distance_heuristic(self, floor: Floor) -> Table:
        """1/d float64[C, 8] of every edge (eq. 7, paper 000, read as 1/d_ij or 1/d_jg)."""
        if self.heuristic == "next_cell":
            distance = np.sqrt((MOVES**2).sum(axis=1)) + np.zeros((len(floor.height), 1))
        else:
            goal_row, goal_column = divmod(floor.goal, floor.columns)
            d_row, d_column = floor.neighbour // floor.columns - goal_row, floor.neighbour % floor.columns - goal_column
            distance = np.maximum(np.sqrt((d_row**2 + d_column**2).astype(np.float64)), _AT_GOAL)
        heuristic: Table = 1.0 / distance
        return heuristic

    def _update(self, floor: Floor, iteration: int, pheromone: Table, walks: Walks) -> None:
        """Every trail evaporates, every arrived ant adds Q / length to its edges."""
        pheromone *= 1.0 - self.evaporation
        deposit(floor, pheromone, walks, self.strength / walks.length)


@dataclass(frozen=True)
class PfAco:
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
      equal for all, is left out.

    "Best" is the least length + gentleness * metres climbed, then the fewest turns: the paper names length, gentleness
    and smoothness as its aims but no order of them. local_search=False is the paper's own system; with it the
    iteration's best path is straightened (local_search.py) before it counts and deposits.
    """

    ants: int = 50
    iterations: int = 100
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
    strength: float = 10.0  # Q, eqs. 20-22
    length_weight: float = 1.0  # A, eq. 20
    height_weight: float = 0.05  # B, eq. 21 [m]
    turn_weight: float = 0.2  # C, eq. 22
    smallest_spread: float = 0.01  # [m] H_k below this counts as this, eq. 21
    gentleness: float = 10.0  # [cells/m] detour that a metre of climbing is worth
    dead_end: Literal["backtrack", "die"] = "backtrack"
    local_search: bool = True

    name: ClassVar[str] = "pf_aco"

    def __post_init__(self) -> None:
        check_parameters(self, shares=("evaporation", "straight_share"))

    @property
    def key(self) -> str:
        """Name and parameters."""
        return planner_key(self)

    def plan(self, grid: GridMap, start: Cell, goal: Cell, rng: np.random.Generator) -> Plan:
        """Search; the same state of `rng` gives the same plan, to the bit."""
        begin = time.perf_counter()
        start, goal = check_endpoints(grid, start, goal)
        floor = make_floor(grid, start, goal)
        force = potential_field.resultant(grid.occupied, goal, self.repulsion, self.repulsion_reach)
        pull = self.a * np.maximum(potential_field.alignment(force).reshape(-1, 8), 0.0)
        fading = pull + self.b * self.gentle_gain * gentle_share(floor, self.gentle_offset)
        colony = Colony(
            ants=self.ants,
            iterations=self.iterations,
            pheromone=initial_pheromone(floor, self.initial_boost),
            attraction=self._attraction(floor, fading),
            update=partial(self._update, floor),
            improve=partial(shorten, floor, straight_runs(floor), self.gentleness) if self.local_search else None,
            backtrack=self.dead_end == "backtrack",
            gentleness=self.gentleness,
        )
        search = run(floor, colony, rng)
        return Plan(cells_of(floor, search), search.best_by_iteration, time.perf_counter() - begin)

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

    def _update(self, floor: Floor, iteration: int, pheromone: Table, walks: Walks) -> None:
        """Slot: eqs. 18-25 over all arrived ants."""
        amount = self.length_weight / walks.length + self.turn_weight / np.maximum(walks.turns, 1)
        if not floor.flat:
            amount += self.height_weight / (100.0 * np.maximum(walks.spread, self.smallest_spread))
        pheromone *= 1.0 - self.evaporation
        deposit(floor, pheromone, walks, self.evaporation * self.strength * amount)


def initial_pheromone(floor: Floor, boost: float) -> Table:
    """float64[C, 8]: `boost` on the edges of cells in the rectangle between start and goal, 1 elsewhere (eq. 17)."""
    rows, columns = np.divmod(np.arange(len(floor.height)), floor.columns)
    (row_a, column_a), (row_b, column_b) = divmod(floor.start, floor.columns), divmod(floor.goal, floor.columns)
    between = (rows >= min(row_a, row_b)) & (rows <= max(row_a, row_b))
    between &= (columns >= min(column_a, column_b)) & (columns <= max(column_a, column_b))
    return np.repeat(np.where(between, boost, 1.0)[:, None], 8, axis=1)


def gentle_share(floor: Floor, offset: float) -> Table:
    """The fraction of eq. 12 float64[C, 8]: (h_max - |dh|) / (h_max - h_min + offset), heights in metres.

    h_max and h_min (eqs. 13-14) are taken over the legal moves of each cell; 0 where a move is not legal.
    """
    if floor.flat:
        return np.zeros(floor.neighbour.shape)
    difference = np.abs(floor.height[floor.neighbour] - floor.height[:, None]) / MICROMETRES
    highest = np.where(floor.legal, difference, 0.0).max(axis=1, keepdims=True)
    lowest = np.minimum(np.where(floor.legal, difference, np.inf).min(axis=1, keepdims=True), highest)
    return np.where(floor.legal, (highest - difference) / (highest - lowest + offset), 0.0)


def _power(base: Table, exponent: int) -> Table:
    """base^exponent by multiplication, the same to the bit in compiled and in plain Python."""
    result = base.copy()
    for _ in range(exponent - 1):
        result *= base
    return result


@njit(cache=True, error_model="numpy")
def _mix(
    fading: Table,
    fr: float,
    at_turn: NDArray[np.float64],
    ahead: float,
    exponent: int,
    turning: Table,
    straight: Table,
) -> None:
    """Write (fr * fading + at_turn[cell])^exponent to turning and (fr * fading + ahead)^exponent to straight."""
    for cell in range(fading.shape[0]):
        for move in range(8):
            turn, go = fr * fading[cell, move] + at_turn[cell], fr * fading[cell, move] + ahead
            turn_power, go_power = turn, go
            for _ in range(exponent - 1):
                turn_power *= turn
                go_power *= go
            turning[cell, move], straight[cell, move] = turn_power, go_power
