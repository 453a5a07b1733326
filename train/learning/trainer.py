"""What `run_training` and the benchmarks need to know of a training algorithm, and what all trainers share."""

import dataclasses
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from agents import policy_tensors, weights_of
from agents.networks import ActorCritic, begin_with, first_actor_critic, tensors_of
from agents.weights_folder import Network, read_record
from train.learning import checkpoint
from train.learning.config import ThreadedConfig
from train.learning.progress import TrainingTally, figures_of
from warehouse_env.config import EnvConfig
from warehouse_env.observation import observation_layout
from warehouse_env.threads import MOST_THREADS, set_num_threads

PARTS = ("simulator_s", "policy_s", "update_s")

Tensors = dict[str, NDArray[np.float32]]
"""The tensors of a policy by their names in a weights folder."""


class Split:
    """Seconds spent in each of PARTS; "policy_s": the rollouts' forward passes (a GPU's count as "simulator_s")."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(PARTS, 0.0)

    @contextmanager
    def measure(self, part: str) -> Iterator[None]:
        """Add the time of the block to `part`."""
        begun = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[part] += time.perf_counter() - begun


def set_threads(threads: int) -> None:
    """Use this many threads in torch and in the simulator, as far as the machine allows, from the calling thread."""
    torch.set_num_threads(threads)
    set_num_threads(min(threads, MOST_THREADS))


class Trainer(ABC):
    """One algorithm: all that `run_training` needs to know of it."""

    env: EnvConfig  # what the policy needs of an environment
    network: Network
    rows: int  # robots stepped at a time
    rollout: int  # decisions of each between two updates
    net: torch.nn.Module  # that learns
    names: dict[str, str]  # of its tensors, by their names in a weights folder
    optimizer: torch.optim.Optimizer
    split: Split  # where the time went so far
    tallies: list[TrainingTally]  # of all worlds

    @abstractmethod
    def update(self, number: int, spent: float) -> dict[str, float]:
        """Collect one rollout and learn from it; return losses and such, for the log.

        number: updates done before; all chance of this update follows from it and the seed. spent: share of the budget
        used, 0 to 1; the schedules follow it.
        """

    @abstractmethod
    def close(self) -> None:
        """End its threads and worlds."""

    def take_figures(self) -> dict[str, float]:
        """Return what happened in the worlds since the last call: reward, goals and collisions."""
        return figures_of(self.tallies, self.env.time_step * self.env.action_repeat)

    def policy_tensors(self) -> Tensors:
        """Return the tensors of the current policy, for a weights folder."""
        found = tensors_of(self.net)
        return {ours: found[theirs] for ours, theirs in self.names.items()}

    def load_policy(self, tensors: Tensors) -> None:
        """Put back what `policy_tensors` returned."""
        found = {theirs: torch.from_numpy(tensors[ours].copy()) for ours, theirs in self.names.items()}
        self.net.load_state_dict(found)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all that `load` needs to go on."""
        network = {f"network.{name}": array for name, array in self.policy_tensors().items()}
        return {**network, **checkpoint.optimizer_arrays(self.optimizer)}

    def load(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Put back what `arrays` returned; the config is the same."""
        self.load_policy(checkpoint.part_of(arrays, "network."))
        checkpoint.load_optimizer(self.optimizer, arrays)


def rng_of(seed: list[int], device: str | None) -> np.random.Generator | torch.Generator:
    """Return NumPy's generator, or torch's on a device."""
    if device is None:
        return np.random.default_rng(seed)
    return torch.Generator(device).manual_seed(int(np.random.SeedSequence(seed).generate_state(1, np.uint64)[0]))


def shuffled(count: int, rng: np.random.Generator | torch.Generator) -> torch.Tensor:
    """Return 0 to count - 1 in random order, where the generator is."""
    if isinstance(rng, torch.Generator):
        return torch.randperm(count, generator=rng, device=rng.device)
    return torch.from_numpy(rng.permutation(count))


def first_net(config: ThreadedConfig, env: EnvConfig) -> ActorCritic:
    """Return the network that a training begins with; ConfigError or WeightsError if its `start` does not fit."""
    net = first_actor_critic(network_of(env, config.hidden), env, config.cruise_bias)
    if config.start is not None and config.resume is None:
        seen = config.driven(env)
        if read_record(weights_of(config.start)).env.sensor.extra is None:
            seen = seen.replace(sensor=dataclasses.replace(seen.sensor, extra=None))
        begin_with(net, policy_tensors(config.start, seen))
    return net


def network_of(env: EnvConfig, hidden: tuple[int, ...]) -> Network:
    """Return the sizes of the networks for one robot."""
    discrete = env.action_type == "discrete"
    actions = len(env.speed_levels) * len(env.lateral_offsets) if discrete else 2
    return Network(observation_layout(env).size, actions, discrete, hidden)


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
