"""What rules read and write: observations in metres and metres per second, in the robot's own frame; and the action
that means "drive along your route at this speed, this far beside it", for every action type.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.policy import Action, Observation
from warehouse_env.config import EnvConfig
from warehouse_env.observation import EGO, NEIGHBOUR, observation_layout

Floats = NDArray[np.float64]


class RouteCommand:
    """Turns wanted speeds into actions of one env config; the path follower does the steering.

    cruise_speed: the fastest speed the actions offer [m/s].
    """

    def __init__(self, config: EnvConfig) -> None:
        self._config = config
        slices = observation_layout(config).slices
        self._ego = slices["ego"].start
        self._route = slices["route"].start if config.action_type == "raw" else 0
        self._levels = np.asarray(config.speed_levels)
        self._offsets = np.asarray(config.lateral_offsets)
        self._widest = float(np.abs(self._offsets).max())
        self.cruise_speed = float(min(self._levels.max(), config.robot.max_speed))

    def at_speed(self, observation: Observation, speed: Floats) -> Action:
        """Return the actions that drive on the route at the wanted speeds [...] in m/s."""
        return self.beside(observation, speed, np.zeros_like(speed))

    def beside(self, observation: Observation, speed: Floats, offset: Floats) -> Action:
        """Return the actions for speeds [...] in m/s and offsets [...] in m left of the route; discrete: the nearest.

        Raw actions steer for the first route point, moved sideways by the offset.
        """
        if self._config.action_type == "discrete":
            level = np.argmin(np.abs(speed[..., None] - self._levels), axis=-1)
            lane = np.argmin(np.abs(offset[..., None] - self._offsets), axis=-1)
            return np.asarray(level * len(self._offsets) + lane)
        if self._config.action_type == "continuous":
            return self._residual(speed, offset)
        return self._raw(observation, speed, offset)

    def _residual(self, speed: Floats, offset: Floats) -> NDArray[np.float32]:
        """Continuous: first 0 at the cruise speed, -1 at min_speed, 1 at max_speed; then the offset, 0 on the route."""
        robot, change = self._config.robot, speed - self.cruise_speed
        faster, slower = robot.max_speed - self.cruise_speed, self.cruise_speed - robot.min_speed
        scaled = np.where(change > 0, change / max(faster, 1e-6), change / max(slower, 1e-6))
        return _clipped(scaled, offset / max(self._widest, 1e-6))

    def _raw(self, observation: Observation, speed: Floats, offset: Floats) -> NDArray[np.float32]:
        """Raw: the acceleration and steering rate that reach the speed and the steering by the next step.

        Pure pursuit of the first route point: the arc through it bends by 2 y / (x^2 + y^2), and the rear wheels
        turn by -atan(L bend), eq. (2) of paper 000; the more they must turn, the slower it goes.
        """
        robot, ego, route = self._config.robot, self._ego, self._route
        duration = self._config.time_step * self._config.action_repeat
        bearing = np.pi * observation[..., ego + 3]
        x = 5.0 * observation[..., route] - offset * np.sin(bearing)
        y = 5.0 * observation[..., route + 1] + offset * np.cos(bearing)
        bend = 2.0 * y / np.maximum(x**2 + y**2, 0.01)
        steering = np.clip(-np.arctan(robot.wheelbase * bend), -robot.max_steering, robot.max_steering)
        steering = np.where(x > 0.0, steering, -np.copysign(robot.max_steering, y))
        speed = np.minimum(speed, self.cruise_speed * np.maximum(1.0 - np.abs(steering) / robot.max_steering, 0.25))
        change = speed - observation[..., ego] * robot.max_speed
        turn = steering - observation[..., ego + 1] * robot.max_steering
        return _clipped(change / (duration * robot.max_acceleration), turn / (duration * robot.max_steering_rate))


def _clipped(first: Floats, second: Floats) -> NDArray[np.float32]:
    return np.clip(np.stack([first, second], axis=-1), -1.0, 1.0).astype(np.float32)


def cruise_output(config: EnvConfig, bias: float) -> NDArray[np.float32]:
    """Return the output of an untrained actor that prefers to cruise on its route, float32[A].

    Discrete: logits, `bias` for the fastest level and again for the offset nearest to 0, so that each is e^bias times
    as probable as any other. Real-valued: 0, which is the cruise action, or no command at all for raw.
    """
    if config.action_type != "discrete":
        return np.zeros(2, np.float32)
    level, offset = np.zeros(len(config.speed_levels)), np.zeros(len(config.lateral_offsets))
    level[int(np.argmax(config.speed_levels))] = bias
    offset[int(np.argmin(np.abs(config.lateral_offsets)))] = bias
    return (level[:, None] + offset[None, :]).ravel().astype(np.float32)


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
