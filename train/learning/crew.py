"""The workers of our own trainers, run by threads here or by processes on other machines (actors.py).

Each worker has its own worlds, plays its own rollout and computes the gradient of its own rows. Observations stay with
the worker: the network goes to it; advantages, targets and gradients come back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.networks import ActorCritic
from agents.weights_folder import Network
from train.learning.config import ThreadedConfig
from train.learning.experience import Rollout, RolloutWorker
from train.learning.timing import Split, set_threads
from train.learning.trainer import network_of
from train.learning.worlds import Counts
from warehouse_env.config import EnvConfig, RewardWeights

T = TypeVar("T")

ActorLoss = Callable[[Tensor, Tensor, Tensor], tuple[Tensor, Tensor]]
"""Returns the loss whose gradient drives the actor, and the share of rows that it holds back.

Its arguments are float32[M]: log pi(a | o) as the policy stands and as it was when the action was drawn, and the
advantage scaled to mean 0 and deviation 1. It can be pickled.
"""


class Facts(NamedTuple):
    """What a trainer needs to know of a worker."""

    rows: int  # robots stepped at a time
    env: EnvConfig
    network: Network


class Judged(NamedTuple):
    """What a trainer needs to know of a rollout; rows are T x R."""

    advantage: NDArray[np.float32]  # [T * R]
    target: NDArray[np.float32]  # [T * R]


class Gradient(NamedTuple):
    """The mean over some rows of one rollout."""

    slopes: NDArray[np.float32]  # [P], of all parameters in their order
    figures: NDArray[np.float32]  # [4]: losses of actor and critic, entropy, share of rows held back


class Worker:
    """Worlds, the last rollout and its gradients; `net` is the policy and critic to use, which a crew sets."""

    net: ActorCritic

    def __init__(self, config: ThreadedConfig, number: int, actor_loss: ActorLoss) -> None:
        """Make the worlds of the worker of this number."""
        self._rollouts = RolloutWorker(config, config.rollout, config.shares()[number], number)
        self.worlds = self._rollouts.worlds
        first = self.worlds.simulators[0]
        self._facts = Facts(self._rollouts.rows, first.config, network_of(first, config.hidden))
        self._actor_loss = actor_loss
        self._rollout: Rollout

    def facts(self) -> Facts:
        """Return what the trainer needs to know."""
        return self._facts

    def split(self) -> Split:
        """Return where the time of the rollouts went."""
        return self._rollouts.split

    def collect(self, weights: RewardWeights, seed: list[int]) -> Judged:
        """Play one rollout (see `RolloutWorker.collect`), which the next one replaces."""
        self._rollout = self._rollouts.collect(self.net, weights, seed)
        return Judged(self._rollout.advantage.numpy(), self._rollout.target.numpy())

    def gradient(self, rows: NDArray[np.int64], scale: tuple[float, float], entropy_weight: float) -> Gradient:
        """Return the gradient of some rows of the last rollout; scale: mean and deviation of all advantages."""
        rollout, chosen = self._rollout, torch.tensor(rows)
        observation = rollout.observation[chosen]
        log_probability, entropy = self.net.log_probability(observation, rollout.action[chosen])
        advantage = (rollout.advantage[chosen] - scale[0]) / scale[1]
        actor_loss, held = self._actor_loss(log_probability, rollout.log_probability[chosen], advantage)
        critic_loss = 0.5 * (self.net.value(observation) - rollout.target[chosen]).square().mean()
        mean_entropy = entropy.mean()
        loss = actor_loss - entropy_weight * mean_entropy + critic_loss
        slopes = torch.cat([slope.flatten() for slope in torch.autograd.grad(loss, list(self.net.parameters()))])
        figures = torch.stack([actor_loss, critic_loss, mean_entropy, held]).detach()
        return Gradient(slopes.numpy(), figures.numpy())

    def take_counts(self) -> Counts:
        """Return what happened in the worlds since the last call."""
        return self.worlds.tally.take()

    def history(self) -> dict[str, NDArray[Any]]:
        """Return what `replay` needs."""
        return self.worlds.history()

    def replay(self, history: dict[str, NDArray[Any]]) -> None:
        """Bring the worlds, just made, to the state in which `history` was taken."""
        self.worlds.replay(history)


class Crew(Protocol):
    """All workers of a training, numbered from 0, and where they run."""

    def share(self, net: ActorCritic) -> None:
        """Let all workers use the network as it is at the next `each`."""
        ...

    def each(self, work: Callable[..., T], arguments: Sequence[tuple[Any, ...]]) -> list[T]:
        """Return `work(worker, *arguments[number])` for every worker, done side by side.

        work: a method of Worker. LostError if a worker is gone; the crew is useless then.
        """
        ...

    def close(self) -> None:
        """End what the workers run in."""
        ...


CrewMaker = Callable[[ThreadedConfig, ActorLoss], Crew]
"""Makes `threads` workers, as the config says."""


class Threads:
    """Workers that run in threads of this process and use one network."""

    def __init__(self, config: ThreadedConfig, actor_loss: ActorLoss) -> None:
        """Make the workers."""
        self._workers = [Worker(config, number, actor_loss) for number in range(config.threads)]
        self._pool = ThreadPoolExecutor(config.threads, initializer=set_threads, initargs=(1,))

    def share(self, net: ActorCritic) -> None:
        """Let all workers use this very network (see `Crew.share`)."""
        for worker in self._workers:
            worker.net = net

    def each(self, work: Callable[..., T], arguments: Sequence[tuple[Any, ...]]) -> list[T]:
        """Do a piece of work, one thread per worker (see `Crew.each`)."""
        return list(self._pool.map(lambda worker, given: work(worker, *given), self._workers, arguments))

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown()
