"""Way-points as a code for paths: what particle and fish swarms search over, and how a code becomes a path.

A swarm searches real numbers; a path is a chain of cells. The usual code (e.g. Roberge, Tarbouchi & Labonte 2013) is a
list of K points that the path visits in turn. With straight lines between them, nearly every code on a cluttered map
hits a shelf. So a fixed walker, which knows the map but no distances around shelves, joins them by valid moves: each
code is a path, unless there is none. The particle swarm is a baseline of paper 003.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning.ants.colony import cells_of
from warehouse_env.planning.ants.walks import AntFloor, empty_walks, keep, make_floor, measure
from warehouse_env.planning.base import BasePlanner
from warehouse_env.planning.plan import CostMap, Plan

Code = NDArray[np.float64]  # [m, K, 2] way-points (row, col) [cells] of m agents


class _Ground(NamedTuple):
    """The walker's map."""

    floor: AntFloor
    nearest: NDArray[np.int32]  # [C], the cell of the start's region next to each cell
    start: int


class Paths:
    """Turns codes into paths, measures them, and keeps the best."""

    def __init__(self, grid: GridMap, floor: AntFloor, start: int) -> None:
        self.shape = grid.shape
        at, goal = divmod(start, floor.columns), divmod(floor.goal, floor.columns)
        self.reachable = bool(np.isfinite(grid.distance_to(goal)[at]))
        inside = grid.return_region(goal if grid.closed[at] else at)  # no way leads back onto tight floor
        nearest = _nearest(inside.ravel(), floor.columns)
        self._ground = _Ground(floor, nearest, start)
        self.best, self._walks = empty_walks(start, 1, len(nearest)), empty_walks(start, 1, len(nearest))
        self.history: list[float] = []

    def cost(self, code: Code) -> NDArray[np.float64]:
        """Return float64[m], length + tolls [cells] of the path of each code; the best path of all is kept.

        Points outside the map count as the nearest ones inside.
        """
        floor, walks = self._ground.floor, self._walks
        if len(walks.start) < len(code):
            walks = self._walks = empty_walks(self._ground.start, len(code), len(self._ground.nearest))
        decode(self._ground, self._to_cells(code), walks)
        winner = measure(floor, walks, 0, len(code))
        if (walks.cost[winner], walks.turns[winner]) < (self.best.cost[0], self.best.turns[0]):
            keep(walks, winner, self.best)
        return walks.cost[: len(code)].copy()

    def _to_cells(self, code: Code) -> NDArray[np.int64]:
        """Flat cells int64[m, K] that hold the points."""
        rows, columns = self.shape
        cell = np.floor(code + 0.5).astype(np.int64)
        flat: NDArray[np.int64] = cell[..., 0].clip(0, rows - 1) * columns + cell[..., 1].clip(0, columns - 1)
        return flat

    def end_iteration(self) -> None:
        """Note how good the best path is by now."""
        self.history.append(float(self.best.length[0]))


@dataclass(frozen=True)
class WaypointSwarm(BasePlanner):
    """Base of the swarms that search over way-points: each gives its `search`, and its constants as further fields."""

    iterations: int = 100
    waypoints: int = 6  # K
    gentleness: float = 0.0  # [cells/m] detour that a metre of climbing is worth

    takes_cost: ClassVar[bool] = True

    def search(self, paths: Paths, first: Code, rng: np.random.Generator) -> None:
        """Improve the first codes float64[m, K, 2]; call paths.end_iteration after each of the iterations."""
        raise NotImplementedError

    def agents(self) -> int:
        """Number of agents m."""
        raise NotImplementedError

    def find(self, grid: GridMap, start: Cell, goal: Cell, rng: np.random.Generator, cost: CostMap) -> Plan:
        """Let the swarm search."""
        floor = make_floor(grid, goal, self.gentleness, cost)
        paths = Paths(grid, floor, start[0] * floor.columns + start[1])
        if paths.reachable:
            self.search(paths, first_codes(grid.shape, start, goal, self.agents(), self.waypoints, rng), rng)
        else:
            paths.history = [np.inf] * self.iterations
        return Plan(cells_of(floor, paths.best, 0), np.array(paths.history))


def first_codes(
    shape: tuple[int, int], start: Cell, goal: Cell, agents: int, waypoints: int, rng: np.random.Generator
) -> Code:
    """Return float64[m, K, 2]: points evenly along the straight line from start to goal, each moved at random.

    The first agent's stay on the line; those of the others are moved by up to half the map's size either way, the more
    the later the agent, and those that leave the map are drawn back to its edge.
    """
    part = (np.arange(waypoints) + 1.0) / (waypoints + 1.0)
    line = np.array(start) + part[:, None] * (np.array(goal) - np.array(start))
    spread = np.linspace(0.0, 0.5, agents)[:, None, None] * np.array(shape)
    code: Code = line + spread * rng.uniform(-1.0, 1.0, (agents, waypoints, 2))
    return np.clip(code, 0.0, np.array(shape) - 1.0)


@kernel
def _nearest(inside, columns):
    """Return int32[C]: the cell of bool[C] `inside` from which a flood in 8 directions reaches each cell first."""
    cells = len(inside)
    rows = cells // columns
    nearest = np.full(cells, -1, np.int32)
    queue = np.empty(cells, np.int32)
    size = 0
    for cell in range(cells):
        if inside[cell]:
            nearest[cell] = cell
            queue[size] = cell
            size += 1
    at = 0
    while at < size:
        cell = queue[at]
        at += 1
        for k in range(8):
            move = 2 * k % 8 + k // 4  # the straight ones first
            row, column = cell // columns + MOVES[move, 0], cell % columns + MOVES[move, 1]
            to = row * columns + column
            if 0 <= row < rows and 0 <= column < columns and nearest[to] < 0:
                nearest[to] = nearest[cell]
                queue[size] = to
                size += 1
    return nearest


@kernel
def decode(ground, points, walks):
    """Write the path of each row of flat cells int64[m, K] to walks.moves and walks.steps.

    The walker goes from the start to each point in turn (to the nearest cell that it can reach, where the point is on
    a shelf), and last to the goal, which must be reachable. Then the path is cut short: from each cell it goes on to
    that neighbour which the walk came to last, so no cell is left twice.
    """
    floor = ground.floor
    cells, stops = len(ground.nearest), points.shape[1]
    visited = np.zeros(cells, np.int64)  # the last leg, numbered over all walks, that came to a cell
    stack = np.empty(cells, np.int64)
    came = np.full(cells, -1, np.int64)  # when the walk, all walks counted on, came to a cell last
    clock = 0
    for agent in range(points.shape[0]):
        here, begun = ground.start, clock
        came[here] = clock
        for stop in range(stops + 1):
            target = ground.nearest[points[agent, stop]] if stop < stops else floor.goal
            leg = agent * (stops + 1) + stop + 1
            count = _walk_to(floor, here, target, visited, leg, stack)
            for k in range(1, count):
                clock += 1
                came[stack[k]] = clock
            here = target
        clock += 1
        walks.steps[agent] = _cut_short(floor, ground.start, came, begun, walks.moves[agent])


@kernel
def _walk_to(floor, start, target, visited, leg, stack):
    """Walk greedily: always to the neighbour nearest to the target as the crow flies, never twice to a cell, back where
    it goes no further (depth-first search). Write the cells to `stack`, without blind alleys; return their number.

    Of neighbours equally near, the one straight ahead is taken, else the first. visited: int64[C], marked with `leg`.
    """
    columns = floor.columns
    row, column = target // columns, target % columns
    stack[0], count, heading, cell = start, 1, -1, start
    visited[start] = leg
    while cell != target:
        best, least, chosen = -1, 0, -1
        for move in range(8):
            to = floor.neighbour[cell, move]
            if visited[to] != leg:
                d_row, d_column = to // columns - row, to % columns - column
                far = d_row * d_row + d_column * d_column
                if best < 0 or far < least or (far == least and move == heading):
                    best, least, chosen = to, far, move
        if best < 0:
            count -= 1
            cell, heading = stack[count - 1], -1
        else:
            cell, heading = best, chosen
            visited[cell] = leg
            stack[count] = cell
            count += 1
    return count


@kernel
def _cut_short(floor, start, came, begun, moves):
    """Write the moves of the shortened walk that began at time `begun`; return their number."""
    cell, count = start, 0
    while cell != floor.goal:
        last, chosen = begun - 1, -1
        for move in range(8):
            to = floor.neighbour[cell, move]
            if to != cell and came[to] > last:
                last, chosen = came[to], move
        moves[count] = chosen
        count += 1
        cell = floor.neighbour[cell, chosen]
    return count


@dataclass(frozen=True)
class ParticleSwarm(WaypointSwarm):
    """Particle swarm optimisation (Kennedy & Eberhart 1995) with falling inertia (Shi & Eberhart 1998).

    x is a code of K way-points, its cost the length of the path that it decodes to. Each iteration
    v <- w*v + c1*r1*(own best - x) + c2*r2*(swarm's best - x) and x <- x + v, with r1, r2 uniform in [0, 1] for each
    coordinate. Velocities are limited, and points that would leave the map stop at its edge.

    Paper 003 compares with "PSO" and prints neither its code nor its constants; these are the usual ones.
    """

    particles: int = 50
    inertia_first: float = 0.9  # w of the first iteration ...
    inertia_last: float = 0.4  # ... and of the last, linear between
    own_pull: float = 2.0  # c1
    swarm_pull: float = 2.0  # c2
    speed_limit: float = 0.2  # of the map's size an iteration

    name: ClassVar[str] = "pso"

    def agents(self) -> int:
        """Number of particles."""
        return self.particles

    def search(self, paths: Paths, first: Code, rng: np.random.Generator) -> None:
        """Let the particles fly."""
        place, edge = first, np.array(paths.shape) - 1.0
        limit = self.speed_limit * np.array(paths.shape)
        velocity = np.zeros_like(place)
        own, own_cost = place.copy(), np.full(len(place), np.inf)
        for iteration in range(self.iterations):
            cost = paths.cost(place)
            better = cost < own_cost
            own[better], own_cost[better] = place[better], cost[better]
            leader = own[np.argmin(own_cost)]
            along = iteration / max(1, self.iterations - 1)
            inertia = self.inertia_first + (self.inertia_last - self.inertia_first) * along
            pulls = rng.random((2, *place.shape))
            velocity = inertia * velocity + self.own_pull * pulls[0] * (own - place)
            velocity = np.clip(velocity + self.swarm_pull * pulls[1] * (leader - place), -limit, limit)
            aim = place + velocity
            place = np.clip(aim, 0.0, edge)
            velocity[aim != place] = 0.0
            paths.end_iteration()
