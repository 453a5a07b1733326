"""Disturbances: other bodies, worse sensors, lost messages, a robot that breaks down, people.

Bodies, speeds, messages, errors and people are fields of EnvConfig. Lidar and delay disturb only what the policy
observes: the path follower, the shield and right of way know a robot's own state exactly and at once. Latency affects
only the shield. A new disturbance is a line in DISTURBANCES.
"""

import itertools
import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.policy import Observation
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.observation import observation_layout
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.traffic_spec import ErrorBounds, UncertaintySpec

NARROW = 3  # [cells] between two shelves up to which it is an aisle
UNDISTURBED = "none"
_SENSES, _BREAKDOWN = 3, 4  # streams of a seed, apart from the world's, the policy's and the scenes'


@dataclass(frozen=True)
class Disturbance:
    """The fields of EnvConfig that a disturbance sets, and what else it does."""

    summary: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    range_noise: float = 0.0  # [m], standard deviation of every range that lidar measures
    dropout: float = 0.0  # share of the rays that read "nothing there"
    delay: float = 0.0  # [s], age of the whole observation
    breakdown: float | None = None  # [s] after which one robot of each world breaks down in an aisle

    def config(self, config: EnvConfig) -> EnvConfig:
        """Return a policy's config with the changes; the fastest command follows a changed maximum speed."""
        changed = config.replace(**self.changes)
        most, fastest = changed.robot.max_speed, max(config.speed_levels)
        if most == config.robot.max_speed:
            return changed
        return changed.replace(speed_levels=tuple(most if v == fastest else v for v in config.speed_levels))

    @property
    def strengths(self) -> dict[str, float]:
        """What it does besides the changes, in JSON types."""
        return {name: getattr(self, name) for name in ("range_noise", "dropout", "delay", "breakdown")}


def body(length: float, front_steered: bool = False) -> RobotSpec:
    """Return a robot of another length [m] with axles in proportion; front_steered: the same body turned round."""
    usual = RobotSpec()
    scale = length / usual.length
    overhang = scale * (usual.rear_reach if front_steered else usual.front_overhang)
    return RobotSpec(length=length, wheelbase=scale * usual.wheelbase, front_overhang=overhang)


def _uncertain(summary: str, **uncertainty: Any) -> Disturbance:
    return Disturbance(summary, {"uncertainty": UncertaintySpec(**uncertainty)})


# Errors of poses and actuators as localisation by lidar and worn drives have them.
ERRORS: dict[str, Any] = {"pose_error": 0.02, "heading_error": math.radians(1.0), "actuation_error": 0.05}
LATE = 0.3  # [s]

DISTURBANCES: dict[str, Disturbance] = {
    UNDISTURBED: Disturbance("undisturbed"),
    "short": Disturbance("body 0.7 m long", {"robot": body(0.7)}),
    "long": Disturbance("body 1.2 m long", {"robot": body(1.2)}),
    "front_steered": Disturbance("front-steered, 0.9 m", {"robot": body(0.9, front_steered=True)}),
    "front_steered_long": Disturbance("front-steered, 1.2 m", {"robot": body(1.2, front_steered=True)}),
    "slow": Disturbance("at most 0.8 m/s", {"robot": RobotSpec(max_speed=0.8)}),
    "fast": Disturbance("at most 2.0 m/s", {"robot": RobotSpec(max_speed=2.0)}),
    "sluggish": Disturbance("brakes at 0.5 m/s^2", {"robot": RobotSpec(max_acceleration=0.5)}),
    "range_noise": Disturbance("lidar noise 3 cm", range_noise=0.03),
    "dropout": Disturbance("rays lost, 5%", dropout=0.05),
    "much_dropout": Disturbance("rays lost, 20%", dropout=0.2),
    "delay": Disturbance("seen 0.2 s late", delay=0.2),
    "long_delay": Disturbance("seen 0.6 s late", delay=0.6),
    "message_loss": _uncertain("messages lost, 10%", loss=0.1),
    "much_message_loss": _uncertain("messages lost, 30%", loss=0.3),
    "message_bursts": _uncertain("lost for 5 s, 10%", loss=0.1, burst=5.0),
    "latency": _uncertain("heard 0.3 s late", latency=LATE),
    "errors": _uncertain("off 2 cm, 1 deg, drives 5%", **ERRORS),
    "undeclared_errors": _uncertain("the same, not declared", **ERRORS, declared=ErrorBounds()),
    "all_at_once": _uncertain("lost, late and off", loss=0.1, burst=5.0, latency=LATE, **ERRORS),
    "breakdown": Disturbance("one broken down", breakdown=60.0),
    "people": Disturbance("4 people walk", {"people": 4}),
    "many_people": Disturbance("12 people walk", {"people": 12}),
}


class Senses:
    """The disturbed sensors of one world's robots, with a random stream of their own."""

    def __init__(self, disturbance: Disturbance, config: EnvConfig, seed: int) -> None:
        self._disturbance = disturbance
        self._lidar = observation_layout(config).slices.get("lidar", slice(0))
        self._nothing = np.float32(1.0) / (np.float32(1.0) + np.float32(config.sensor.lidar_range))
        self._rng = np.random.default_rng([seed, _SENSES])
        late = round(disturbance.delay / (config.time_step * config.action_repeat))  # decisions
        self._seen: deque[Observation] = deque(maxlen=late + 1)

    def see(self, observation: Observation) -> Observation:
        """Return the disturbed observation, float32[..., D]; called once per decision.

        Until a delay has passed, robots see the start.
        """
        noise, dropout = self._disturbance.range_noise, self._disturbance.dropout
        spoiled = observation.copy()  # the simulator writes over its own
        rays = spoiled[..., self._lidar]
        if noise:
            rays[...] = self._noisy(rays, noise)
        if dropout:
            rays[self._rng.random(rays.shape) < dropout] = self._nothing
        self._seen.append(spoiled)
        return self._seen[0]

    def _noisy(self, rays: NDArray[np.float32], noise: float) -> NDArray[np.float32]:
        """Return rays 1 / (1 + d) with noise [m] on the range d; rays without an echo stay so."""
        ranges = 1.0 / rays.astype(np.float64) - 1.0
        off = np.maximum(ranges + noise * self._rng.standard_normal(rays.shape), 0.0)
        measured = np.maximum((1.0 / (1.0 + off)).astype(np.float32), self._nothing)
        return np.where(rays > self._nothing, measured, rays)


def in_aisles(grid: GridMap) -> NDArray[np.bool_]:
    """Return bool[H, W]: free cells between two shelves that are at most NARROW cells apart."""
    free = ~grid.occupied
    found = np.zeros_like(free)
    for cells, aisle in ((free, found), (free.T, found.T)):  # along rows, then along columns
        for line, marked in zip(cells, aisle, strict=True):
            shelves = np.flatnonzero(~line)
            for left, right in itertools.pairwise(shelves.tolist()):
                if 1 < right - left <= NARROW + 1:
                    marked[left + 1 : right] = True
    return found


class Breakdown:
    """A watcher that breaks down one robot of each world: a random one in an aisle, as soon as there is one after
    `after` [s]. Draws from a random stream of its own.
    """

    def __init__(self, after: float, seeds: list[int]) -> None:
        self._after = after
        self._waiting = {world: np.random.default_rng([seed, _BREAKDOWN]) for world, seed in enumerate(seeds)}
        self._aisles: NDArray[np.bool_] | None = None

    def __call__(self, simulator: Simulator, steps: int) -> None:
        """Look for robots in aisles, in the worlds that are due."""
        if self._aisles is None:
            self._aisles = in_aisles(simulator.grid)
        for world in [world for world in self._waiting if simulator.seconds(world) >= self._after]:
            cells = simulator.grid.nearest_cell(simulator.state.pose[world, :, :2])
            inside = np.flatnonzero(self._aisles[cells[:, 0], cells[:, 1]] & (simulator.state.alive[world] != 0))
            if len(inside):
                simulator.break_down(world, int(self._waiting.pop(world).choice(inside)))
