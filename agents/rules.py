"""Rules along the route: `follow` it, `brake` for others, paper 001's coordinator, which steps aside (`rules`)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.policy import Action, Observation
from agents.route_command import Floats, Neighbours, RouteCommand, Surroundings
from warehouse_env.config import EnvConfig
from warehouse_env.observation import observation_layout

_SIDE_MARGIN = 0.15  # [m] added to the body's width on both sides of the corridor
_AHEAD_MARGIN = 0.3  # [m] added to the stopping distance


class Follow:
    """Drive along the route at the cruise speed, whatever is ahead."""

    def __init__(self, config: EnvConfig) -> None:
        self._command = RouteCommand(config)

    def act(self, observation: Observation, rng: np.random.Generator) -> Action:
        """Return the cruise action for every row; draws nothing (shapes: `Policy.act`)."""
        return self._command.at_speed(observation, np.full(observation.shape[:-1], self._command.cruise_speed))


class Brake:
    """Drive along the route at the cruise speed, but stop while another robot is in the way ahead."""

    def __init__(self, config: EnvConfig) -> None:
        self._command = RouteCommand(config)
        self._config = config
        slices = observation_layout(config).slices
        self._ego, self._neighbours = slices["ego"].start, slices["neighbours"]

    def act(self, observation: Observation, rng: np.random.Generator) -> Action:
        """Return the cruise or the stop action for every row; draws nothing (shapes: `Policy.act`)."""
        speed = np.where(self.blocked(observation), 0.0, self._command.cruise_speed)
        return self._command.at_speed(observation, speed)

    def blocked(self, observation: Observation) -> NDArray[np.bool_]:
        """Return which rows must stop, bool[...]: another body reaches into the corridor ahead.

        The corridor is as wide as the body plus a margin, straight along the heading, and as long as the robot needs
        to stop from the cruise speed, reaction included: v t + v^2 / (2 a). A neighbour counts by the rectangle it
        covers at its relative heading.
        """
        robot, sensor = self._config.robot, self._config.sensor
        others = observation[..., self._neighbours]
        others = others.reshape(*others.shape[:-1], sensor.neighbours, 7)
        x, y = others[..., 0] * sensor.lidar_range, others[..., 1] * sensor.lidar_range
        cos, sin, present = np.abs(others[..., 2]), np.abs(others[..., 3]), others[..., 6] > 0.5
        reach_x = 0.5 * (robot.length * cos + robot.width * sin)  # half extents of the other body along own axes
        reach_y = 0.5 * (robot.length * sin + robot.width * cos)

        speed = np.maximum(observation[..., self._ego] * robot.max_speed, 0.0)
        reaction = self._config.time_step * self._config.action_repeat
        speed = np.minimum(speed + robot.max_acceleration * reaction, robot.max_speed)  # reached before the next look
        stopping = speed * reaction + speed**2 / (2.0 * robot.max_acceleration) + _AHEAD_MARGIN
        ahead = (x > 0.0) & (x - reach_x - 0.5 * robot.length < stopping[..., None])
        beside = np.abs(y) - reach_y < 0.5 * robot.width + _SIDE_MARGIN
        return np.asarray((present & ahead & beside).any(axis=-1))


Mask = NDArray[np.bool_]
_ALIKE = 0.7  # cosine of the relative heading beyond which two drive alike, or head-on below its negative
_STANDS = 0.1  # [m/s]


@dataclass(frozen=True)
class RuleNumbers:
    """Thresholds of conflicts and of stepping aside; tuned on trial seeds."""

    range: float = 2.5  # [m] between the bodies' centres
    corridor: float = 0.25  # [m] between two bodies that can pass each other
    aside: float = 0.6  # [m] of the step aside
    slow: float = 0.5  # [m/s] while stepping aside
    patience: float = 2.0  # [s] of standing after which a robot may back
    begins: float = 0.1  # chance per decision to begin backing after that
    lasts: float = 0.97  # chance per decision to continue backing


class Rules:
    """Wait at nodes without priority; step aside in head-on conflicts, or back.

    Source: paper 001, section 2.3. A coordinator knows all paths and finds two kinds of conflict. If two robots reach a
    node at once, the one of lower priority waits before it. If two meet head-on along the same cells, the one of lower
    priority moves into a free cell beside its path until the other has passed, or takes a new path if that is faster.
    Priority depends on the kind of task, then on the shorter remaining path.
    Adapted: an observation holds neither the tasks nor the paths of others. At a node, a robot that is nearer by a
    body's length goes first (the visible part of the remaining path); otherwise the robot from the right goes first.
    Head-on, both step aside to their right if lidar finds that free, otherwise to their left. If neither side is free,
    or the path stays blocked, one robot backs; chance decides which one, because both see the same. A robot waits for
    a standing robot ahead (an occupied node). New paths come from the environment, if it has live routes.
    """

    def __init__(self, config: EnvConfig, numbers: RuleNumbers = RuleNumbers()) -> None:
        self._command, self._brake = RouteCommand(config), Brake(config)
        self._surroundings = Surroundings(config, "lidar", "neighbours")
        self._robot, self._numbers = config.robot, numbers

    def act(self, observation: Observation, rng: np.random.Generator) -> Action:
        """Return what the rules command for every row; draws two numbers a row (shapes: `Policy.act`)."""
        numbers, near = self._numbers, self._surroundings.neighbours(observation)
        speed, chance = self._surroundings.speed(observation), rng.random((2, *observation.shape[:-1]))
        head_on = self.head_on(near).any(axis=-1)
        waits = self.must_wait(near, speed).any(axis=-1)
        barred = self._brake.blocked(observation)
        side = self.free_side(observation)

        impatient = self._surroundings.waited(observation) > numbers.patience
        backing = np.where(speed < -_STANDS, chance[0] < numbers.lasts, impatient & (chance[1] < numbers.begins))
        backing &= self._someone_ahead(near).any(axis=-1)

        wanted = np.full(speed.shape, self._command.cruise_speed)
        wanted = np.where(head_on, numbers.slow, wanted)
        wanted = np.where(barred | (waits & ~impatient), 0.0, wanted)
        wanted = np.where(backing, self._robot.min_speed, wanted)
        return self._command.beside(observation, wanted, np.where(head_on, numbers.aside * side, 0.0))

    def head_on(self, near: Neighbours) -> Mask:
        """Return which neighbours drive head-on along the own path, bool[..., K]."""
        wide = np.abs(near.y) < self._robot.width + self._numbers.corridor
        return self._someone_ahead(near) & wide & (near.cos < -_ALIKE)

    def must_wait(self, near: Neighbours, speed: Floats) -> Mask:
        """Return for which moving neighbours the robot, at `speed` [...] in m/s, waits before a node, bool[..., K].

        The node is where the own line, straight ahead, meets the other's: y + s sin = 0, own = x + s cos.
        """
        crossing = near.present & (np.abs(near.cos) <= _ALIKE)
        sin = np.where(crossing, near.sin, 1.0)
        others = -near.y / sin  # [m] that the other has to go to the node
        own = near.x + others * near.cos
        length, reach = self._robot.length, self._numbers.range
        both = crossing & (own > 0.0) & (own < reach) & (others > -0.5 * length) & (others < reach)
        moving = np.hypot(near.vx + speed[..., None], near.vy) > _STANDS
        from_right = near.sin > 0.0
        last = (own > others + length) | ((np.abs(own - others) <= length) & from_right)
        return np.asarray(both & moving & last)

    def free_side(self, observation: Observation) -> Floats:
        """Return where a step aside is free, [...]: -1 to the right, else 1 to the left, else 0."""
        gaps, rays = self._surroundings.gaps(observation), self._surroundings.rays
        room = self._numbers.aside * 0.5
        right = np.where(rays[:, 1] < -_ALIKE, gaps, np.inf).min(axis=-1) > room
        left = np.where(rays[:, 1] > _ALIKE, gaps, np.inf).min(axis=-1) > room
        return np.where(right, -1.0, np.where(left, 1.0, 0.0))

    def _someone_ahead(self, near: Neighbours) -> Mask:
        close = np.hypot(near.x, near.y) < self._numbers.range
        return np.asarray(near.present & close & (near.x > 0.0))
