"""Read observations for rules, in metres and metres per second, in the robot's own frame."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.policy import Observation
from warehouse_env.config import EnvConfig
from warehouse_env.observation import EGO, NEIGHBOUR, observation_layout

Floats = NDArray[np.float64]


class Neighbours(NamedTuple):
    """The nearest robots, [..., K]; entries without a robot are meaningless."""

    present: NDArray[np.bool_]
    x: Floats  # [m] of the other body's centre from the own
    y: Floats
    cos: Floats  # of the relative heading
    sin: Floats
    vx: Floats  # [m/s], relative to the own velocity
    vy: Floats


class Surroundings:
    """Reads the slices of the observations of one config; ConfigError unless it has the `needed` ones."""

    def __init__(self, config: EnvConfig, *needed: str) -> None:
        self._config = config
        self._slices = observation_layout(config).slices
        for name in needed:
            self._slices[name]
        sensor, robot = config.sensor, config.robot
        angle = 2.0 * math.pi * np.arange(sensor.rays) / sensor.rays
        self.rays = np.stack([np.cos(angle), np.sin(angle)], axis=-1)  # [R, 2]
        with np.errstate(divide="ignore"):
            to_end = 0.5 * robot.length / np.abs(self.rays[:, 0])
            to_side = 0.5 * robot.width / np.abs(self.rays[:, 1])
        self.reach = np.minimum(to_end, to_side)  # [R], [m] from the body's centre to its edge along each ray
        self._ahead = sensor.route_spacing * (1 + np.arange(sensor.route_points))

    def gaps(self, observation: Observation) -> Floats:
        """Return float64[..., R]: from the body's edge to what a ray meets [m], at least 0."""
        lidar = np.clip(observation[..., self._slices["lidar"]].astype(np.float64), 1e-3, 1.0)
        return np.asarray(np.maximum(1.0 / lidar - 1.0 - self.reach, 0.0))

    def _ego(self, observation: Observation, k: int) -> Floats:
        return observation[..., self._slices["ego"].start + k].astype(np.float64)

    def speed(self, observation: Observation) -> Floats:
        """Return the own speed [m/s]."""
        return np.asarray(self._ego(observation, 0) * self._config.robot.max_speed)

    def waited(self, observation: Observation) -> Floats:
        """Return how long the robot has been standing [s], at most 20."""
        return np.asarray(self._ego(observation, EGO - 1) * 20.0)

    def to_go(self, observation: Observation) -> Floats:
        """Return the way left to the goal [m], at most 20."""
        return np.asarray(self._ego(observation, EGO - 3) * 20.0)

    def towards_route(self, observation: Observation, ahead: float) -> Floats:
        """Return float64[..., 2], unit vector from the front axle to the route's point about `ahead` [m] away."""
        k = self._slices["route"].start + 2 * int(np.argmin(np.abs(self._ahead - ahead)))
        point = observation[..., k : k + 2].astype(np.float64)
        length = np.hypot(point[..., 0], point[..., 1])[..., None]
        return np.where(length > 1e-3, point / np.maximum(length, 1e-3), [1.0, 0.0])

    def neighbours(self, observation: Observation) -> Neighbours:
        """Return the nearest robots."""
        sensor, robot = self._config.sensor, self._config.robot
        rows = observation[..., self._slices["neighbours"]].astype(np.float64)
        rows = rows.reshape(*rows.shape[:-1], sensor.neighbours, NEIGHBOUR)
        x, y = rows[..., 0] * sensor.lidar_range, rows[..., 1] * sensor.lidar_range
        vx, vy = rows[..., 4] * robot.max_speed, rows[..., 5] * robot.max_speed
        return Neighbours(rows[..., 6] > 0.5, x, y, rows[..., 2], rows[..., 3], vx, vy)
