"""The improved ant colony of paper 004, with its path smoothing (eq. 13; Gu, Duan, Su, Yuan 2020, section 3.4).

Lines instead of cells: move the nodes x(i) of a path to a(i) so that
lambda * sum |x(i) - a(i)| + mu * sum |a(i+1) - a(i)| is least and every segment keeps clear of shelves. `power=2`
squares the norms; `power=1` is the print, which cannot move a corner of 45 degrees. The clearance holds for whole
segments, measured to the shelves' faces. Start and goal do not move. docs/planners.md tells how doubtful equations are
read.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import PlanError
from warehouse_env.kernel import kernel
from warehouse_env.maps.clearance import distance, nearest_shelf, segment_gap
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning.ants.aco import AntSystem, goal_distance, power
from warehouse_env.planning.ants.colony import Colony
from warehouse_env.planning.ants.walks import AntFloor, Table, Walks, deposit
from warehouse_env.planning.plan import Plan, validate_line

SWEEPS = 400  # at most, over all nodes of a path
STILL = 1e-6  # [cells] of the largest move in a sweep with which it is done
HALVINGS = 4  # of a move that would come too near to a shelf
SLACK = 1e-9  # [cells] of rounding in comparisons of clearances


class Weights(NamedTuple):
    """The weights of eq. 13."""

    deviation: float  # lambda
    length: float  # mu
    power: int  # of the norms, 1 or 2


@kernel
def _wanted(line, k, x, y, weights):
    """Return where node k makes eq. 13 least while its neighbours stand still; for power 1, a step on the way there."""
    deviation, length, power = weights
    if power == 2:
        scale = deviation + 2.0 * length
        return (
            (deviation * x + length * (line[k - 1, 0] + line[k + 1, 0])) / scale,
            (deviation * y + length * (line[k - 1, 1] + line[k + 1, 1])) / scale,
        )
    # the weighted Fermat point of x(k) and both neighbours (Weiszfeld's step, as Vardi and Zhang mend it at x(k))
    pull_x, pull_y, scale = 0.0, 0.0, 0.0
    for other in (k - 1, k + 1):
        weight = length / max(distance(line[other, 0], line[other, 1], line[k, 0], line[k, 1]), 1e-9)
        pull_x += weight * (line[other, 0] - line[k, 0])
        pull_y += weight * (line[other, 1] - line[k, 1])
        scale += weight
    away = distance(x, y, line[k, 0], line[k, 1])
    if away > 1e-9:
        weight = deviation / away
        pull_x, pull_y, scale = pull_x + weight * (x - line[k, 0]), pull_y + weight * (y - line[k, 1]), scale + weight
        return line[k, 0] + pull_x / scale, line[k, 1] + pull_y / scale
    pull = distance(pull_x, pull_y, 0.0, 0.0)
    share = max(1.0 - deviation / pull, 0.0) / scale if pull > 0.0 else 0.0
    return line[k, 0] + share * pull_x, line[k, 1] + share * pull_y


@kernel
def _cost(line, k, px, py, x, y, weights):
    """Return what node k at p adds to eq. 13."""
    deviation, length, power = weights
    away = distance(px, py, x, y)
    before = distance(px, py, line[k - 1, 0], line[k - 1, 1])
    after = distance(px, py, line[k + 1, 0], line[k + 1, 1])
    if power == 2:
        return deviation * away * away + length * (before * before + after * after)
    return deviation * away + length * (before + after)


@kernel
def _fits(line, k, x, y, need, solid):
    """Return whether both segments at node k keep their clearance with the node at (x, y)."""
    for other, wanted in ((k - 1, need[k - 1]), (k + 1, need[k])):
        if segment_gap(solid, line[other, 0], line[other, 1], x, y, 1.0, wanted) < wanted - SLACK:
            return False
    return True


@kernel
def _move(line, k, x, y, need, solid, weights):
    """Move node k of x(k) = (x, y) as far towards its best place as the shelves let it; return the distance."""
    fromx, fromy = line[k, 0], line[k, 1]
    wantx, wanty = _wanted(line, k, x, y, weights)
    before = _cost(line, k, fromx, fromy, x, y, weights)
    share = 1.0
    for _ in range(HALVINGS):
        tox, toy = fromx + share * (wantx - fromx), fromy + share * (wanty - fromy)
        wanted = max(need[k - 1], need[k])
        gap, awayx, awayy = nearest_shelf(solid, tox, toy, 1.0, wanted)
        short = max(wanted - gap, 0.0)
        for slide in (0.0, short):  # straight there, or else along the shelf
            px, py = tox + slide * awayx, toy + slide * awayy
            lower = _cost(line, k, px, py, x, y, weights) < before
            if lower and _fits(line, k, px, py, need, solid):
                line[k, 0], line[k, 1] = px, py
                return distance(px, py, fromx, fromy)
        share *= 0.5
    return 0.0


@kernel
def _descend(line, nodes, need, solid, weights):
    """Lower eq. 13 node by node, in place; the clearances `need` hold before and after each move."""
    for _ in range(SWEEPS):
        most = 0.0
        for k in range(1, line.shape[0] - 1):
            most = max(most, _move(line, k, nodes[k, 0], nodes[k, 1], need, solid, weights))
        if most < STILL:
            return


def smooth(
    cells: NDArray[np.int64], occupied: NDArray[np.bool_], *, deviation: float = 0.5, length: float = 0.5,
    clearance: float = 0.35, power: int = 2,
) -> NDArray[np.float64]:  # fmt: skip
    """Return the smoothed path float64[L, 2], (row, col) in cells, one node for each cell and the same ends.

    cells: int64[L, 2], a path by the moves of eq. 26; occupied: bool[H, W].
    deviation, length: lambda and mu of eq. 13; power: 2 squares its norms, 1 takes them as printed.
    clearance [cells]: of whole segments from shelf faces and the map's edge. A path of cells keeps 0.5, so up to
    there it is kept; a larger one is kept by the segments that had it, and no segment comes nearer than it was.
    """
    nodes = np.ascontiguousarray(cells[:, ::-1], dtype=np.float64) + 0.5  # (x, y) with cell corners on whole numbers
    solid = np.pad(occupied, 1, constant_values=True).astype(np.uint8)
    line = nodes.copy()
    if len(line) > 2:
        ends = np.hstack([line[:-1], line[1:]]).tolist()
        need = np.array([segment_gap(solid, ax, ay, bx, by, 1.0, clearance) for ax, ay, bx, by in ends])
        _descend(line, nodes, need, solid, Weights(deviation, length, power))
    return line[:, ::-1] - 0.5


FIRST, LAST = 0.4, 0.6  # shares of the iterations between which eq. 14 is greedy


@dataclass(frozen=True)
class Iaco(AntSystem):
    """Gu, Duan, Su, Yuan, Path planning of warehouse logistics robot based on improved ant colony algorithm (2020).

    p ~ pheromone * (zeta / distance of the next cell to the goal)^7 (eqs. 5, 7); with probability q0 an ant takes the
    best edge (eq. 8), q0 by eq. 14; all arrived ants deposit Q / length (eq. 4) on trails that evaporate by a share
    that falls (eq. 9). The path of cells is then smoothed (eq. 13) into the plan's line, whose length
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
        return Colony(np.ones_like(eta), lambda iteration: (eta, eta), self._update, greedy=self.greedy_share)

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
