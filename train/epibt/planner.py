"""The central planner: it sees all robots of a world and commands the acceleration and steering rate of each."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from train.epibt.inheritance import choose_all, make_choosing
from train.epibt.manoeuvres import Manoeuvres
from train.epibt.sequences import FIRST, STAGE, Scene, braking_steps, make_sequences, programs
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.simulation.simulator import Simulator

NAME, SUMMARY = "epibt", "a central planner: priority inheritance over sequences of motions"
NEEDS: dict[str, Any] = {"action_type": "raw", "traffic": "routes"}  # fields of EnvConfig
# A robot that has stood within a metre for _PATIENCE [s] begins to retreat with probability _CHANCE in each decision.
# For _RETREAT decisions it backs out and chooses first. Then its task counts as new, so that others can push it.
_PATIENCE, _CHANCE, _RETREAT = 12.0, 0.05, 20
_BRAKING = 60  # physics steps from the highest speed to rest, at most


def check_config(config: EnvConfig) -> None:
    """Raise ConfigError for environments that the planner is not made for."""
    for wrong, what in (
        (config.action_type != "raw", "action types other than raw"),
        (config.action_repeat != 1, f"action_repeat={config.action_repeat}"),
        (config.tasks == "one_shot", "one-shot tasks, since robots that park block others"),
        (config.arrival == "pose", "robots that stop at poses"),
        (config.people > 0, "people"),
        (braking_steps(config) > _BRAKING, f"robots that take longer than {_BRAKING * config.time_step:g} s to stop"),
        (config.uncertainty is not None, "latency, losses and errors"),
    ):
        if wrong:
            raise ConfigError(f"{NAME} does not plan for {what}")


def scene_of(simulator: Simulator, world: int, table: NDArray[np.float32]) -> Scene:
    """Return a world as the kernels see it."""
    limits, (shared, kinds), config = simulator.worlds.limits, simulator.setup.planned, simulator.config
    own = (shared if kinds is None else kinds) if limits is None else limits[world]
    params = np.broadcast_to(own, config.num_agents).copy()
    stops = config.arrival != "pass"
    return Scene(simulator.robots[world], simulator.worlds.routes[world], table, params, stops, simulator.setup.floor)


class Epibt:
    """Priority inheritance over sequences of motions along live routes. Robots choose every STAGE physics steps."""

    def __init__(self, config: EnvConfig, worlds: int) -> None:
        """Begin an episode in each world; ConfigError as of `check_config`."""
        check_config(config)
        robots = config.num_agents
        self._table = programs()
        self._sequences = make_sequences(config, len(self._table))
        self._choosing = make_choosing(robots, len(self._table))
        self._manoeuvres = Manoeuvres(worlds, robots)
        self._kept = np.zeros((worlds, *self._sequences.kept.shape), np.float32)
        self._left = np.zeros((worlds, robots), np.int32)
        self._backs = np.zeros((worlds, robots), np.int64)  # decisions for which a robot still retreats
        self._gave_way = np.zeros((worlds, robots), np.int64)  # age of its task when it last retreated [steps]
        most = [(robot.max_acceleration, robot.max_steering_rate) for robot in config.robots]
        self._most = np.array(most, np.float32)
        self._steps = 0  # physics steps so far

    def act(self, simulator: Simulator, generators: Sequence[np.random.Generator]) -> NDArray[np.float32]:
        """Return the raw actions float32[B, N, 2] of all robots; generators: of each world.

        ConfigError on floors with speed limits.
        """
        if simulator.setup.equipment.zones is not None:
            raise ConfigError(f"{NAME} does not plan for zones with a speed limit")
        since = self._steps % STAGE
        if since == 0:
            for world in range(simulator.num_worlds):
                self._draw_retreats(world, simulator.robots[world], generators[world])
                self._decide(simulator, world)
        self._steps += 1
        drives = (since < self._left)[..., None]
        return np.where(drives, self._kept[:, :, since] / self._most, np.float32(0.0))

    def _draw_retreats(self, world: int, robots: NDArray[Any], generator: np.random.Generator) -> None:
        """Let some of the robots ROBOT[N] begin to retreat, and rank all of them."""
        backs, gave_way, age = self._backs[world], self._gave_way[world], robots["task"]["age"]
        drawn = generator.random(robots.shape)
        backs[:] = np.maximum(backs - 1, 0)
        stood = (robots["clocks"]["standing_time"] > _PATIENCE) & (robots["task"]["alive"] != 0)
        backs[(backs == 0) & stood & (drawn < _CHANCE)] = _RETREAT
        gave_way[:] = np.where(backs > 0, age, np.where(age < gave_way, 0, gave_way))  # less: its task is new
        self._sequences.ranks[:] = np.where(backs > 0, FIRST, age - gave_way)

    def _decide(self, simulator: Simulator, world: int) -> None:
        """Let the robots of a world choose their next sequences."""
        kept, left = self._kept[world], self._left[world]
        if self._steps:  # a stage has been driven
            kept[:, :-STAGE], left[:] = kept[:, STAGE:].copy(), np.maximum(left - STAGE, 0)
        left[simulator.robots[world]["task"]["alive"] == 0] = 0
        self._manoeuvres.go_on(simulator, world, self._steps // STAGE)
        sequences = self._sequences._replace(kept=kept, left=left, arc=self._manoeuvres.arc[world])
        choose_all(scene_of(simulator, world, self._table), sequences, self._choosing)
        self._manoeuvres.keep(world, self._choosing.held)
        chosen = np.arange(len(left)), self._choosing.held
        kept[:], left[:] = sequences.controls[chosen], (sequences.counts[chosen] - 1) // simulator.config.substeps
