"""`central_pibt`: PIBT on the cells, driven in the order of the plan at every cell.

The environment's path follower drives the lines and speeds that the visits give.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from agents.policy import Action
from agents.route_command import RouteCommand
from train.central.grid_pibt import BACKWARDS, cost_to_go, pibt_step
from train.central.orders import LENGTH, CentralOrders, advance, append, forget_future, goes_straight_on
from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.routes.lanes import resample
from warehouse_env.simulation.simulator import Simulator

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SPACING = 0.25  # [m] of the way-points
REST = 0.2  # [cells] ahead of a cell's centre where a front axle stops: the body nearly stays in the cell
REST_TO_TURN = -0.1  # [cells], the same before a turn from rest: the body hardly swings out of the cell
BACK_SPEED = 0.4  # [m/s]
BRAKE_SHARE = 0.8  # share of the acceleration limit for planned stops
_WAYS = np.array([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])  # (x, y) of headings 0..3

Line = tuple[NDArray[np.float32], float]
"""Way-points float32[R, 2] [m], and the position on them at which the axle must stop [m]."""


def line_of(orders: CentralOrders, robot: int, centre: Floats, side: float) -> Line:
    """Return the line of the visits in the present gear, from the robot's own to the last one granted."""
    at, last = int(orders.at[robot]), int(orders.granted[robot])
    move = orders.move[robot]
    gear = move[at % LENGTH] >= BACKWARDS
    while last > at and any((move[k % LENGTH] >= BACKWARDS) != gear for k in range(at + 1, last + 1)):
        last -= 1
    heading = _WAYS[move[last % LENGTH] % 4]
    goal = centre[orders.cell[robot, last % LENGTH]]
    if gear:  # a straight line along the heading, which is driven from its end towards its start
        here = centre[orders.cell[robot, at % LENGTH]]
        ends = np.stack([goal - side * heading, here + 2 * side * heading])
        return resample(ends, SPACING).astype(np.float32), (1.0 + REST) * side
    begin = at
    while begin > max(orders.first[robot], at - 2) and move[begin % LENGTH] < BACKWARDS:
        begin -= 1
    cells = [centre[orders.cell[robot, k % LENGTH]] for k in range(begin, last + 1)]
    into = _WAYS[move[begin % LENGTH] % 4]
    rest = REST if goes_straight_on(orders, robot, last) else REST_TO_TURN
    cells[-1] = cells[-1] + rest * side * heading
    points = np.stack([cells[0] - side * into, *cells])
    line = resample(rounded(points), SPACING)
    return line.astype(np.float32), float(np.hypot(*np.diff(line, axis=0).T).sum())


def rounded(points: Floats) -> Floats:
    """Return the polyline float64[L, 2] with an arc for each corner, from the middle of the shorter side there.

    On a path over neighbouring cells of side s the arcs' radius is at least s / 2, and they keep s / 2 from shelves.
    """
    pieces = [points[:1]]
    for before, corner, after in zip(points[:-2], points[1:-1], points[2:], strict=True):
        one, two = before - corner, after - corner
        reach = 0.5 * min(math.hypot(*one), math.hypot(*two))
        one, two = one / math.hypot(*one), two / math.hypot(*two)
        turn = math.pi - math.acos(min(max(float(one @ two), -1.0), 1.0))
        if turn < 1e-6:
            continue
        middle = (one + two) / math.hypot(*(one + two))
        centre = corner + middle * reach / math.sin(0.5 * turn)
        radius = reach / math.tan(0.5 * turn)
        along = (two - one) / math.hypot(*(two - one))
        angles = np.linspace(-0.5 * turn, 0.5 * turn, max(math.ceil(turn / 0.05), 2))[:, None]
        pieces.append(centre + radius * (np.sin(angles) * along - np.cos(angles) * middle))
    return np.concatenate([*pieces, points[-1:]])


def give_line(simulator: Simulator, world: int, robot: int, line: NDArray[np.float32]) -> None:
    """Give a robot a line float32[R, 2] [m] to drive, from the point nearest to its axle."""
    r = simulator.robots[world, robot]
    on_route = r["on_route"]
    nearest = int(np.argmin(np.hypot(line[:, 0] - r["motion"]["x"], line[:, 1] - r["motion"]["y"])))
    since_milestone, bearing = on_route["position"] - r["clocks"]["milestone"], on_route["bearing"]
    simulator.dispatcher.give_line(world, robot, line)
    on_route["position"] = nearest * on_route["spacing"]
    r["clocks"]["milestone"] = on_route["position"] - since_milestone
    on_route["bearing"] = bearing  # by which it steers backwards until it has found its place on the line


def speed_for(way: float, period: float, acceleration: float) -> float:
    """Return the speed [m/s] from which a robot can stop within `way` [m] after one more period [s]."""
    brake = BRAKE_SHARE * acceleration
    return -brake * period + math.sqrt((brake * period) ** 2 + 2.0 * brake * max(way, 0.0))


LOOK = 5  # most cells ahead of a robot that are planned and granted
BARRED = 1.5  # [s] of standing against an obstacle before a body backs off
BACKING = 1.0  # [s] of backing off
RESTLESS = 10.0  # half-cells of random detour for a robot in one cell for over PATIENCE
PATIENCE = 4.0  # [s] without a new cell before planning restarts from the poses of the bodies


class _World:
    """Plan, orders and lines of one world."""

    def __init__(self, simulator: Simulator, world: int, rng: np.random.Generator) -> None:
        grid = simulator.grid
        self.world, self.grid = world, grid
        rows, columns = np.indices(grid.shape)
        self.centre = grid.centre(np.stack([rows.ravel(), columns.ravel()], axis=-1))
        self.rng, self.blocked = rng, np.ascontiguousarray(grid.occupied)
        self.costs = np.zeros((simulator.num_agents, 4, grid.occupied.size), np.int32)
        self.costs_to: dict[int, NDArray[np.int32]] = {}  # goal -> cost_to_go
        self.goal = np.full(simulator.num_agents, -1)
        self.waited = np.zeros(simulator.num_agents, np.int64)  # steps of the plan since the last goal: the priority
        pose = simulator.state.pose[world].astype(np.float64)
        heading = np.round(pose[:, 2] / (0.5 * np.pi)).astype(np.int64) % 4
        self.orders = CentralOrders.of(_flat(grid.nearest_cell(pose[:, :2]), grid), heading, grid.occupied.size)
        self.seen = np.full((simulator.num_agents, 3), -1)  # at, granted, goes on: for which each robot has its line
        self.stop = np.zeros(simulator.num_agents)  # [m] on its line
        self.since = np.zeros(simulator.num_agents)  # [s] in one cell
        self.since_forgotten = 0.0  # [s] since planning restarted
        self.barred = np.zeros(simulator.num_agents)  # [s] standing though it should drive; below 0: backing off

    def speeds(self, simulator: Simulator) -> Floats:
        """Extend the plan, renew lines, and return the wanted speeds [m/s], float64[N]."""
        config, robot, orders = simulator.config, simulator.config.robot, self.orders
        period = config.time_step * config.action_repeat
        state, world = simulator.state, self.world
        self._aim(_flat(state.goal[world].astype(np.int64), self.grid))
        before = orders.at.copy()
        pose = state.pose[world].astype(np.float64)
        body = np.array([0.5 * robot.length, 0.5 * robot.width, robot.rear_reach - 0.5 * robot.length])
        advance(orders, pose[:, :2], pose[:, 2], self.centre, body, LOOK)
        self._plan_on(state.alive[world] == 0, period, before)
        advance(orders, pose[:, :2], pose[:, 2], self.centre, body, LOOK)
        wanted = np.array([self._speed(simulator, i, period) for i in range(simulator.num_agents)])
        return self._back_off(wanted, state.speed[world], simulator.events.touching[world] != 0, period)

    def _aim(self, goals: Ints) -> None:
        """Take the robots' goal cells int64[N]."""
        for i in np.flatnonzero(goals != self.goal).tolist():
            goal = int(goals[i])
            if goal not in self.costs_to:
                self.costs_to[goal] = cost_to_go(self.blocked, goal)
            self.costs[i], self.goal[i], self.waited[i] = self.costs_to[goal], goal, 0

    def _back_off(
        self, wanted: Floats, speed: NDArray[np.float32], touching: NDArray[np.bool_], period: float
    ) -> Floats:
        """Return the wanted speeds, reversed for a while for bodies that stand against an obstacle."""
        standing = (np.abs(speed) < 0.05) & (touching | (np.abs(wanted) > 0.2))
        self.barred = np.where((self.barred < 0) | standing, self.barred + period, 0.0)
        begins = (self.barred > BARRED) & (self.rng.random(len(speed)) < 0.3)  # not both of a pair at once
        self.barred[begins] = -BACKING
        self.seen[begins] = -1
        return np.where(self.barred < 0, np.where(wanted < 0, BACK_SPEED, -BACK_SPEED), wanted)

    def _plan_on(self, parked: NDArray[np.bool_], period: float, before: Ints) -> None:
        orders = self.orders
        pending = orders.end - 1 - orders.at
        self.since = np.where(orders.at == before, self.since + period, 0.0)
        restless = self.since > PATIENCE
        if (restless & (pending > 0)).any() and self.since_forgotten > PATIENCE:
            forget_future(orders)
            self.since_forgotten = 0.0
            pending = orders.end - 1 - orders.at
        self.since_forgotten += period
        held = parked | (pending >= LOOK)
        if (pending < LOOK - 2).any():
            rows, last = np.arange(len(held)), (orders.end - 1) % LENGTH
            cell, heading = orders.cell[rows, last], orders.move[rows, last] % BACKWARDS
            resting = (pending == 0) & (orders.first < orders.at)
            tail = np.where(resting, orders.cell[rows, (orders.at - 1) % LENGTH], -1)
            self.waited += 1
            order = np.argsort(-self.waited, kind="stable")
            noise = self.rng.uniform(0.0, np.where(restless, RESTLESS, 0.4)[:, None], (len(cell), 5))
            chosen, moves = pibt_step(cell, heading, self.costs, order, held, tail, noise, self.blocked)
            append(orders, chosen, moves, chosen != cell)

    def _speed(self, simulator: Simulator, i: int, period: float) -> float:
        orders, r = self.orders, simulator.robots[self.world, i]
        now = (int(orders.at[i]), int(orders.granted[i]), int(goes_straight_on(orders, i, int(orders.granted[i]))))
        if tuple(self.seen[i]) != now:
            line, self.stop[i] = line_of(orders, i, self.centre, self.grid.cell_size)
            give_line(simulator, self.world, i, line)
            self.seen[i] = now
        acceleration = simulator.config.robot.max_acceleration
        if orders.move[i, now[0] % LENGTH] >= BACKWARDS:
            return -min(speed_for(float(r["on_route"]["position"]) - self.stop[i], period, acceleration), BACK_SPEED)
        return speed_for(self.stop[i] - float(r["on_route"]["position"]), period, acceleration)


def _flat(cells: Ints, grid: GridMap) -> Ints:
    """Return int64[N], the cells (row, column) int64[N, 2] as row * columns + column."""
    return np.asarray(cells[:, 0] * grid.shape[1] + cells[:, 1])


class CentralPIBT:
    """Gives every robot a line, an order at every cell and a speed, from all poses and goals."""

    name = "central_pibt"

    def __init__(self, config: EnvConfig) -> None:
        self._command = RouteCommand(config)
        self._worlds: dict[int, _World] = {}

    def act_on(self, simulator: Simulator, generators: Sequence[np.random.Generator]) -> Action:
        """Return the actions of all robots of all worlds; a reset world starts a new plan."""
        speeds = np.zeros((simulator.num_worlds, simulator.num_agents))
        for world in range(simulator.num_worlds):
            if simulator.steps[world] == 0 or world not in self._worlds:
                self._worlds[world] = _World(simulator, world, generators[world])
            speeds[world] = self._worlds[world].speeds(simulator)
        return self._command.at_speed(simulator.observation, np.minimum(speeds, self._command.cruise_speed))
