"""`central_pbcr`: priority inheritance with backtracking over motion primitives of car-like robots."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from agents.policy import Action
from train.central.primitives import DT, Given, decide_all
from warehouse_env.config import EnvConfig
from warehouse_env.simulation.physics.floor import floor_of
from warehouse_env.simulation.simulator import Simulator

SPEEDS, STEERINGS = (1.3, 0.5, -0.4), (-0.9, -0.35, 0.0, 0.35, 0.9)  # [m/s], [rad]
PERIOD = 1.0  # [s] of a primitive; decided anew sooner, robots that meet rock to and fro and stay where they are
HEADING_WEIGHT = 0.6  # [m] of detour that a heading away from the goal by a right angle is worth
VISIT_WEIGHT = 1.0  # [m] of detour that one more decision spent in the same place is worth
HEADINGS = 8  # of a place: a cell and a heading

Floats = NDArray[np.float64]


class _World:
    """What is remembered of one world: how long robots have been on their way, and where they have been."""

    def __init__(self, simulator: Simulator) -> None:
        n, size = simulator.num_agents, simulator.grid.occupied.size
        self.goal = np.full((n, 2), -1)
        self.since = np.zeros(n)  # decisions since the last goal: the priority
        self.visits = np.zeros((n, size * HEADINGS))
        self.field = np.zeros((n, *simulator.grid.shape))
        self.action = np.zeros((n, 2), np.float32)  # of the present primitives
        self.stops = np.ones(n, bool)  # who has none

    def aim(self, simulator: Simulator, goals: NDArray[np.int32]) -> None:
        """Take the goals int32[N, 2]: whose is new begins to count anew."""
        self.since += 1
        for i in np.flatnonzero((goals != self.goal).any(axis=1)).tolist():
            self.field[i] = _filled(simulator.grid.distance_to((int(goals[i, 0]), int(goals[i, 1]))))
            self.goal[i], self.since[i], self.visits[i] = goals[i], 0, 0


class CentralPBCR:
    """Each decision, in the order of priority, the best primitive by cost to go and visits, with inheritance.

    Source: Guo and Yu 2024, "Decentralized lifelong path planning for multiple Ackerman car-like robots": PIBT whose
    actions are arcs forwards and backwards at a few steering angles; a robot's list is ordered by a cost to go plus a
    term that grows with how often it has been in a place, which drives it out of where it keeps coming back.
    Reconstructed from the idea, not from their code: the cost to go is the distance over cells and the turn that is
    still to be made; a place is a cell and an eighth of a turn. Adapted: bodies have inertia, so an arc is followed by
    a stop and both are kept free; an arc is judged by where it would lead, changes taken as done at once.
    """

    name = "central_pbcr"

    def __init__(self, config: EnvConfig) -> None:
        robot = config.robot
        self._commands = np.array([(v, s) for v in SPEEDS for s in STEERINGS])
        self._step = config.time_step * config.action_repeat  # [s]
        self._every = max(1, round(PERIOD / self._step))  # env steps
        self._decision = round(self._every * self._step / DT)
        self._limits = np.array([
            robot.max_acceleration, robot.max_steering_rate, robot.wheelbase, robot.rear_reach - 0.5 * robot.length,
        ])  # fmt: skip
        self._body = np.array([0.5 * robot.length, 0.5 * robot.width])
        self._worlds: dict[int, _World] = {}

    def act_on(self, simulator: Simulator, generators: Sequence[np.random.Generator]) -> Action:
        """Return raw actions for all robots of all worlds."""
        actions = np.zeros((simulator.num_worlds, simulator.num_agents, 2), np.float32)
        for world in range(simulator.num_worlds):
            if simulator.steps[world] == 0 or world not in self._worlds:
                self._worlds[world] = _World(simulator)
            memory = self._worlds[world]
            if simulator.steps[world] % self._every == 0:
                self._decide(simulator, world, generators[world])
            stop = np.clip(-simulator.state.speed[world] / self._step / self._limits[0], -1.0, 1.0)
            actions[world, :, 0] = np.where(memory.stops, stop, memory.action[:, 0])
            actions[world, :, 1] = np.where(memory.stops, 0.0, memory.action[:, 1])
        return actions

    def _decide(self, simulator: Simulator, world: int, rng: np.random.Generator) -> None:
        """Choose the primitives of the next period."""
        memory, state = self._worlds[world], simulator.state
        poses = state.pose[world].astype(np.float64)
        speeds, steers = state.speed[world].astype(np.float64), state.steer[world].astype(np.float64)
        memory.aim(simulator, state.goal[world])
        rows = np.arange(len(speeds))
        memory.visits[rows, self._place(simulator, poses)] += 1
        ends = self._ends(poses, steers)
        keys = self._cost(simulator, memory, ends)
        keys += VISIT_WEIGHT * memory.visits[rows[:, None], self._place(simulator, ends)]
        keys += rng.uniform(0.0, 1e-3, keys.shape)
        order = np.lexsort((rows, -memory.since))
        floor = floor_of(simulator.grid, simulator.config.sensor.lidar_range)
        choice = decide_all(
            Given(poses, speeds, steers, self._commands, keys, floor, self._body, self._limits, self._decision), order
        )
        change = self._commands[choice] - np.stack([speeds, steers], axis=-1)
        memory.action = np.clip(change / (self._every * self._step) / self._limits[:2], -1.0, 1.0).astype(np.float32)
        memory.stops = choice < 0

    def _ends(self, poses: Floats, steers: Floats) -> Floats:
        """Return float64[N, K, 3], where the arcs of the primitives lead in PERIOD, changes taken as done at once."""
        distance = self._commands[:, 0] * PERIOD
        bend = -np.tan(self._commands[:, 1]) / self._limits[2]
        turn = distance * bend
        chord = distance * np.sinc(0.5 * turn / np.pi)
        heading = poses[:, 2:3] + 0.5 * turn
        x, y = poses[:, 0:1] + chord * np.cos(heading), poses[:, 1:2] + chord * np.sin(heading)
        return np.stack([x, y, poses[:, 2:3] + turn], axis=-1)

    def _place(self, simulator: Simulator, poses: Floats) -> NDArray[np.int64]:
        """Return int64[...], the number of the place (cell and heading) of poses [..., 3]."""
        cells, columns = simulator.grid.nearest_cell(poses[..., :2]), simulator.grid.shape[1]
        heading = np.floor(poses[..., 2] / (2.0 * np.pi) * HEADINGS).astype(np.int64) % HEADINGS
        return np.asarray((cells[..., 0] * columns + cells[..., 1]) * HEADINGS + heading)

    def _cost(self, simulator: Simulator, memory: _World, ends: Floats) -> Floats:
        """Return float64[N, K], metres to go from poses [N, K, 3], and what the turn still to be made is worth."""
        ahead = ends[..., :2] + np.stack([np.cos(ends[..., 2]), np.sin(ends[..., 2])], axis=-1)
        here, there = (_between(memory.field, simulator, points) for points in (ends[..., :2], ahead))
        return here + HEADING_WEIGHT * np.maximum(there - here + 1.0, 0.0)


def _filled(field: Floats) -> Floats:
    """Return distances float64[H, W] with a cell more than their least neighbour's where a shelf stands."""
    wide = np.pad(field, 1, constant_values=np.inf)
    least = np.min([wide[:-2, 1:-1], wide[2:, 1:-1], wide[1:-1, :-2], wide[1:-1, 2:]], axis=0)
    whole = np.where(np.isfinite(field), field, least + 1.0)
    return np.where(np.isfinite(whole), whole, field[np.isfinite(field)].max() + 1.0)


def _between(field: Floats, simulator: Simulator, points: Floats) -> Floats:
    """Return float64[N, K] [m]: fields float64[N, H, W] of cells, bilinear between centres, at points [N, K, 2] [m]."""
    size, (rows, columns) = simulator.grid.cell_size, simulator.grid.shape
    column = np.clip(points[..., 0] / size - 0.5, 0.0, columns - 1.001)
    row = np.clip(rows - 0.5 - points[..., 1] / size, 0.0, rows - 1.001)
    i, j, n = row.astype(np.int64), column.astype(np.int64), np.arange(len(field))[:, None]
    u, v = row - i, column - j
    upper = field[n, i, j] * (1 - v) + field[n, i, j + 1] * v
    lower = field[n, i + 1, j] * (1 - v) + field[n, i + 1, j + 1] * v
    return np.asarray(size * (upper * (1 - u) + lower * u))
