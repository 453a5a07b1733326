"""RLlib: one training iteration of PPO with a policy that all robots share, the envs in a process of their own."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest
import ray
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv
from ray.tune.registry import register_env

from warehouse_env import parallel_env


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Ray on two cores of this machine, telling nobody."""
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    yield
    ray.shutdown()


def test_one_training_iteration(small: dict[str, Any], cluster: None) -> None:
    register_env("warehouse", lambda options: ParallelPettingZooEnv(parallel_env(**options)))
    algorithm = (
        PPOConfig()
        .environment("warehouse", env_config=small)
        .multi_agent(policies={"shared"}, policy_mapping_fn=lambda agent, *_, **__: "shared")
        .env_runners(num_env_runners=1, rollout_fragment_length=80)
        .training(train_batch_size_per_learner=160, minibatch_size=80, num_epochs=1)
        .build_algo()
    )
    result = algorithm.train()
    assert result["env_runners"]["num_episodes"] >= 1
    assert math.isfinite(result["env_runners"]["episode_return_mean"])
    assert math.isfinite(result["learners"]["shared"]["total_loss"])
    algorithm.stop()
