"""Rollouts of our own trainers: a worker plays its worlds with the current policy and judges every action."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.networks import ActorCritic
from train.learning.config import TrainingConfig
from train.learning.trainer import Split
from train.learning.worlds import TrainingWorlds
from warehouse_env.config import EnvConfig, RewardWeights


class Rollout(NamedTuple):
    """What T decisions of R robots leave for the update; rows are T x R."""

    observation: Tensor  # float32[T * R, D]
    action: Tensor  # int64[T * R] or float32[T * R, 2]
    log_probability: Tensor  # float32[T * R], of the action when it was drawn
    advantage: Tensor  # float32[T * R]
    target: Tensor  # float32[T * R], of the critic: the return


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
    out: NDArray[np.float32] = np.zeros_like(reward)
    carried = np.zeros_like(delta[0])
    for t in range(len(delta) - 1, -1, -1):
        carried = delta[t] + keep[t] * carried
        out[t] = carried
    return out


class RolloutWorker:
    """Worlds and buffers of one thread."""

    def __init__(self, config: TrainingConfig, mixes: Sequence[tuple[EnvConfig, int]], number: int) -> None:
        """Make the worlds.

        Args:
            config: of the training; its `rollout` is T.
            mixes: environments with the number of worlds of each.
            number: of this worker; the worlds' seeds follow from it.
        """
        length = config.rollout
        self._config, self.split = config, Split()
        with self.split.measure("simulator_s"):
            self.worlds = TrainingWorlds(mixes, [config.seed, number], config.jam_seconds, config.shared)
        self.rows = self.worlds.rows
        self._observation = np.zeros((length + 1, *self.worlds.observation.shape), np.float32)
        self._action: NDArray[np.int64] | NDArray[np.float32]
        if config.action_type == "discrete":
            self._action = np.zeros((length, self.rows), np.int64)
        else:
            self._action = np.zeros((length, self.rows, 2), np.float32)
        self._log_probability = np.zeros((length, self.rows), np.float32)
        self._reward = np.zeros((length, self.rows), np.float32)
        self._ended = np.zeros((length, self.rows), np.bool_)
        self._last_value = np.zeros((length, self.rows), np.float32)

    def collect(self, net: ActorCritic, weights: RewardWeights, seed: list[int]) -> Rollout:
        """Let all robots act for one rollout. Its tensors are overwritten by the next one.

        Args:
            net: policy and critic as they stand.
            weights: of the reward.
            seed: of the draws.
        """
        rng, worlds = np.random.default_rng(seed), self.worlds
        worlds.set_reward(weights)
        self._ended[:] = False
        for t in range(self._config.rollout):
            self._observation[t] = worlds.observation
            with self.split.measure("policy_s"):
                self._action[t], self._log_probability[t] = net.draw(torch.from_numpy(self._observation[t]), rng)
            with self.split.measure("simulator_s"):
                ends = worlds.step(self._action[t])
            self._reward[t] = worlds.reward
            for rows, observation in ends:
                self._ended[t, rows] = True
                self._last_value[t, rows] = _values(net, observation)
        self._observation[-1] = worlds.observation
        with self.split.measure("policy_s"):
            return self._judge(net)

    def _judge(self, net: ActorCritic) -> Rollout:
        config = self._config
        value = _values(net, self._observation)
        reward = self._reward * np.float32(config.reward_scale)
        advantage = advantages(reward, value, self._ended, self._last_value, config.gamma, config.gae_lambda)
        drawn = (self._observation[:-1], self._action, self._log_probability)
        arrays = (*drawn, advantage, advantage + value[:-1])
        return Rollout(*(torch.from_numpy(array).flatten(0, 1) for array in arrays))


def _values(net: ActorCritic, observation: NDArray[np.float32]) -> NDArray[np.float32]:
    with torch.no_grad():
        values: NDArray[np.float32] = net.value(torch.from_numpy(observation)).numpy()
    return values
