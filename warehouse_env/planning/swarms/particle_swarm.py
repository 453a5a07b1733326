"""Particle swarm over way-points: a baseline of paper 003."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from warehouse_env.planning.swarms.waypoints import Code, Paths, WaypointSwarm


@dataclass(frozen=True)
class ParticleSwarm(WaypointSwarm):
    """Particle swarm optimisation (Kennedy & Eberhart 1995) with falling inertia (Shi & Eberhart 1998).

    x is a code of K way-points (waypoints.py), its cost the length of the path that it decodes to. Each iteration
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
