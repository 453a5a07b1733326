"""What all ant systems share besides the loop, the traditional colony, and the potential-field colony of paper 001."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning.ants.colony import Colony, cells_of, run
from warehouse_env.planning.ants.local_search import improve, straight_runs
from warehouse_env.planning.ants.walks import AntFloor, Table, Walks, deposit, make_floor
from warehouse_env.planning.base import BasePlanner
from warehouse_env.planning.plan import MICRO, CostMap, Plan
from warehouse_env.planning.potential_field import descent_length, improved_potential, repulsion

STEP: NDArray[np.float64] = np.sqrt((MOVES**2).sum(axis=1))  # [8] length of each move: 1 or sqrt 2
_WALKS = 100_000_000
_AT_GOAL = 0.1  # [cells] stands for the distance 0 of the goal cell to itself
_EASE_POWER = 2  # an edge that costs twice its length is a quarter as attractive


@dataclass(frozen=True)
class AntSystem(BasePlanner):
    """Base of the ant systems: each gives its slots in `colony`, and its constants as further fields.

    An ant at a dead end steps back (dead_end="backtrack"), or dies as in the papers ("die"), which can leave a run
    without any path. With local_search an iteration's best paths are straightened (local_search.py) before they count
    and deposit.
    """

    ants: int = 50
    iterations: int = 100
    dead_end: Literal["backtrack", "die"] = "backtrack"
    local_search: bool = False
    elite: int = 1  # paths of an iteration that local search shortens: the best ones that differ
    gentleness: float = 0.0  # [cells/m] detour that a metre of climbing is worth
    patience: int | None = None  # stop after so many iterations without a better path; None: never before the last

    takes_cost: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        self._between(1, _WALKS // self.ants, "iterations")  # each walk's seed is drawn before the first

    def colony(self, grid: GridMap, floor: AntFloor, start: int) -> Colony:
        """Return the slots for ants that start on a flat cell."""
        raise NotImplementedError

    def find(self, grid: GridMap, start: Cell, goal: Cell, rng: np.random.Generator, cost: CostMap) -> Plan:
        """Let the colony search."""
        floor = make_floor(grid, goal, self.gentleness, cost)
        first = start[0] * floor.columns + start[1]
        colony = self.colony(grid, floor, first)
        if cost is not None:
            colony = replace(colony, attraction=_eased(floor, colony.attraction))
        appraise = partial(improve, floor, straight_runs(floor), self.elite) if self.local_search else None
        back = self.dead_end == "backtrack"
        found = run(
            floor, colony, first, self.ants, self.iterations, rng,
            patience=self.patience, backtrack=back, appraise=appraise,
        )  # fmt: skip
        return self.finish(grid, Plan(cells_of(floor, found.best, 0), found.best_by_iteration))

    def finish(self, grid: GridMap, plan: Plan) -> Plan:
        """Return the finished plan; a system that smooths adds its line here."""
        return plan


def goal_distance(floor: AntFloor) -> NDArray[np.float64]:
    """Straight-line distance float64[C] [cells] of each cell to the goal, 0.1 for the goal itself."""
    row, column = np.divmod(np.arange(len(floor.height)), floor.columns)
    goal_row, goal_column = divmod(floor.goal, floor.columns)
    distance: NDArray[np.float64] = np.sqrt(((row - goal_row) ** 2 + (column - goal_column) ** 2).astype(np.float64))
    return np.maximum(distance, _AT_GOAL)


def _eased(floor: AntFloor, attraction: Callable[[int], tuple[Table, Table]]) -> Callable[[int], tuple[Table, Table]]:
    """Let the attraction of an edge fall as its toll grows: times (length / (length + toll))^2."""
    ease = (STEP / (STEP + floor.toll / MICRO)) ** _EASE_POWER

    def tables(iteration: int) -> tuple[Table, Table]:
        turning, straight = attraction(iteration)
        eased = turning * ease
        return eased, eased if straight is turning else straight * ease

    return tables


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
        return Colony(np.ones_like(eta), lambda iteration: (eta, eta), self._update)

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
        return Colony(np.ones_like(eta), lambda iteration: (eta, eta), self._update)

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
