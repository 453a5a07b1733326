"""The policy-gradient trainer behind REINFORCE and our PPO, which differ in their loss.

Each worker, on its own thread or machine, plays its own rollout and computes the gradient of its own rows. Workers meet
only to add the gradients, in order. That is faster than threads within each small operation, also on a busy machine.

The critic's value continues the return after each rollout. The advantage A is the generalised one (Schulman et al.
2016); with gae_lambda = 1 it is exactly the truncated return minus the baseline.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.networks import first_actor_critic, tensors_of
from train.learning import checkpoint
from train.learning.config import ThreadedConfig
from train.learning.crew import ActorLoss, CrewMaker, Judged, Worker
from train.learning.timing import Split, set_threads
from train.learning.worlds import Counts

FIGURES = ("actor_loss", "critic_loss", "entropy", "clip_fraction", "gradient_norm")


class ThreadedTrainer:
    """Workers, network and optimizer. One `update` is one rollout and `epochs` passes over its rows."""

    algorithm: str
    epochs = 1

    def __init__(self, config: ThreadedConfig, actor_loss: ActorLoss, crew: CrewMaker) -> None:
        self.config, self.rollout = config, config.rollout
        set_threads(1)
        self._crew = crew(config, actor_loss)
        self._nothing: list[tuple[()]] = [()] * config.threads
        facts = self._crew.each(Worker.facts, self._nothing)
        self.rows = sum(one.rows for one in facts)
        _, self.env, self.network = facts[0]
        torch.manual_seed(config.seed)
        self.net = first_actor_critic(self.network, self.env, config.cruise_bias)
        self._sizes = [parameter.numel() for parameter in self.net.parameters()]
        self._groups = [self.net.actor_parameters(), list(self.net.critic.parameters())]
        self.optimizer = torch.optim.Adam([{"params": group} for group in self._groups], eps=1e-5)
        self._own = Split()

    @property
    def split(self) -> Split:
        """Where the time went: the workers' mean for the rollouts, which they play side by side."""
        return self._own.with_mean_of(self._crew.each(Worker.split, self._nothing))

    def update(self, number: int, spent: float) -> dict[str, float]:
        """Collect one rollout and take the passes of gradient steps over it (see `Trainer.update`)."""
        config = self.config
        set_threads(1)  # one for each worker, and the workers are what runs side by side
        weights = config.reward(spent)
        self._crew.share(self.net)
        seeds = [[config.seed, k, number] for k in range(config.threads)]
        rollouts = self._crew.each(Worker.collect, [(weights, seed) for seed in seeds])
        with self._own.measure("update_s"):
            step_size = config.step_size(spent)
            for group, factor in zip(self.optimizer.param_groups, (1.0, config.critic_factor), strict=True):
                group["lr"] = factor * step_size
            return self._learn(rollouts, [config.seed, len(rollouts), number], config.entropy(spent))

    def _learn(self, rollouts: list[Judged], seed: list[int], entropy_weight: float) -> dict[str, float]:
        scale = joint_scale([torch.tensor(rollout.advantage) for rollout in rollouts])
        pieces = max(1, round(self.rows * self.rollout / self.config.minibatch))
        rng = np.random.default_rng(seed)
        totals = torch.zeros(len(FIGURES))
        for _ in range(self.epochs):
            orders = [np.array_split(rng.permutation(len(one.target)), pieces) for one in rollouts]
            for piece in range(pieces):
                totals += self._descend([(order[piece], scale, entropy_weight) for order in orders])
        target = torch.cat([torch.tensor(rollout.target) for rollout in rollouts])
        figures = dict(zip(FIGURES, (totals / (self.epochs * pieces)).tolist(), strict=True))
        return {**figures, "explained_variance": 1.0 - 2.0 * figures["critic_loss"] / target.var().item()}

    def _descend(self, chosen: list[tuple[NDArray[np.int64], tuple[float, float], float]]) -> Tensor:
        """Take one gradient step by what each worker is given for `Worker.gradient`; return FIGURES."""
        self._crew.share(self.net)
        parts = self._crew.each(Worker.gradient, chosen)
        slopes = torch.split(torch.from_numpy(np.stack([part.slopes for part in parts])), self._sizes, dim=1)
        for parameter, own in zip(self.net.parameters(), slopes, strict=True):
            parameter.grad = own.contiguous().mean(0).view_as(parameter)
        norm, _ = [torch.nn.utils.clip_grad_norm_(group, self.config.gradient_clip) for group in self._groups]
        self.optimizer.step()
        return torch.cat([torch.from_numpy(np.stack([part.figures for part in parts])).mean(0), norm[None]])

    def take_figures(self) -> dict[str, float]:
        """Return what happened since the last call (see `Trainer.take_figures`)."""
        counts = sum(self._crew.each(Worker.take_counts, self._nothing), Counts())
        return counts.figures(self.env.time_step * self.env.action_repeat)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return network, optimizer and the worlds' histories (see `Trainer.arrays`)."""
        network = {f"network.{name}": array for name, array in self.policy_tensors().items()}
        worlds = {
            f"worlds.{number}.{name}": array
            for number, history in enumerate(self._crew.each(Worker.history, self._nothing))
            for name, array in history.items()
        }
        return {**network, **checkpoint.optimizer_arrays(self.optimizer), **worlds}

    def load(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Put back what `arrays` returned; the worlds replay their last actions."""
        network = checkpoint.part_of(arrays, "network.")
        self.net.load_state_dict({name: torch.from_numpy(array.copy()) for name, array in network.items()})
        checkpoint.load_optimizer(self.optimizer, arrays)
        histories = [checkpoint.part_of(arrays, f"worlds.{number}.") for number in range(self.config.threads)]
        self._crew.each(Worker.replay, [(history,) for history in histories])

    def policy_tensors(self) -> dict[str, NDArray[np.float32]]:
        """Return the network's tensors (see `Trainer.policy_tensors`)."""
        return tensors_of(self.net)

    def close(self) -> None:
        """End the workers (see `Trainer.close`)."""
        self._crew.close()


def joint_scale(advantage: list[Tensor]) -> tuple[float, float]:
    """Return the mean and standard deviation of all advantages together."""
    joined = torch.cat(advantage)
    return float(joined.mean()), float(joined.std()) + 1e-8
