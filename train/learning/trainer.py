"""What `run_training` and the benchmarks need to know of a training algorithm."""

from __future__ import annotations

import time
from typing import Any, Protocol

import gymnasium
import numpy as np
from numpy.typing import NDArray

from agents.weights_folder import Network
from train.learning.timing import Split
from warehouse_env.config import EnvConfig
from warehouse_env.simulation.simulator import Simulator


class Trainer(Protocol):
    """One algorithm: all that `run_training` needs to know of it."""

    algorithm: str
    env: EnvConfig  # what the policy needs of an environment
    network: Network
    rows: int  # robots stepped at a time
    rollout: int  # decisions of each between two updates

    @property
    def split(self) -> Split:
        """Where the time went so far."""
        ...

    def update(self, number: int, spent: float) -> dict[str, float]:
        """Collect one rollout and learn from it; return losses and such, for the log.

        number: updates done before; all chance of this update follows from it and the seed. spent: share of the budget
        used, 0 to 1; the schedules follow it.
        """
        ...

    def take_figures(self) -> dict[str, float]:
        """Return what happened in the worlds since the last call: reward, goals and collisions."""
        ...

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all that `load` needs to go on."""
        ...

    def load(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Put back what `arrays` returned; the config is the same."""
        ...

    def policy_tensors(self) -> dict[str, NDArray[np.float32]]:
        """Return the tensors of the current policy, for a weights folder."""
        ...

    def close(self) -> None:
        """End its threads and processes."""
        ...


def network_of(simulator: Simulator, hidden: tuple[int, ...]) -> Network:
    """Return the sizes of the networks for one robot of `simulator`."""
    space = simulator.action_space
    discrete = isinstance(space, gymnasium.spaces.Discrete)
    actions = int(space.n) if isinstance(space, gymnasium.spaces.Discrete) else (space.shape or (0,))[0]
    return Network(simulator.layout.size, actions, discrete, hidden)


def profile(trainer: Trainer, updates: int, warm_up: int = 1) -> dict[str, float]:
    """Run some updates without writing anything; return where the time went.

    Keys: "simulator_s", "policy_s", "update_s", "seconds" (all), "steps" (agent-steps) and "steps_per_second".
    """
    for number in range(warm_up):
        trainer.update(number, 0.0)
    before, begun = dict(trainer.split.seconds), time.perf_counter()
    for number in range(warm_up, warm_up + updates):
        trainer.update(number, 0.0)
    seconds = time.perf_counter() - begun
    steps = updates * trainer.rows * trainer.rollout
    parts = {part: trainer.split.seconds[part] - before[part] for part in before}
    return {**parts, "seconds": seconds, "steps": float(steps), "steps_per_second": steps / seconds}
