"""REINFORCE over the next action command, with a learned value as baseline; all robots share one policy.

Williams 1992, "Simple statistical gradient-following algorithms": ascend E[A grad log pi(a | o)]. The return is cut
after each rollout and continued by the critic's value; the advantage A is its generalised form (Schulman et al. 2016),
which with gae_lambda = 1 is exactly the truncated return minus the baseline. Every row is used once, so the data are
those of the present policy up to the few gradient steps within one update; no ratio, no clip.

    python -m train.reinforce --minutes 10
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.networks import ActorCritic, tensors_of
from agents.route_command import cruise_output
from train import checkpoint
from train.config import ReinforceConfig
from train.training_run import Split, network_of, run_training, set_threads
from train.training_run import profile as profile_trainer
from train.worlds import TrainingWorlds


class Rollout(NamedTuple):
    """What one rollout of T decisions of R robots leaves for the update."""

    observation: Tensor  # float32[T, R, D]
    action: Tensor  # int64[T, R] or float32[T, R, 2]
    advantage: Tensor  # float32[T, R]
    target: Tensor  # float32[T, R], of the critic: the return


def advantages(
    reward: NDArray[np.float32], value: NDArray[np.float32], ended: NDArray[np.bool_],
    last_value: NDArray[np.float32], gamma: float, gae_lambda: float,
) -> NDArray[np.float32]:  # fmt: skip
    """Return generalised advantages float32[T, R] (Schulman et al. 2016, eq. 16).

    A_t = d_t + gamma lambda A_{t+1},  d_t = r_t + gamma V(o_{t+1}) - V(o_t); an ended episode cuts the sum.

    Args:
        reward: float32[T, R].
        value: float32[T + 1, R], V(o_t); the last row continues the return.
        ended: bool[T, R], the episode was cut after the step (o_{t+1} is then the first of the next one).
        last_value: float32[T, R], V of the cut episode's last observation, where `ended`.
        gamma, gae_lambda: discount and weight.
    """
    following = np.where(ended, last_value, value[1:])
    delta = reward + np.float32(gamma) * following - value[:-1]
    keep = np.where(ended, np.float32(0), np.float32(gamma * gae_lambda))
    out = np.zeros_like(delta)
    carried = np.zeros_like(delta[0])
    for t in range(len(delta) - 1, -1, -1):
        carried = delta[t] + keep[t] * carried
        out[t] = carried
    return out


def policy_loss(log_probability: Tensor, advantage: Tensor, entropy: Tensor, entropy_weight: float) -> Tensor:
    """Return the loss whose gradient is minus that of E[A log pi + weight H], a scalar from float32[M] each."""
    return -(advantage * log_probability).mean() - entropy_weight * entropy.mean()


class Reinforce:
    """The trainer: worlds, network and optimizer. One `update` is one rollout and one pass over its rows."""

    algorithm = "reinforce"

    def __init__(self, config: ReinforceConfig) -> None:
        self.config, self.split = config, Split()
        torch.manual_seed(config.seed)
        mixes = config.worlds()
        self.env = mixes[0][0]
        with self.split.measure("simulator_s"):
            self.worlds = TrainingWorlds(mixes, config.seed, config.jam_seconds)
        self.tally, self.rows, self.rollout = self.worlds.tally, self.worlds.rows, config.rollout
        self.network = network_of(self.worlds.simulators[0], config.hidden)
        self.net = ActorCritic(self.network, cruise_output(self.env, config.cruise_bias))
        self.optimizer = torch.optim.Adam(self.net.parameters(), lr=config.learning_rate, eps=1e-5, fused=True)
        shape = (config.rollout + 1, self.rows)
        self._observation = np.zeros((*shape, self.network.observation_size), np.float32)
        action_shape = () if self.network.discrete else (self.network.actions,)
        self._action = np.zeros(
            (config.rollout, self.rows, *action_shape), np.int64 if self.network.discrete else np.float32
        )
        self._reward = np.zeros((config.rollout, self.rows), np.float32)
        self._ended = np.zeros((config.rollout, self.rows), np.bool_)
        self._last_value = np.zeros((config.rollout, self.rows), np.float32)

    def update(self, number: int, spent: float) -> dict[str, float]:
        """Collect one rollout and take one pass of gradient steps over it (see `Trainer.update`)."""
        rng = np.random.default_rng([self.config.seed, number])
        self.worlds.set_reward(self.config.reward(spent))
        rollout = self._collect(rng)
        with self.split.measure("update_s"):
            for group in self.optimizer.param_groups:
                group["lr"] = self.config.step_size(spent)
            return self._learn(rollout, rng, self.config.entropy(spent))

    def _collect(self, rng: np.random.Generator) -> Rollout:
        """Let all robots act for one rollout; the buffers are overwritten by the next one."""
        worlds, config = self.worlds, self.config
        self._ended[:] = False
        for t in range(config.rollout):
            self._observation[t] = worlds.observation
            with self.split.measure("policy_s"):
                self._action[t] = self.net.draw(torch.from_numpy(self._observation[t]), rng)
            with self.split.measure("simulator_s"):
                ends = worlds.step(self._action[t])
            self._reward[t] = worlds.reward
            for rows, observation in ends:
                self._ended[t, rows] = True
                self._last_value[t, rows] = self._values(observation)
        self._observation[-1] = worlds.observation
        with self.split.measure("policy_s"):
            value = self._values(self._observation)
        advantage = advantages(
            self._reward * np.float32(config.reward_scale), value, self._ended, self._last_value,
            config.gamma, config.gae_lambda,
        )  # fmt: skip
        target = torch.from_numpy(advantage + value[:-1])
        normal = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
        observation, action = torch.from_numpy(self._observation[:-1]), torch.from_numpy(self._action)
        return Rollout(observation, action, torch.from_numpy(normal), target)

    def _values(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        with torch.no_grad():
            values: NDArray[np.float32] = self.net.value(torch.from_numpy(observation)).numpy()
        return values

    def _learn(self, rollout: Rollout, rng: np.random.Generator, entropy_weight: float) -> dict[str, float]:
        observation, action, advantage, target = (part.flatten(0, 1) for part in rollout)
        order = torch.from_numpy(rng.permutation(len(advantage)))
        pieces = max(1, round(len(order) / self.config.minibatch))
        totals = torch.zeros(4)
        for rows in order.tensor_split(pieces):
            log_probability, entropy = self.net.log_probability(observation[rows], action[rows])
            actor_loss = policy_loss(log_probability, advantage[rows], entropy, entropy_weight)
            critic_loss = 0.5 * (self.net.value(observation[rows]) - target[rows]).square().mean()
            self.optimizer.zero_grad()
            (actor_loss + critic_loss).backward()  # type: ignore[no-untyped-call]
            norm = torch.nn.utils.clip_grad_norm_(self.net.parameters(), self.config.gradient_clip)
            self.optimizer.step()
            totals += torch.stack([actor_loss, critic_loss, entropy.mean(), norm]).detach() / pieces
        explained = 1.0 - (2.0 * totals[1] / target.var()).item()
        names = ("actor_loss", "critic_loss", "entropy", "gradient_norm")
        return {**dict(zip(names, totals.tolist(), strict=True)), "explained_variance": explained}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return network, optimizer and the worlds' history (see `Trainer.arrays`)."""
        history = {f"worlds.{name}": array for name, array in self.worlds.history().items()}
        network = {f"network.{name}": array for name, array in self.policy_tensors().items()}
        return {**network, **checkpoint.optimizer_arrays(self.optimizer), **history}

    def load(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Put back what `arrays` returned; the worlds replay their last actions."""
        network = checkpoint.part_of(arrays, "network.")
        self.net.load_state_dict({name: torch.from_numpy(array.copy()) for name, array in network.items()})
        checkpoint.load_optimizer(self.optimizer, arrays)
        self.worlds.replay(checkpoint.part_of(arrays, "worlds."))

    def policy_tensors(self) -> dict[str, NDArray[np.float32]]:
        """Return the network's tensors (see `Trainer.policy_tensors`)."""
        return tensors_of(self.net)


def train(config: ReinforceConfig) -> Path:
    """Train by `config`; return the run's folder, a policy folder (errors: `run_training`)."""
    return run_training(config, Reinforce.algorithm, Reinforce)


def profile(config: ReinforceConfig, updates: int = 10) -> dict[str, float]:
    """Measure some updates without writing anything (see `training_run.profile`)."""
    set_threads(config.threads)
    return profile_trainer(Reinforce(config), updates)


if __name__ == "__main__":
    import sys

    from train.cli import main

    sys.exit(main(["train", "reinforce", *sys.argv[1:]]))
