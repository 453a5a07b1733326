"""Test that policy folders of stable-baselines3 models give the library's outputs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from stable_baselines3 import A2C, DQN, PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from agents import LearnedPolicy, make_policy, policy_config, save_model
from warehouse_env import EnvConfig, SensorSpec, vec_env
from warehouse_env.errors import ConfigError, WeightsError

NN = torch.nn
SEEN = EnvConfig(num_agents=2, layout="open", planner="astar", max_steps=40, sensor=SensorSpec(predictions=True))
MODELS: dict[str, tuple[Callable[..., BaseAlgorithm], dict[str, Any]]] = {
    "one layer": (PPO, {"net_arch": []}),
    "leaky, narrowing": (PPO, {"activation_fn": NN.LeakyReLU, "net_arch": [24, 12]}),
    "a2c, elu": (A2C, {"activation_fn": NN.ELU, "net_arch": {"pi": [32], "vf": [16, 16]}}),
    "dqn": (DQN, {}),
}


def logits(made: BaseAlgorithm, observation: np.ndarray[Any, np.dtype[np.float32]]) -> Any:
    seen = torch.as_tensor(observation)
    with torch.no_grad():
        if isinstance(made, DQN):
            return made.policy.q_net(seen).numpy()
        return made.policy.action_net(made.policy.mlp_extractor.forward_actor(seen)).numpy()  # type: ignore[union-attr]


@pytest.mark.parametrize("name", MODELS)
def test_folder_outputs_equal_the_model(name: str, tmp_path: Path) -> None:
    kind, shape = MODELS[name]
    made = kind("MlpPolicy", vec_env(1, SEEN), policy_kwargs=shape, device="cpu", seed=0)
    with torch.no_grad():
        for parameter in made.policy.parameters():  # large weights, as after long training
            parameter.add_(0.2 * torch.randn_like(parameter))
    observation = np.random.default_rng(0).uniform(-1, 1, (6, 112)).astype(np.float32)
    folder = save_model(tmp_path / "folder", made)
    config = policy_config(folder, EnvConfig(num_agents=3))
    assert config.sensor.predictions
    policy = make_policy(folder, config)
    assert isinstance(policy, LearnedPolicy)
    assert policy.output(observation) == pytest.approx(logits(made, observation), rel=1e-4, abs=1e-4)
    assert policy.drawn == (not isinstance(made, DQN))


def test_loaded_continuous_model_is_saved_with_a_given_config(tmp_path: Path) -> None:
    config = SEEN.replace(action_type="continuous")
    made = PPO("MlpPolicy", vec_env(2, config), n_steps=8, batch_size=32, n_epochs=1, device="cpu")
    made.save(tmp_path / "model.zip")
    loaded = PPO.load(tmp_path / "model.zip", device="cpu")
    with pytest.raises(ConfigError, match="the model has no environment"):
        save_model(tmp_path / "folder", loaded)
    folder = save_model(tmp_path / "folder", loaded, config, mode="greedy")
    policy = make_policy(folder, policy_config(folder, EnvConfig()))
    seen = np.random.default_rng(0).uniform(-1, 1, (1, 4, 112)).astype(np.float32)
    best, _ = made.predict(seen[0], deterministic=True)
    assert policy.act(seen, np.random.default_rng(0))[0] == pytest.approx(best, abs=1e-5)
    with pytest.raises(WeightsError, match=r"no policy folder; agents\.save_model"):
        make_policy(tmp_path / "model.zip", config)


REAL = SEEN.replace(action_type="continuous")


@pytest.mark.parametrize(
    ("kind", "config", "more", "sentence"),
    [
        (SAC, REAL, {"buffer_size": 100}, "this SAC cannot be saved"),
        (PPO, REAL, {"use_sde": True}, "this PPO cannot be saved"),
        (PPO, SEEN, {}, "normalised observations"),
        (PPO, SEEN, {"policy_kwargs": {"activation_fn": NN.GELU}}, "has the activation GELU"),
    ],
)
def test_unsupported_models_are_refused(
    kind: Callable[..., BaseAlgorithm], config: EnvConfig, more: dict[str, Any], sentence: str, tmp_path: Path
) -> None:
    worlds: Any = vec_env(2, config)
    model = kind("MlpPolicy", worlds if more else VecNormalize(worlds), device="cpu", **more)
    with pytest.raises(WeightsError, match=sentence):
        save_model(tmp_path / "folder", model)
