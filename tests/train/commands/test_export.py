"""Test `warehouse export`: the model in onnxruntime against our forward pass, and its metadata."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load_file

from agents import POLICIES, WEIGHTS_FOLDER, LearnedPolicy, Network, PolicyRecord, policy_config, save_policy
from agents.onnx_model import onnx_model
from agents.weights_folder import Activation
from train.cli import main
from warehouse_env.config import EnvConfig
from warehouse_env.observation import observation_layout
from warehouse_env.simulation.simulator import Simulator

pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")
LEARNED = [name for name, entry in POLICIES.items() if entry.weights is not None]


def run(model: bytes, observation: Any) -> list[Any]:
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    found: list[Any] = session.run(None, {"observation": observation})
    return found


def observed(config: EnvConfig) -> Any:
    """Return observations float32[rows, D] of driving robots."""
    simulator = Simulator(config.replace(planner="astar", num_agents=16))
    simulator.reset(seed=3)
    for _ in range(20):
        simulator.step(np.full((1, 16), simulator.cruise_action))
    return simulator.observation[0]


@pytest.mark.parametrize("name", LEARNED)
def test_three_ways_to_run_a_shipped_policy_agree(name: str) -> None:
    directory, config = WEIGHTS_FOLDER / name, policy_config(name, EnvConfig())
    observation = observed(config)
    own = LearnedPolicy(directory, config).output(observation)
    (runtime,) = run(onnx_model(directory).SerializeToString(), observation)
    np.testing.assert_allclose(runtime, own, atol=1e-5, rtol=1e-5)
    # in float64, so that the bound covers the rounding of the policy alone
    tensors, x = load_file(directory / "weights.safetensors"), observation.astype(np.float64)
    for k in range(3):
        x = x @ tensors[f"actor.{k}.weight"].T + tensors[f"actor.{k}.bias"]
        x = np.tanh(x) if k < 2 else x
    np.testing.assert_allclose(x, own, atol=1e-5, rtol=1e-5)


def test_export_writes_a_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target, directory = tmp_path / "new" / "head.onnx", WEIGHTS_FOLDER / "reinforce"
    assert main(["export", "--policy", "reinforce", "--onnx", str(target)]) == 0
    assert capsys.readouterr().out == f"wrote the network of reinforce to {target}\n"
    config = policy_config("reinforce", EnvConfig())
    observation = np.random.default_rng(0).uniform(-1.0, 1.0, (256, observation_layout(config).size))
    (runtime,) = run(target.read_bytes(), observation.astype(np.float32))
    own = LearnedPolicy(directory, config).output(observation.astype(np.float32))
    np.testing.assert_allclose(runtime, own, atol=1e-5 * np.abs(own).max(), rtol=0)


def test_model_metadata_states_observation_and_actions() -> None:
    printed = {prop.key: json.loads(prop.value) for prop in onnx_model(WEIGHTS_FOLDER / "ppo").metadata_props}
    config = policy_config("ppo", EnvConfig())
    layout = observation_layout(config)
    assert printed["observation"] == {name: [part.start, part.stop] for name, part in layout.slices.items()}
    assert printed["actions"][0] == [config.speed_levels[0], config.lateral_offsets[0]]
    assert len(printed["actions"]) == 20
    assert (printed["action_type"], printed["mode"], printed["decision_seconds"]) == ("discrete", "sample", 0.1)


@pytest.mark.parametrize(
    ("hidden", "activation", "discrete"),
    [((16, 8), "silu", True), ((16, 8), "elu", True), ((), "silu", True), ((8,), "tanh", False)],
)
def test_every_kind_of_network_is_exported(
    hidden: tuple[int, ...], activation: Activation, discrete: bool, tmp_path: Path
) -> None:
    rng, env = np.random.default_rng(0), EnvConfig(action_type="discrete" if discrete else "continuous")
    network = Network(observation_layout(env).size, 20 if discrete else 2, discrete, hidden, activation)
    tensors = {name: rng.normal(size=shape).astype(np.float32) for name, shape in network.shapes().items()}
    actor = {name: array for name, array in tensors.items() if not name.startswith("critic.")}
    save_policy(tmp_path, PolicyRecord("ppo", network, env), actor)
    observation = rng.normal(size=(5, network.observation_size)).astype(np.float32)
    outputs, *deviations = run(onnx_model(tmp_path).SerializeToString(), observation)
    np.testing.assert_allclose(outputs, LearnedPolicy(tmp_path, env).output(observation), atol=1e-4, rtol=1e-4)
    assert len(deviations) == (not discrete)
    for deviation in deviations:
        np.testing.assert_allclose(deviation, np.exp(tensors["log_std"]), rtol=1e-5)
