"""REINFORCE over the next action command, with a learned value as baseline; all robots share one policy.

Williams 1992, "Simple statistical gradient-following algorithms": ascend E[A grad log pi(a | o)]. The return is cut
after each rollout and continued by the critic's value; the advantage A is its generalised form (Schulman et al. 2016),
which with gae_lambda = 1 is exactly the truncated return minus the baseline. Every row is used once, so the data are
those of the present policy up to the few gradient steps within one update; no ratio, no clip.

Each thread has its own worlds and plays its own rollout, then computes the gradient of its own rows; the threads meet
only to add the gradients. That is faster than threads within each small operation, and stays so on a busy machine.

    python -m train.reinforce --minutes 10
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.networks import first_actor_critic, tensors_of
from train.learning import checkpoint
from train.learning.config import ReinforceConfig
from train.learning.experience import Rollout, RolloutWorker
from train.learning.timing import Split, set_threads
from train.learning.training_run import network_of, run_training
from train.learning.training_run import profile as profile_trainer
from train.learning.worlds import Counts

T = TypeVar("T")


def policy_loss(log_probability: Tensor, advantage: Tensor, entropy: Tensor, entropy_weight: float) -> Tensor:
    """Return the loss whose gradient is minus that of E[A log pi + weight H], a scalar from float32[M] each."""
    return -(advantage * log_probability).mean() - entropy_weight * entropy.mean()


class Reinforce:
    """The trainer: workers, network and optimizer. One `update` is one rollout and one pass over its rows."""

    algorithm = "reinforce"

    def __init__(self, config: ReinforceConfig) -> None:
        self.config, self.rollout = config, config.rollout
        set_threads(1)  # one for each worker, and the workers are what runs side by side
        torch.manual_seed(config.seed)
        mixes = config.worlds(config.rows / config.threads)
        self.env = mixes[0][0]
        self._workers = [RolloutWorker(config, config.rollout, mixes, number) for number in range(config.threads)]
        self._pool = ThreadPoolExecutor(config.threads, initializer=set_threads, initargs=(1,))
        self.rows = sum(worker.rows for worker in self._workers)
        self.network = network_of(self._workers[0].worlds.simulators[0], config.hidden)
        self.net = first_actor_critic(self.network, self.env, config.cruise_bias)
        self._groups = [self.net.actor_parameters(), list(self.net.critic.parameters())]
        self.optimizer = torch.optim.Adam([{"params": group} for group in self._groups], eps=1e-5)
        self._own = Split()

    @property
    def split(self) -> Split:
        """Where the time went: the workers' mean for the rollouts, which they play side by side."""
        return self._own.with_mean_of([worker.split for worker in self._workers])

    def _each(self, work: Callable[[int], T]) -> list[T]:
        """Run `work(number)` for every worker, each on a thread of its own."""
        return list(self._pool.map(work, range(len(self._workers))))

    def update(self, number: int, spent: float) -> dict[str, float]:
        """Collect one rollout and take one pass of gradient steps over it (see `Trainer.update`)."""
        config = self.config
        weights = config.reward(spent)
        rollouts = self._each(lambda k: self._workers[k].collect(self.net, weights, [config.seed, k, number]))
        with self._own.measure("update_s"):
            step_size = config.step_size(spent)
            for group, factor in zip(self.optimizer.param_groups, (1.0, config.critic_factor), strict=True):
                group["lr"] = factor * step_size
            return self._learn(rollouts, [config.seed, len(rollouts), number], config.entropy(spent))

    def _learn(self, rollouts: list[Rollout], seed: list[int], entropy_weight: float) -> dict[str, float]:
        scale = joint_scale([rollout.advantage for rollout in rollouts])
        pieces = max(1, round(self.rows * self.rollout / self.config.minibatch))
        rng = np.random.default_rng(seed)
        orders = [torch.from_numpy(rng.permutation(len(rollout.target))).tensor_split(pieces) for rollout in rollouts]
        totals = torch.zeros(4)
        for piece in range(pieces):
            parts = self._each(lambda k, i=piece: self._gradient(rollouts[k], orders[k][i], scale, entropy_weight))  # type: ignore[misc]
            for index, parameter in enumerate(self.net.parameters()):
                parameter.grad = torch.stack([gradient[index] for gradient, _ in parts]).mean(0)
            norm, _ = [torch.nn.utils.clip_grad_norm_(group, self.config.gradient_clip) for group in self._groups]
            self.optimizer.step()
            totals[:3] += torch.stack([figures for _, figures in parts]).mean(0) / pieces
            totals[3] += norm / pieces
        target = torch.cat([rollout.target for rollout in rollouts])
        explained = 1.0 - (2.0 * totals[1] / target.var()).item()
        names = ("actor_loss", "critic_loss", "entropy", "gradient_norm")
        return {**dict(zip(names, totals.tolist(), strict=True)), "explained_variance": explained}

    def _gradient(
        self, rollout: Rollout, rows: Tensor, scale: tuple[float, float], entropy_weight: float
    ) -> tuple[tuple[Tensor, ...], Tensor]:
        """Return the gradient of some rows of one rollout, and (actor loss, critic loss, entropy)."""
        observation = rollout.observation[rows]
        log_probability, entropy = self.net.log_probability(observation, rollout.action[rows])
        advantage = (rollout.advantage[rows] - scale[0]) / scale[1]
        actor_loss = policy_loss(log_probability, advantage, entropy, entropy_weight)
        critic_loss = 0.5 * (self.net.value(observation) - rollout.target[rows]).square().mean()
        gradient = torch.autograd.grad(actor_loss + critic_loss, list(self.net.parameters()))
        return gradient, torch.stack([actor_loss, critic_loss, entropy.mean()]).detach()

    def take_figures(self) -> dict[str, float]:
        """Return what happened since the last call (see `Trainer.take_figures`)."""
        counts = sum((worker.worlds.tally.take() for worker in self._workers), Counts())
        return counts.figures(self.env.time_step * self.env.action_repeat)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return network, optimizer and the worlds' histories (see `Trainer.arrays`)."""
        network = {f"network.{name}": array for name, array in self.policy_tensors().items()}
        worlds = {
            f"worlds.{number}.{name}": array
            for number, worker in enumerate(self._workers)
            for name, array in worker.worlds.history().items()
        }
        return {**network, **checkpoint.optimizer_arrays(self.optimizer), **worlds}

    def load(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Put back what `arrays` returned; the worlds replay their last actions."""
        network = checkpoint.part_of(arrays, "network.")
        self.net.load_state_dict({name: torch.from_numpy(array.copy()) for name, array in network.items()})
        checkpoint.load_optimizer(self.optimizer, arrays)
        self._each(lambda k: self._workers[k].worlds.replay(checkpoint.part_of(arrays, f"worlds.{k}.")))

    def policy_tensors(self) -> dict[str, NDArray[np.float32]]:
        """Return the network's tensors (see `Trainer.policy_tensors`)."""
        return tensors_of(self.net)


def joint_scale(advantage: list[Tensor]) -> tuple[float, float]:
    """Return the mean and standard deviation of all advantages together."""
    joined = torch.cat(advantage)
    return float(joined.mean()), float(joined.std()) + 1e-8


def train(config: ReinforceConfig) -> Path:
    """Train by `config`; return the run's folder, a policy folder (errors: `run_training`)."""
    return run_training(config, Reinforce.algorithm, Reinforce)


def profile(config: ReinforceConfig, updates: int = 10) -> dict[str, float]:
    """Measure some updates without writing anything (see `training_run.profile`)."""
    return profile_trainer(Reinforce(config), updates)


if __name__ == "__main__":
    import sys

    from train.cli import main

    sys.exit(main(["train", "reinforce", *sys.argv[1:]]))
