"""`orca`: optimal reciprocal collision avoidance for discs, by the library pyrvo."""

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.policy import Action, Observation
from agents.route_command import Floats, RouteCommand, Surroundings
from warehouse_env.config import EnvConfig
from warehouse_env.errors import WarehouseError


@dataclass(frozen=True)
class Reciprocity:
    """The numbers of ORCA, tuned on trial seeds."""

    radius: float = 0.54  # [m] of the disc, which holds the body; two do not fit into an aisle of 2 m
    horizon: float = 2.0  # [s] for which the new velocity must be free of collisions
    look: float = 2.0  # [m] along the route to where the preferred velocity points


def load_pyrvo() -> Any:
    """Import and return pyrvo; raises WarehouseError where it is not installed."""
    try:
        return importlib.import_module("pyrvo")
    except ImportError as error:
        raise WarehouseError("orca needs the package 'pyrvo'; pip install \"warehouse-env[orca]\"") from error


class Reciprocal:
    """Each robot solves ORCA's linear program over its own observation: one disc for itself, one a neighbour.

    Source: van den Berg, Guy, Lin, Manocha 2011, "Reciprocal n-body collision avoidance", as the library RVO2 does it.
    Adapted: a disc about the body's centre stands for the rectangle; the preferred velocity is the cruise speed towards
    a route point ahead; the new velocity is tracked as a (speed, offset) command by the body, which cannot move
    sideways; shelves are left to the path follower below, which takes no command that would touch one.
    """

    def __init__(self, config: EnvConfig, numbers: Reciprocity = Reciprocity()) -> None:
        self._library = load_pyrvo()
        self._command, self._numbers = RouteCommand(config), numbers
        self._surroundings = Surroundings(config, "route", "neighbours")
        self._period = config.time_step * config.action_repeat
        self._range = config.sensor.lidar_range
        self._most = config.sensor.neighbours

    def act(self, observation: Observation, rng: np.random.Generator) -> Action:
        """Return the command nearest to ORCA's velocity for every row; draws nothing (shapes: `Policy.act`)."""
        way = self._surroundings.towards_route(observation, self._numbers.look)
        new = self.velocity(observation)
        along = new[..., 0] * way[..., 0] + new[..., 1] * way[..., 1]
        across = new[..., 1] * way[..., 0] - new[..., 0] * way[..., 1]  # for a second
        return self._command.beside(observation, along, across)

    def velocity(self, observation: Observation) -> Floats:
        """Return ORCA's velocity in the own frame [m/s], float64[..., 2]."""
        wanted = self._command.cruise_speed * self._surroundings.towards_route(observation, self._numbers.look)
        near, speed = self._surroundings.neighbours(observation), self._surroundings.speed(observation)
        others = np.stack([near.x, near.y, near.vx + speed[..., None], near.vy], axis=-1)
        others, present = others.reshape(-1, self._most, 4), near.present.reshape(-1, self._most)
        rows = zip(wanted.reshape(-1, 2).tolist(), speed.ravel().tolist(), others, present, strict=True)
        return np.array([self._solve(*row) for row in rows]).reshape(wanted.shape)

    def _solve(self, wanted: list[float], speed: float, others: Floats, present: NDArray[np.bool_]) -> Sequence[float]:
        """Return the own new velocity [m/s]; others: float64[K, 4], where (x, y) and how fast (x, y) they move."""
        if not present.any():
            return wanted
        horizon, radius, speed_limit = self._numbers.horizon, self._numbers.radius, self._command.cruise_speed
        reach = self._range + 1.0
        sizes = (self._period, reach, self._most, horizon, horizon, radius, speed_limit)
        simulator = self._library.RVOSimulator(*sizes)
        simulator.add_agent((0.0, 0.0))
        simulator.set_agent_velocity(0, (speed, 0.0))
        simulator.set_agent_pref_velocity(0, tuple(wanted))
        for x, y, vx, vy in others[present].tolist():  # they look at nobody: their own programs are theirs to solve
            simulator.add_agent((x, y), reach, 0, 1.0, 1.0, radius, speed_limit, (vx, vy))
        simulator.do_step()
        new = simulator.get_agent_velocity(0)
        return new.x, new.y
