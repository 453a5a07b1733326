"""A policy-gradient trainer whose threads each have worlds of their own: REINFORCE and our PPO differ in their loss.

Each thread plays its own rollout, then computes the gradient of its own rows; the threads meet only to add the
gradients. That is faster than threads within each small operation, and stays so on a busy machine.

The return is cut after each rollout and continued by the critic's value; the advantage A is its generalised form
(Schulman et al. 2016), which with gae_lambda = 1 is exactly the truncated return minus the baseline.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.networks import first_actor_critic, tensors_of
from train.learning import checkpoint
from train.learning.config import ThreadedConfig
from train.learning.experience import Rollout, RolloutWorker
from train.learning.timing import Split, set_threads
from train.learning.training_run import network_of
from train.learning.worlds import Counts

T = TypeVar("T")
FIGURES = ("actor_loss", "critic_loss", "entropy", "clip_fraction", "gradient_norm")


class ThreadedTrainer:
    """Workers, network and optimizer. One `update` is one rollout and `epochs` passes over its rows."""

    algorithm: str
    epochs = 1

    def __init__(self, config: ThreadedConfig) -> None:
        self.config, self.rollout = config, config.rollout
        set_threads(1)
        torch.manual_seed(config.seed)
        self._workers = [
            RolloutWorker(config, config.rollout, mixes, number) for number, mixes in enumerate(config.shares())
        ]
        self._pool = ThreadPoolExecutor(config.threads, initializer=set_threads, initargs=(1,))
        self.rows = sum(worker.rows for worker in self._workers)
        first = self._workers[0].worlds.simulators[0]
        self.env = first.config
        self.network = network_of(first, config.hidden)
        self.net = first_actor_critic(self.network, self.env, config.cruise_bias)
        self._groups = [self.net.actor_parameters(), list(self.net.critic.parameters())]
        self.optimizer = torch.optim.Adam([{"params": group} for group in self._groups], eps=1e-5)
        self._own = Split()

    def actor_loss(self, log_probability: Tensor, old: Tensor, advantage: Tensor) -> tuple[Tensor, Tensor]:
        """Return the loss whose gradient drives the actor, and the share of rows that it holds back.

        All are float32[M]: log pi(a | o) as the policy stands and as it was when the action was drawn, and the
        advantage scaled to mean 0 and deviation 1.
        """
        raise NotImplementedError

    @property
    def split(self) -> Split:
        """Where the time went: the workers' mean for the rollouts, which they play side by side."""
        return self._own.with_mean_of([worker.split for worker in self._workers])

    def _each(self, work: Callable[[int], T]) -> list[T]:
        """Run `work(number)` for every worker, each on a thread of its own."""
        return list(self._pool.map(work, range(len(self._workers))))

    def update(self, number: int, spent: float) -> dict[str, float]:
        """Collect one rollout and take the passes of gradient steps over it (see `Trainer.update`)."""
        config = self.config
        set_threads(1)  # one for each worker, and the workers are what runs side by side
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
        totals = torch.zeros(len(FIGURES))
        for _ in range(self.epochs):
            orders = [torch.from_numpy(rng.permutation(len(one.target))).tensor_split(pieces) for one in rollouts]
            for piece in range(pieces):
                rows = [order[piece] for order in orders]
                totals += self._descend(rollouts, rows, scale, entropy_weight)
        target = torch.cat([rollout.target for rollout in rollouts])
        figures = dict(zip(FIGURES, (totals / (self.epochs * pieces)).tolist(), strict=True))
        return {**figures, "explained_variance": 1.0 - 2.0 * figures["critic_loss"] / target.var().item()}

    def _descend(
        self, rollouts: list[Rollout], rows: list[Tensor], scale: tuple[float, float], entropy_weight: float
    ) -> Tensor:
        """Take one gradient step by some rows of each rollout; return FIGURES."""
        parts = self._each(lambda k: self._gradient(rollouts[k], rows[k], scale, entropy_weight))
        for index, parameter in enumerate(self.net.parameters()):
            parameter.grad = torch.stack([gradient[index] for gradient, _ in parts]).mean(0)
        norm, _ = [torch.nn.utils.clip_grad_norm_(group, self.config.gradient_clip) for group in self._groups]
        self.optimizer.step()
        return torch.cat([torch.stack([figures for _, figures in parts]).mean(0), norm[None]])

    def _gradient(
        self, rollout: Rollout, rows: Tensor, scale: tuple[float, float], entropy_weight: float
    ) -> tuple[tuple[Tensor, ...], Tensor]:
        """Return the gradient of some rows of one rollout, and the first of FIGURES."""
        observation = rollout.observation[rows]
        log_probability, entropy = self.net.log_probability(observation, rollout.action[rows])
        advantage = (rollout.advantage[rows] - scale[0]) / scale[1]
        actor_loss, held = self.actor_loss(log_probability, rollout.log_probability[rows], advantage)
        critic_loss = 0.5 * (self.net.value(observation) - rollout.target[rows]).square().mean()
        mean_entropy = entropy.mean()
        loss = actor_loss - entropy_weight * mean_entropy + critic_loss
        gradient = torch.autograd.grad(loss, list(self.net.parameters()))
        return gradient, torch.stack([actor_loss, critic_loss, mean_entropy, held]).detach()

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
