"""Rollouts of our own trainers: a worker plays its worlds with the current policy and judges every action."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from agents.networks import ActorCritic
from train.learning.config import ThreadedConfig
from train.learning.trainer import Split, rng_of
from train.learning.worlds import TrainingWorlds
from warehouse_env.config import RewardWeights

_JUDGED = 1_000_000  # rows whose values are computed at once, which bounds the memory


class Rollout(NamedTuple):
    """What T decisions of R robots leave for the update; rows are T x R."""

    observation: Tensor  # float32[T * R, D]
    action: Tensor  # int64[T * R] or float32[T * R, 2]
    log_probability: Tensor  # float32[T * R], of the action when it was drawn
    advantage: Tensor  # float32[T * R]
    target: Tensor  # float32[T * R], of the critic: the return


def advantages(
    reward: Tensor, value: Tensor, ended: Tensor, last_value: Tensor, gamma: float, gae_lambda: float
) -> Tensor:
    """Return generalised advantages float32[T, R] (Schulman et al. 2016, eq. 16).

    A_t = d_t + gamma lambda A_{t+1},  d_t = r_t + gamma V(o_{t+1}) - V(o_t); an ended episode cuts the sum.

    Args:
        reward: float32[T, R].
        value: float32[T + 1, R], V(o_t); the last row continues the return.
        ended: bool[T, R], the episode was cut after the step (o_{t+1} is then the first of the next one).
        last_value: float32[T, R], V of the cut episode's last observation, where `ended`.
        gamma, gae_lambda: discount and weight.
    """
    out = reward + gamma * torch.where(ended, last_value, value[1:]) - value[:-1]
    keep = gamma * gae_lambda * ~ended
    for t in range(len(out) - 2, -1, -1):
        out[t] += keep[t] * out[t + 1]
    return out


class RolloutWorker:
    """Worlds and buffers of one thread, or of a device."""

    def __init__(self, config: ThreadedConfig, worlds: TrainingWorlds) -> None:
        """Make the buffers of `config.rollout` decisions, T, where the worlds are."""
        self._config, self.worlds, self.split, self.rows = config, worlds, Split(), worlds.rows
        shape, new = (config.rollout, worlds.rows), worlds.reward
        self._observation = new.new_zeros((config.rollout + 1, *worlds.observation.shape))
        discrete = config.action_type == "discrete"
        self._action = new.new_zeros(shape, dtype=torch.int64) if discrete else new.new_zeros((*shape, 2))
        self._log_probability, self._reward, self._last_value = (new.new_zeros(shape) for _ in range(3))
        self._ended = new.new_zeros(shape, dtype=torch.bool)

    @torch.no_grad()
    def collect(self, net: ActorCritic, weights: RewardWeights, seed: list[int]) -> Rollout:
        """Let all robots act for one rollout. Its tensors are overwritten by the next one.

        Args:
            net: policy and critic as they stand.
            weights: of the reward.
            seed: of the draws.
        """
        rng, worlds = rng_of(seed, self._config.device), self.worlds
        worlds.set_reward(weights)
        self._ended.zero_()
        for t in range(self._config.rollout):
            self._observation[t] = worlds.observation
            with self.split.measure("policy_s"):
                output = net.output(self._observation[t])
                self._action[t], self._log_probability[t] = net.draw(output, rng)
            with self.split.measure("simulator_s"):
                ends = worlds.step(self._action[t])
            self._reward[t] = worlds.reward
            for rows, observation in ends:
                self._ended[t, rows] = True
                self._last_value[t, rows] = net.value(observation)
        self._observation[-1] = worlds.observation
        with self.split.measure("policy_s"):
            return self._judge(net)

    def _judge(self, net: ActorCritic) -> Rollout:
        config = self._config
        parts = torch.split(self._observation.flatten(0, 1), _JUDGED)
        value = torch.cat([net.value(part) for part in parts]).view(-1, self.rows)
        reward = self._reward * config.reward_scale
        advantage = advantages(reward, value, self._ended, self._last_value, config.gamma, config.gae_lambda)
        drawn = (self._observation[:-1], self._action, self._log_probability)
        return Rollout(*(tensor.flatten(0, 1) for tensor in (*drawn, advantage, advantage + value[:-1])))
