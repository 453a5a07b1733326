"""Models of stable-baselines3: their outputs are the library's own, and no pickle in a file is opened."""

from __future__ import annotations

import json
import pickle
import zipfile
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
from warehouse_env import EnvConfig, MetricsCallback, SensorSpec, vec_env
from warehouse_env.envs.vector import WarehouseVecEnv
from warehouse_env.errors import WeightsError
from warehouse_env.traffic_spec import TrafficSpec

NN = torch.nn
SEEN = EnvConfig(num_agents=2, layout="open", planner="astar", max_steps=40, sensor=SensorSpec(predictions=True))
MODELS: dict[str, tuple[Callable[..., BaseAlgorithm], dict[str, Any]]] = {
    "one layer": (PPO, {"net_arch": []}),
    "leaky, narrowing": (PPO, {"activation_fn": NN.LeakyReLU, "net_arch": [24, 12]}),
    "a2c, elu": (A2C, {"activation_fn": NN.ELU, "net_arch": {"pi": [32], "vf": [16, 16]}}),
    "dqn": (DQN, {}),
}


def model(worlds: WarehouseVecEnv, kind: Callable[..., BaseAlgorithm], shape: dict[str, Any]) -> BaseAlgorithm:
    """A model whose weights are no small ones, as after long training."""
    made = kind("MlpPolicy", worlds, policy_kwargs=shape, device="cpu", seed=0)
    with torch.no_grad():
        for parameter in made.policy.parameters():
            parameter.add_(0.2 * torch.randn_like(parameter))
    return made


@pytest.fixture(scope="module")
def worlds() -> WarehouseVecEnv:
    return vec_env(1, SEEN)


def logits(made: BaseAlgorithm, observation: np.ndarray[Any, np.dtype[np.float32]]) -> Any:
    seen = torch.as_tensor(observation)
    with torch.no_grad():
        if isinstance(made, DQN):
            return made.policy.q_net(seen).numpy()
        return made.policy.action_net(made.policy.mlp_extractor.forward_actor(seen)).numpy()  # type: ignore[union-attr]


@pytest.mark.parametrize("name", MODELS)
def test_file_and_folder_are_the_model(name: str, worlds: WarehouseVecEnv, tmp_path: Path) -> None:
    made = model(worlds, *MODELS[name])
    made.save(tmp_path / "model")
    observation = np.random.default_rng(0).uniform(-1, 1, (6, 112)).astype(np.float32)
    for path in (tmp_path / "model.zip", save_model(tmp_path / "folder", made)):
        config = policy_config(path, EnvConfig(num_agents=3))
        assert config.sensor.predictions
        policy = make_policy(path, config)
        assert isinstance(policy, LearnedPolicy)
        assert policy.output(observation) == pytest.approx(logits(made, observation), rel=1e-4, abs=1e-4)
        assert policy.drawn == (not isinstance(made, DQN))


def test_the_callback_notes_the_environment(tmp_path: Path) -> None:
    config = SEEN.replace(speed_levels=(0.0, 1.0), action_repeat=2, traffic=TrafficSpec(shield=True))
    made = PPO("MlpPolicy", vec_env(2, config), n_steps=8, batch_size=32, n_epochs=1, device="cpu")
    made.learn(32, callback=MetricsCallback())
    made.save(tmp_path / "noted.zip")
    given = policy_config(tmp_path / "noted.zip", EnvConfig())
    assert (given.speed_levels, given.action_repeat, bool(given.traffic_spec.shield)) == ((0.0, 1.0), 2, True)
    assert PPO.load(tmp_path / "noted.zip", device="cpu").warehouse_env["action_repeat"] == 2  # type: ignore[attr-defined]


def test_normalised_observations_are_refused(tmp_path: Path) -> None:
    made = PPO("MlpPolicy", VecNormalize(vec_env(2, SEEN)), n_steps=8, batch_size=32, n_epochs=1, device="cpu")
    made.learn(32, callback=MetricsCallback())
    made.save(tmp_path / "scaled.zip")
    with pytest.raises(WeightsError, match="it sees normalised observations"):
        policy_config(tmp_path / "scaled.zip", EnvConfig())
    with pytest.raises(WeightsError, match="normalised observations"):
        save_model(tmp_path / "folder", made)


def test_real_valued_actions_need_the_environment_noted(tmp_path: Path) -> None:
    config = SEEN.replace(action_type="continuous")
    made = PPO("MlpPolicy", vec_env(2, config), n_steps=8, batch_size=32, n_epochs=1, device="cpu")
    made.save(tmp_path / "model.zip")
    with pytest.raises(WeightsError, match=r"does not tell what its real-valued actions mean; agents\.save_model"):
        policy_config(tmp_path / "model.zip", EnvConfig())
    folder = save_model(tmp_path / "folder", made, mode="greedy")
    policy = make_policy(folder, policy_config(folder, EnvConfig()))
    seen = np.random.default_rng(0).uniform(-1, 1, (1, 4, 112)).astype(np.float32)
    best, _ = made.predict(seen[0], deterministic=True)
    assert policy.act(seen, np.random.default_rng(0))[0] == pytest.approx(best, abs=1e-5)


def edited(path: Path, **files: Callable[[bytes], bytes]) -> Path:
    """Return a copy of a model's file in which some of its files are other ones."""
    copy = path.with_name("edited.zip")
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(copy, "w") as new:
        for name in old.namelist():
            change = files.get(name.replace(".", "_"), bytes)
            new.writestr(name, change(old.read(name)))
    return copy


class Trap:
    """What runs code where it is unpickled."""

    def __init__(self, where: Path) -> None:
        self.where = where

    def __reduce__(self) -> tuple[Callable[..., object], tuple[object, ...]]:
        return Path.touch, (self.where,)


def test_no_pickle_is_opened(worlds: WarehouseVecEnv, tmp_path: Path) -> None:
    made = model(worlds, PPO, {})
    made.save(tmp_path / "model.zip")
    sprung = tmp_path / "sprung"
    code = pickle.dumps(Trap(sprung))

    def trapped(data: bytes) -> bytes:
        import base64

        about = json.loads(data)
        for entry in about.values():
            if isinstance(entry, dict) and ":serialized:" in entry:
                entry[":serialized:"] = base64.b64encode(code).decode()
        return json.dumps(about).encode()

    policy_config(edited(tmp_path / "model.zip", data=trapped), EnvConfig())
    assert not sprung.exists()

    def tensors(data: bytes) -> bytes:
        import io

        out = io.BytesIO()
        torch.save({"action_net.weight": Trap(sprung)}, out)
        return out.getvalue()

    with pytest.raises(WeightsError, match=r"policy.pth holds more than plain tensors"):
        policy_config(edited(tmp_path / "model.zip", policy_pth=tensors), EnvConfig())
    assert not sprung.exists()
    with pytest.raises(WeightsError, match="is no zip file of plain tensors"):
        policy_config(edited(tmp_path / "model.zip", policy_pth=lambda data: code), EnvConfig())
    assert not sprung.exists()


def test_other_algorithms_and_observations_are_refused(tmp_path: Path) -> None:
    other = SAC("MlpPolicy", vec_env(1, SEEN.replace(action_type="continuous")), device="cpu", buffer_size=100)
    other.save(tmp_path / "sac.zip")
    with pytest.raises(WeightsError, match=r"has a tensor 'actor\..*only MlpPolicy of PPO, A2C and DQN"):
        policy_config(tmp_path / "sac.zip", EnvConfig())
    with pytest.raises(WeightsError, match=r"only MlpPolicy of PPO, A2C and DQN"):
        save_model(tmp_path / "sac", other)
    few = PPO("MlpPolicy", vec_env(1, SEEN.replace(sensor=SensorSpec(rays=8))), device="cpu")
    few.save(tmp_path / "few.zip")
    with pytest.raises(WeightsError, match=r"observations of \d+ values, the default environment gives 92, 94, 112"):
        policy_config(tmp_path / "few.zip", EnvConfig())
