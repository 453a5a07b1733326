"""The fusion of ant colony and improved potential field of paper 002."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning.ants.aco import AntSystem, goal_distance, power
from warehouse_env.planning.ants.colony import Colony
from warehouse_env.planning.ants.walks import AntFloor, Table, Walks, deposit
from warehouse_env.planning.field_walkers import follow
from warehouse_env.planning.potential_field import alignment, improved_force, intermediate_point, repulsion


@dataclass(frozen=True)
class FusionAco(AntSystem):
    """The ant colony with the improved potential field of paper 002 (transport robots in agriculture), eqs. 5-24.

    p ~ pheromone^1.5 * (1/d_jg)^3 * exp(gamma * fr * cos theta), fr = 1 - iteration / iterations, theta between the
    move and the resultant force of eqs. 12 and 17-20: the field leads the first ants, the pheromone the last. All
    arrived ants deposit Q / L. The paper prints ants, alpha, beta, rho and Q; the other constants are ours.
    docs/planners.md tells how doubtful equations are read.

    intermediate_point: the paper's way out of local minima. On cells where a walker along the force is stuck, and on
    its way from there to the point P (`potential_field.intermediate_point`), the force points to P.
    """

    ants: int = 100
    trail_exponent: float = 1.5  # alpha
    exponent: int = 3  # beta, of 1/d
    field_weight: float = 1.0  # gamma
    attraction_gain: float = 1.0  # K, eq. 11
    repulsion_gain: float = 0.3  # K_rep, eq. 16
    repulsion_reach: float = 2.0  # d_0 [cells]
    distance_exponent: float = 1.0  # n, eq. 16
    intermediate_point: bool = False
    evaporation: float = 0.5  # rho
    strength: float = 1.0  # Q

    name: ClassVar[str] = "fusion_aco"
    shares: ClassVar[tuple[str, ...]] = ("evaporation",)

    def colony(self, grid: GridMap, floor: AntFloor, start: int) -> Colony:
        """Slots: distance times the fading pull of the field; all arrived ants deposit."""
        near = power(1.0 / goal_distance(floor), self.exponent)[floor.neighbour]
        cosine = alignment(self.force(grid, divmod(floor.goal, floor.columns))).reshape(-1, 8)
        return Colony(
            pheromone=np.ones_like(near), attraction=self._attraction(near, cosine),
            update=self._update, trail_power=self.trail_exponent,
        )  # fmt: skip

    def force(self, grid: GridMap, goal: Cell) -> NDArray[np.float64]:
        """The resultant force on every cell float64[H, W, 2] (eq. 24), diverted round local minima if asked."""
        parts = repulsion(grid.occupied, self.repulsion_gain, self.repulsion_reach)
        force: NDArray[np.float64] = improved_force(*parts, goal, self.attraction_gain, self.distance_exponent)
        if not self.intermediate_point:
            return force
        diverted: NDArray[np.float64] = force.copy()
        none_tried = np.zeros(grid.shape, np.bool_)
        for cell in stuck_cells(grid, force, goal):
            point = intermediate_point(grid.closed, cell, goal, none_tried)
            if point[0] >= 0:
                gain, exponent = self.attraction_gain, self.distance_exponent
                way, _ = follow(grid.legal_moves, *parts, cell, point, goal, gain, exponent)
                ahead = np.array(point) - way
                going = ahead.any(axis=1)
                diverted[way[going, 0], way[going, 1]] = ahead[going]
        return diverted

    def _attraction(self, near: Table, cosine: Table) -> Callable[[int], tuple[Table, Table]]:
        """Slot: eqs. 22-23 for an iteration."""
        eta = np.empty_like(near)

        def tables(iteration: int) -> tuple[Table, Table]:
            fr = 1.0 - iteration / self.iterations
            np.exp(self.field_weight * fr * cosine, out=eta)
            np.multiply(eta, near, out=eta)
            return eta, eta

        return tables

    def _update(self, floor: AntFloor, iteration: int, pheromone: Table, walks: Walks, best: Walks) -> None:
        """Slot: eqs. 7-9."""
        pheromone *= 1.0 - self.evaporation
        deposit(floor, pheromone, walks, self.strength / walks.cost)


def stuck_cells(grid: GridMap, force: NDArray[np.float64], goal: Cell) -> list[Cell]:
    """The cells but the goal where walks along the legal move nearest to the force end, or go round for ever."""
    rows, columns = grid.shape
    flat = np.arange(rows * columns)
    cosine = np.where(grid.legal_moves, alignment(force), 0.0).reshape(-1, 8).round(9)
    move = cosine.argmax(axis=1)
    ahead = np.where(cosine.max(axis=1) > 0, flat + (MOVES @ (columns, 1))[move], flat)
    ahead[goal[0] * columns + goal[1]] = goal[0] * columns + goal[1]
    for _ in range(int(len(flat)).bit_length()):  # 2, 4, 8 ... steps at once, until more than there are cells
        ahead = ahead[ahead]
    free = ~grid.closed.reshape(-1)
    ends = np.setdiff1d(ahead[free], [goal[0] * columns + goal[1]])
    return [(int(cell) // columns, int(cell) % columns) for cell in ends]
