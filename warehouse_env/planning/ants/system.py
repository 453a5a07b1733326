"""AntSystem: what all ant systems share besides the loop: size, dead ends, local search, and the Plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning.ants.colony import Colony, cells_of, run
from warehouse_env.planning.ants.floor import AntFloor, Table, make_floor
from warehouse_env.planning.ants.local_search import improve, straight_runs
from warehouse_env.planning.base import BasePlanner
from warehouse_env.planning.plan import MICRO, CostMap, Plan

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
