"""Test vector envs and wrappers of Gymnasium and stable-baselines3 around our envs, also across processes."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import SubprocVecEnv, VecFrameStack, VecMonitor, VecNormalize

from warehouse_env import vec_env

ID = "warehouse_env:Warehouse-v0"  # with the module, so that a new process can find the env


@pytest.mark.parametrize("start", ["fork", pytest.param("spawn", marks=pytest.mark.nightly)])
def test_sync_and_async_vector_envs_agree(small: dict[str, Any], start: str) -> None:
    """Step past the end of an episode and compare with one env alone."""
    make = partial(gymnasium.make, ID, **small)
    sync, others, alone = SyncVectorEnv([make] * 2), AsyncVectorEnv([make] * 2, context=start), make()
    first, second = sync.reset(seed=[3, 4])[0], others.reset(seed=[3, 4])[0]
    np.testing.assert_array_equal(first[0], alone.reset(seed=3)[0])
    ends = 0
    for k in range(50):
        np.testing.assert_array_equal(first, second)
        actions = np.array([17, k % 20])
        (first, *mine), (second, *its) = sync.step(actions), others.step(actions)
        for part in range(3):
            np.testing.assert_array_equal(mine[part], its[part])
        if not ends:
            np.testing.assert_array_equal(first[0], alone.step(17)[0])
        ends += int(mine[2].sum())
    assert ends == 2
    sync.close()
    others.close()


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
def test_ppo_learns_on_single_envs_in_processes(small: dict[str, Any]) -> None:
    make = partial(gymnasium.make, "warehouse_env:Warehouse-v0", **small)
    env = make_vec_env(make, n_envs=2, seed=3, vec_env_cls=SubprocVecEnv)
    assert len(short_ppo(env).ep_info_buffer) == 3 * 2
    env.close()
