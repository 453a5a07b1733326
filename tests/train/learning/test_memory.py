"""Policies with a memory: the same numbers wherever they are computed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from agents import WEIGHTS_FOLDER, LearnedPolicy, Recurrent, make_policy, policy_config
from agents.networks import ActorCritic, begin_with, tensors_of
from agents.weights_folder import Network, PolicyRecord, save_policy
from tests.train.trainings import SMALL
from train.learning.config import ThreadedPPOConfig
from train.threaded_ppo import ThreadedPpo
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, WeightsError
from warehouse_env.observation import observation_layout


@pytest.fixture
def config(tmp_path: Path) -> ThreadedPPOConfig:
    """Return a training of some seconds with a memory."""
    return ThreadedPPOConfig(out=tmp_path, steps=16 * 6 * 4, memory=5, **SMALL | {"rows": 16, "threads": 1})


def network(memory: int = 6, hidden: tuple[int, ...] = (9, 8)) -> ActorCritic:
    torch.manual_seed(1)
    net = ActorCritic(Network(4, 3, True, hidden, memory=memory), np.zeros(3, np.float32))
    for parameter in net.parameters():
        torch.nn.init.normal_(parameter, std=0.7)
    return net


@pytest.mark.parametrize("hidden", [(9,), (9, 8)])
def test_decisions_relived_are_those_that_were_made(hidden: tuple[int, ...]) -> None:
    net, seen = network(hidden=hidden), torch.randn(7, 3, 4)
    ended = torch.zeros(7, 3, dtype=torch.bool)
    ended[2, 1] = ended[4, 0] = True
    begun = memory = torch.randn(3, 6)
    made = []
    for t in range(7):
        output, memory = net.recall(seen[t], memory)
        made.append(output)
        memory = memory * ~ended[t].unsqueeze(-1)
    assert torch.allclose(net.relive(seen, begun, ended), torch.stack(made), atol=1e-6)


def test_a_robot_alone_decides_as_a_gated_recurrent_unit_by_hand() -> None:
    net = network(memory=1, hidden=(1,))
    w = {name: tensor.numpy() for name, tensor in net.state_dict().items()}
    seen, before = np.array([0.3, -1.0, 0.5, 2.0], np.float32), 0.4
    x = np.tanh(w["actor.0.weight"] @ seen + w["actor.0.bias"])
    given = w["memory.weight_ih"] @ x + w["memory.bias_ih"]
    kept = w["memory.weight_hh"] @ np.array([before]) + w["memory.bias_hh"]
    reset, keep = 1 / (1 + np.exp(-(given[:2] + kept[:2])))
    after = (1 - keep) * np.tanh(given[2] + reset * kept[2]) + keep * before
    output = w["actor.1.weight"] @ np.array([x[0], after]) + w["actor.1.bias"]
    got, memory = net.recall(torch.from_numpy(seen)[None], torch.tensor([[before]]))
    assert memory.item() == pytest.approx(after, abs=1e-6)
    assert got[0].tolist() == pytest.approx(output.tolist(), abs=1e-5)


def test_a_folder_with_a_memory_drives_as_the_network_that_was_trained(tmp_path: Path) -> None:
    env = EnvConfig(layout="open", num_agents=3, planner="astar")
    size = observation_layout(env).size
    net = ActorCritic(Network(size, 20, True, (16, 12), memory=7), np.zeros(20, np.float32))
    record = PolicyRecord("ours", net.network, env)
    policy = make_policy(save_policy(tmp_path, record, tensors_of(net)), policy_config(tmp_path, env))
    assert isinstance(policy, Recurrent)
    memory, theirs = policy.memory(2), torch.zeros(6, 7)
    for seen in np.random.default_rng(0).normal(size=(4, 2, 3, size)).astype(np.float32):
        output, memory = policy.preferences(seen, memory)
        expected, theirs = net.recall(torch.from_numpy(seen).flatten(0, 1), theirs)
        assert output.reshape(6, 20) == pytest.approx(expected.detach().numpy(), abs=2e-5)
        assert memory.reshape(6, 7) == pytest.approx(theirs.detach().numpy(), abs=1e-5)


def test_a_training_goes_through_sequences_of_every_robot_once(
    config: ThreadedPPOConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    trainer, taken = ThreadedPpo(replace(config, epochs=2)), list[int]()
    gradient = trainer.gradient

    def counted(rollout, robots, *rest):  # type: ignore[no-untyped-def]
        taken.extend(robots.tolist())
        assert rollout.sequences(robots).tolist() == [16 * t + r for t in range(6) for r in robots.tolist()]
        return gradient(rollout, robots, *rest)

    monkeypatch.setattr(trainer, "gradient", counted)
    trainer.update(0, 0.0)
    assert sorted(taken) == sorted(2 * list(range(16)))


def test_a_training_begins_with_a_policy_and_a_new_memory(config: ThreadedPPOConfig, tmp_path: Path) -> None:
    plain = ThreadedPpo(replace(config, memory=0))
    plain.update(0, 0.0)
    folder = save_policy(
        tmp_path / "plain", PolicyRecord("ours", plain.network, config.driven(plain.env)), plain.policy_tensors()
    )
    seen = torch.randn(10, plain.network.observation_size)
    started = ThreadedPpo(replace(config, start=str(folder)))
    output, _ = started.net.recall(seen, torch.randn(10, 5))
    assert torch.allclose(output, plain.net.output(seen), atol=1e-6)
    assert torch.equal(started.net.value(seen), plain.net.value(seen))
    with pytest.raises(ConfigError, match=r"actor\.0\.weight"):
        begin_with(network(), plain.policy_tensors())
    with pytest.raises(ConfigError, match="rule"):
        ThreadedPpo(replace(config, start="brake"))


def test_a_policy_of_other_senses_is_no_beginning(config: ThreadedPPOConfig, tmp_path: Path) -> None:
    """Fewer numbers in would fit into the network, and mean something else."""
    blind = ThreadedPpo(replace(config, memory=0, predictions=False))
    folder = save_policy(
        tmp_path / "blind", PolicyRecord("ours", blind.network, config.driven(blind.env)), blind.policy_tensors()
    )
    with pytest.raises(WeightsError, match="sensor"):
        ThreadedPpo(replace(config, start=str(folder)))


def test_the_update_relives_the_decisions_of_the_rollout(
    config: ThreadedPPOConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Until the first step the probabilities are those of the draws, also after episodes that ended."""
    trainer, ends = ThreadedPpo(replace(config, minibatch=1000)), 0

    def compared(log_probability: Tensor, old: Tensor, advantage: Tensor) -> tuple[Tensor, Tensor]:
        assert torch.allclose(log_probability, old, atol=1e-5)
        return (advantage * log_probability).mean(), advantage.new_zeros(())

    monkeypatch.setattr(trainer, "_actor_loss", compared)
    monkeypatch.setattr(trainer, "epochs", 1)
    with torch.no_grad():
        for parameter in trainer.net.actor_parameters():
            parameter.add_(0.3 * torch.randn_like(parameter))
    for number in range(4):
        trainer.update(number, 0.0)
        ends += int(trainer._workers[0]._ended[:-1].sum())
    assert ends > 0


def test_a_policy_with_a_memory_never_acts_without_it() -> None:
    policy = make_policy("careful", policy_config("careful", EnvConfig(num_agents=3)))
    seen = np.zeros((1, 3, 112), np.float32)
    for call in ("output", "preferences"):
        with pytest.raises(TypeError, match="memory"):
            getattr(policy, call)(seen)
    with pytest.raises(WeightsError, match="make_policy"):
        LearnedPolicy(WEIGHTS_FOLDER / "careful", policy_config("careful", EnvConfig()))
