"""Policies that only follow the route: baselines for learned policies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.policy import Action, Observation
from agents.route_command import RouteCommand
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
