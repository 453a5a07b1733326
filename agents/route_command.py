"""The action that means "drive along your route at this speed, this far beside it", for every action type."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.policy import Action, Observation
from agents.surroundings import Floats
from warehouse_env.config import EnvConfig
from warehouse_env.observation import observation_layout


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

    def at_velocity(self, observation: Observation, velocity: Floats, way: Floats) -> Action:
        """Return the actions for wanted velocities [..., 2] in m/s, own frame; way [..., 2]: where the route leads.

        What goes along `way` is the speed, and what goes across, for a second, the offset.
        """
        along = velocity[..., 0] * way[..., 0] + velocity[..., 1] * way[..., 1]
        across = velocity[..., 1] * way[..., 0] - velocity[..., 0] * way[..., 1]
        return self.beside(observation, along, across)

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
