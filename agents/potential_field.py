"""`apf`: a reactive potential field, the traditional avoidance that the papers compare with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from agents.policy import Action, Observation
from agents.route_command import RouteCommand
from agents.surroundings import Floats, Surroundings
from warehouse_env.config import EnvConfig

_LEAST_GAP = 0.05  # [m] from which the field no longer grows


@dataclass(frozen=True)
class FieldGains:
    """The field's numbers, tuned on trial seeds; the attraction has the strength 1."""

    lidar: float = 0.005  # [m^3], eta of paper 001's eq. 9 for what the lidar meets
    lidar_range: float = 0.8  # [m], its rho_0, from the body's edge
    robots: float = 0.05  # [m^3], eta for a neighbour at rest; more as it comes nearer
    robots_range: float = 2.5  # [m], its rho_0, between the bodies' edges
    look: float = 2.0  # [m] along the route to the attracting point


class PotentialField:
    """Attraction to a route point ahead, repulsion from lidar returns and robots; their sum is the wanted velocity.

    Source: Khatib 1986 in the form of paper 001, eqs. 6-12: U_rep = eta / 2 (1 / d - 1 / rho_0)^2 d_goal^n, n = 0.5,
    so that a goal beside a shelf can be reached. Adapted: the attracting point moves along the route, with the same
    strength at any distance, since the route is the global plan; distances are from the body's edge, not from a point;
    a robot repels by how fast it approaches, too; the force is turned into a command of the follower by RouteCommand.
    """

    def __init__(self, config: EnvConfig, gains: FieldGains = FieldGains()) -> None:
        self._command, self._gains = RouteCommand(config), gains
        self._surroundings = Surroundings(config, "lidar", "route", "neighbours")
        self._diameter = config.robot.length  # [m], two bodies' reach towards each other, nose to nose

    def act(self, observation: Observation, rng: np.random.Generator) -> Action:
        """Return the command nearest to the force for every row; draws nothing (shapes: `Policy.act`)."""
        force = self.force(observation)
        strength = np.hypot(force[..., 0], force[..., 1])[..., None]
        velocity = self._command.cruise_speed * force / np.maximum(strength, 1.0)
        way = self._surroundings.towards_route(observation, self._gains.look)
        return self._command.at_velocity(observation, velocity, way)

    def force(self, observation: Observation) -> Floats:
        """Return the sum of the forces in the own frame, float64[..., 2]; 1 is the attraction."""
        near_goal = np.sqrt(np.clip(self._surroundings.to_go(observation), 0.0, 1.0))[..., None]
        repulsion = self._from_lidar(observation) + self._from_robots(observation)
        return self._surroundings.towards_route(observation, self._gains.look) + near_goal * repulsion

    def _from_lidar(self, observation: Observation) -> Floats:
        """Mean over the rays, so that their number does not matter."""
        gap = np.maximum(self._surroundings.gaps(observation), _LEAST_GAP)
        push = _repulsion(gap, self._gains.lidar, self._gains.lidar_range)
        rays = self._surroundings.rays
        return -np.stack([(push * rays[:, 0]).mean(axis=-1), (push * rays[:, 1]).mean(axis=-1)], axis=-1)

    def _from_robots(self, observation: Observation) -> Floats:
        near = self._surroundings.neighbours(observation)
        distance = np.maximum(np.hypot(near.x, near.y), _LEAST_GAP)
        ux, uy = near.x / distance, near.y / distance
        approach = np.maximum(-(near.vx * ux + near.vy * uy), 0.0)  # [m/s]
        gap = np.maximum(distance - self._diameter, _LEAST_GAP)
        push = _repulsion(gap, self._gains.robots, self._gains.robots_range) * (1.0 + approach) * near.present
        return -np.stack([(push * ux).sum(axis=-1), (push * uy).sum(axis=-1)], axis=-1)


def _repulsion(gap: Floats, eta: float, rho: float) -> Floats:
    """Paper 001, eq. 11, without its goal factor: eta (1 / d - 1 / rho_0) / d^2 within rho_0."""
    return np.where(gap < rho, eta * (1.0 / gap - 1.0 / rho) / gap**2, 0.0)
