"""Test that policy folders round-trip and that a damaged one raises one sentence."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from agents import Actor, LearnedPolicy, Network, PolicyRecord, make_policy, policy_config, save_policy
from agents.networks import ActorCritic, tensors_of
from agents.policy import Preferring, draw_discrete
from warehouse_env.config import EnvConfig, SensorSpec
from warehouse_env.errors import WeightsError
from warehouse_env.observation import observation_layout
from warehouse_env.traffic_spec import TrafficSpec
from warehouse_env.work import BatterySpec, ServiceSpec


def observations(count: int = 5) -> np.ndarray[Any, np.dtype[np.float32]]:
    rng = np.random.default_rng(1)
    return rng.normal(size=(2, count, _size())).astype(np.float32)


def _size() -> int:
    return observation_layout(EnvConfig()).size


def edit(folder: Path, **changes: Any) -> None:
    """Change entries of a folder's config.json."""
    path = folder / "config.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


def test_sampling_follows_the_softmax_and_the_generator() -> None:
    logits = np.log(np.array([0.1, 0.6, 0.3], np.float32))
    draws = draw_discrete(np.tile(logits, (20_000, 1)), np.random.default_rng(0))
    assert np.bincount(draws) / 20_000 == pytest.approx([0.1, 0.6, 0.3], abs=0.012)
    again = draw_discrete(np.tile(logits, (20_000, 1)), np.random.default_rng(0))
    assert np.array_equal(draws, again)


def test_a_real_valued_policy_samples_within_bounds(tmp_path: Path) -> None:
    config = EnvConfig(action_type="continuous")
    network = Network(_size(), 2, False, (4,))
    net = ActorCritic(network, np.zeros(2, np.float32), log_std=0.5)
    folder = save_policy(tmp_path / "real", PolicyRecord("reinforce", network, config), tensors_of(net))
    action = make_policy(folder, config).act(observations(200), np.random.default_rng(0))
    assert action.shape == (2, 200, 2)
    assert action.min() == -1.0
    assert action.max() == 1.0


def test_policy_config_adds_the_needs_of_the_policy(folder: Path) -> None:
    base = EnvConfig(num_agents=3, layout="narrow", speed_levels=(1.0,), action_repeat=5, sensor=SensorSpec(rays=8))
    config = policy_config(folder, base)
    assert (config.num_agents, config.layout) == (3, "narrow")
    assert config == base.replace(speed_levels=EnvConfig.speed_levels, action_repeat=1, sensor=SensorSpec())
    assert make_policy(str(folder), config).act(observations(), np.random.default_rng(0)).shape == (2, 5)


@pytest.mark.parametrize(
    ("base", "expected"),
    [
        ("none", "rules"),
        (TrafficSpec(margin=0.1), TrafficSpec(shield=True, margin=0.1, right_of_way=True, routes=True)),
        (TrafficSpec(routes="barred"), TrafficSpec(shield=True, right_of_way=True, routes="barred")),
    ],
)
def test_needs_of_a_rule_extend_the_given_traffic(base: Any, expected: Any) -> None:
    assert policy_config("greedy", EnvConfig(traffic=base)) == EnvConfig(traffic=expected)


def test_policy_needs_its_training_options(tmp_path: Path) -> None:
    under = EnvConfig(traffic="shield")
    network = Network(observation_layout(under).size, 20, True, (8,))
    tensors = tensors_of(ActorCritic(network, np.zeros(20, np.float32)))
    folder = save_policy(tmp_path / "under", PolicyRecord("ppo (ours)", network, under), tensors)
    assert policy_config(folder, EnvConfig()) == under
    assert make_policy(folder, under.replace(traffic=TrafficSpec(shield=True))) is not None
    with pytest.raises(WeightsError, match="trained under the shield, and needs it"):
        make_policy(folder, under.replace(traffic="none"))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"sensor": SensorSpec(rays=8)}, r"made for sensor="),
        ({"speed_levels": (0.0, 1.0)}, r"made for speed_levels="),
        ({"action_type": "continuous"}, r"made for action_type=discrete, not continuous"),
    ],
)
def test_other_observations_and_actions_are_refused(folder: Path, changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(WeightsError, match=sentence):
        make_policy(folder, EnvConfig(**changes))


@pytest.mark.parametrize("name", ["actor.0.weight", "critic.2.bias"])
def test_wrong_tensors_are_refused(folder: Path, name: str) -> None:
    path = folder / "weights.safetensors"
    tensors = load_file(path)
    save_file({**tensors, name: np.zeros((3, 3), np.float32)}, path)
    with pytest.raises(WeightsError, match=rf"{name} has shape \(3, 3\)"):
        make_policy(folder, EnvConfig())
    save_file({**tensors, name: np.full_like(tensors[name], np.nan)}, path)
    with pytest.raises(WeightsError, match="not finite"):
        make_policy(folder, EnvConfig())
    del tensors[name]
    save_file(tensors, path)
    with pytest.raises(WeightsError, match=f"lacks {name}"):
        make_policy(folder, EnvConfig())


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"format": 2}, "format 2"),
        ({"mode": "best"}, "mode='best' must be one of sample, greedy"),
        ({"network": {}}, "lacks the entry 'observation_size'"),
        ({"network": 3}, "network=3 must be a Network"),
        ({"env": {"wheels": 3}}, "unknown EnvConfig parameter 'wheels'"),
    ],
)
def test_a_damaged_config_is_refused(folder: Path, changes: dict[str, Any], sentence: str) -> None:
    edit(folder, **changes)
    with pytest.raises(WeightsError, match=sentence) as error:
        make_policy(folder, EnvConfig())
    assert str(folder / "config.json") in str(error.value)


def test_missing_activation_means_tanh_and_unknown_is_refused(folder: Path) -> None:
    network = json.loads((folder / "config.json").read_text())["network"]
    edit(folder, network={name: network[name] for name in ("observation_size", "actions", "discrete", "hidden")})
    assert LearnedPolicy(folder, EnvConfig()).record.network == Network(_size(), 20, True, (8, 8), "tanh", None)
    edit(folder, network={**network, "activation": "gelu"})
    with pytest.raises(WeightsError, match="activation='gelu' must be one of tanh, relu"):
        make_policy(folder, EnvConfig())


def test_preferences_are_logits_drawn_like_actions(folder: Path) -> None:
    config = EnvConfig(traffic="rules")
    policy = make_policy(folder, EnvConfig())
    assert isinstance(policy, LearnedPolicy)
    assert isinstance(policy, Preferring)
    assert not isinstance(make_policy("follow", EnvConfig()), Preferring)
    seen = observations()
    assert np.array_equal(policy.preferences(seen), policy.output(seen))
    liked = Actor(policy, config)(seen, np.random.default_rng(5))
    assert np.array_equal(liked.argmax(-1), policy.act(seen, np.random.default_rng(5)))
    policy.record = dataclasses.replace(policy.record, mode="greedy")
    assert np.array_equal(Actor(policy, config)(seen, np.random.default_rng(5)), policy.output(seen))


NEEDS = {"service": ServiceSpec(), "battery": BatterySpec()}


@pytest.mark.parametrize(
    ("name", "more"), [("ppo", NEEDS), ("shielded", NEEDS), ("ppo", {"traffic": TrafficSpec(shield=True)})]
)
def test_shipped_policy_ignores_slices_absent_in_training(name: str, more: dict[str, Any]) -> None:
    config = policy_config(name, EnvConfig(num_agents=3, arrival="stop"))
    busy = config.replace(**more)
    seen = np.random.default_rng(0).normal(size=(1, 3, observation_layout(busy).size)).astype(np.float32)
    short = seen[..., : observation_layout(config).size]
    policies = [make_policy(name, one) for one in (config, busy)]
    outputs = [one.output(o) for one, o in zip(policies, (short, seen), strict=True) if isinstance(one, LearnedPolicy)]
    assert len(outputs) == 2
    np.testing.assert_array_equal(*outputs)
