"""stable-baselines3: its wrappers around our VecEnv, its own vector envs around our single env, and its evaluation."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import SubprocVecEnv, VecFrameStack, VecMonitor, VecNormalize

from warehouse_env import vec_env


def short_ppo(env: Any) -> PPO:
    model = PPO("MlpPolicy", env, n_steps=64, batch_size=64, n_epochs=1, seed=1, device="cpu")
    return model.learn(2 * 64 * env.num_envs)


def test_ppo_learns_through_all_wrappers(small: dict[str, Any], tmp_path: Path) -> None:
    env = VecNormalize(VecFrameStack(VecMonitor(vec_env(2, **small)), 3))
    model = short_ppo(env)
    assert len(model.ep_info_buffer) == 3 * 6  # 128 steps are three episodes of 40 in each row
    model.save(tmp_path / "model.zip")
    env.save(str(tmp_path / "normal.pickle"))
    again = VecNormalize.load(str(tmp_path / "normal.pickle"), VecFrameStack(VecMonitor(vec_env(2, **small)), 3))
    again.training = False
    mean, _ = evaluate_policy(PPO.load(tmp_path / "model.zip", device="cpu"), again, n_eval_episodes=6)
    assert math.isfinite(mean)
    np.testing.assert_array_equal(again.obs_rms.mean, env.obs_rms.mean)


@pytest.mark.nightly
def test_ppo_learns_on_the_single_env_in_processes_of_their_own(small: dict[str, Any]) -> None:
    make = partial(gymnasium.make, "warehouse_env:Warehouse-v0", **small)
    env = make_vec_env(make, n_envs=2, seed=3, vec_env_cls=SubprocVecEnv)
    assert len(short_ppo(env).ep_info_buffer) == 3 * 2
    env.close()
