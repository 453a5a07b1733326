"""Test both PPOs: exported distribution, clipped loss by hand, draws, and one use of every row per pass."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from agents import LearnedPolicy, PolicyRecord, save_policy
from agents.networks import ActorCritic
from agents.weights_folder import Network
from tests.train.trainings import SMALL
from train.learning.config import PPOConfig, ThreadedPPOConfig
from train.learning.threaded import ThreadedTrainer, clipped_loss, joint_scale
from train.learning.trainer import rng_of
from train.ppo import Ppo


@pytest.fixture
def config(tmp_path: Path) -> PPOConfig:
    """Return a training of a few seconds: three worlds on the open floor, two updates."""
    return PPOConfig(out=tmp_path, steps=8 * 8 * 2, **SMALL | {"rollout": 8, "minibatch": 32, "hidden": (24, 20)})


def observations(trainer: Ppo) -> NDArray[np.float32]:
    rng = np.random.default_rng(0)
    return rng.normal(size=(50, trainer.network.observation_size)).astype(np.float32)


def logits_in_float64(trainer: Ppo, observation: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the library's logits in float64, where the order of summation does not matter."""
    policy = copy.deepcopy(trainer.model.policy).double()
    with torch.no_grad():
        hidden = policy.mlp_extractor.forward_actor(torch.from_numpy(observation).double())
        return np.asarray(policy.action_net(hidden).numpy())


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
def test_export_has_the_librarys_distribution(config: PPOConfig, tmp_path: Path, action_type: Any) -> None:
    trainer = Ppo(replace(config, action_type=action_type))
    trainer.update(0, 0.0)
    observation = observations(trainer)
    with torch.no_grad():
        theirs = trainer.model.policy.get_distribution(torch.from_numpy(observation)).distribution
        value = trainer.model.policy.predict_values(torch.from_numpy(observation)).squeeze(-1)
    record = PolicyRecord("ppo", trainer.network, trainer.env)
    policy = LearnedPolicy(save_policy(tmp_path / "export", record, trainer.policy_tensors()), trainer.env)
    output = policy.output(observation)
    net = ActorCritic(trainer.network, np.zeros(trainer.network.actions, np.float32))
    net.load_state_dict({name: torch.from_numpy(array) for name, array in trainer.policy_tensors().items()})
    action = torch.from_numpy(policy.act(observation, np.random.default_rng(0)))
    with torch.no_grad():
        log_probability, entropy = net.judge(net.output(torch.from_numpy(observation)), action)
        ours_value = net.value(torch.from_numpy(observation))
    assert torch.equal(ours_value, value)
    if action_type == "discrete":
        # compare in float64: the library's float32 logits have errors like ours, sometimes of opposite sign
        truth = logits_in_float64(trainer, observation)
        assert output - output.max(-1, keepdims=True) == pytest.approx(truth - truth.max(-1, keepdims=True), abs=1e-5)
        assert torch.allclose(log_probability, theirs.log_prob(action), atol=1e-5)
        assert torch.allclose(entropy, theirs.entropy(), atol=1e-5)
    else:
        assert output == pytest.approx(theirs.mean.numpy(), abs=1e-5)
        assert torch.allclose(log_probability, theirs.log_prob(action).sum(-1), atol=1e-5)


def test_checkpoint_restores_networks_and_optimizer(config: PPOConfig) -> None:
    trainer = Ppo(config)
    trainer.update(0, 0.0)
    other = Ppo(replace(config, seed=5))
    other.load(trainer.arrays())
    ours, theirs = trainer.arrays(), other.arrays()
    assert ours.keys() == theirs.keys()
    assert any(name.startswith("optimizer.") for name in ours)
    assert all(np.array_equal(ours[name], theirs[name]) for name in ours)


def test_schedules_reach_the_library_and_the_worlds(config: PPOConfig) -> None:
    trainer = Ppo(replace(config, collision_first=-5.0, collision_last=-20.0, learning_rate=1e-3, entropy_last=0.5))
    trainer.update(0, 1.0)
    assert trainer.model.policy.optimizer.param_groups[0]["lr"] == pytest.approx(5e-5)
    assert trainer.model.ent_coef == 0.5
    assert {simulator.reward_weights.collision for simulator in trainer._simulators} == {-20.0}


@pytest.fixture
def threaded(tmp_path: Path) -> ThreadedPPOConfig:
    """Return a training of a few seconds: worlds on the open floor, four updates."""
    return ThreadedPPOConfig(out=tmp_path, steps=16 * 6 * 4, **SMALL | {"rows": 16, "threads": 2})


def test_clipped_loss_by_hand() -> None:
    ratio, advantage = torch.tensor([1.0, 1.5, 0.5, 1.5, 0.5]), torch.tensor([2.0, 1.0, 1.0, -1.0, -1.0])
    log_ratio = ratio.log().requires_grad_()
    loss, held = clipped_loss(log_ratio, torch.zeros(5), advantage, 0.2)
    # min(r A, clip(r) A): 2, 1.2 (held), 0.5, -1.5, -0.8 (held)
    assert loss.item() == pytest.approx(-(2.0 + 1.2 + 0.5 - 1.5 - 0.8) / 5)
    assert held.item() == pytest.approx(4 / 5)
    loss.backward()
    assert log_ratio.grad is not None
    assert log_ratio.grad.tolist() == pytest.approx([-2.0 / 5, 0.0, -0.5 / 5, 1.5 / 5, 0.0])
    assert torch.stack(joint_scale([torch.tensor([1.0, 2.0]), torch.tensor([3.0])])).tolist() == pytest.approx([2, 1])


@pytest.mark.parametrize("device", [None, "cpu"])
@pytest.mark.parametrize("discrete", [True, False])
def test_draws_match_their_log_probability(discrete: bool, device: str | None) -> None:
    torch.manual_seed(0)
    net = ActorCritic(Network(5, 3, discrete, (16,)), np.array([1.0, -1.0, 0.0], np.float32))
    observation = 3.0 * torch.randn(2, 5).repeat(10_000, 1)
    action, log_probability = net.draw(net.output(observation), rng_of([0], device))
    expected, _ = net.judge(net.output(observation), action)
    assert log_probability.numpy() == pytest.approx(expected.detach().numpy(), abs=1e-5)
    output, drawn = net.output(observation[0]).detach(), action[::2]
    if discrete:
        shares = torch.bincount(drawn, minlength=3) / len(drawn)
        assert shares.tolist() == pytest.approx(output.softmax(-1).tolist(), abs=0.015)
    else:
        assert drawn.mean(0).tolist() == pytest.approx(output.tolist(), abs=0.02)
        assert drawn.std(0).tolist() == pytest.approx(net.log_std.exp().tolist(), rel=0.03)


def test_every_pass_uses_every_row_once(threaded: ThreadedPPOConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    trainer, taken = ThreadedTrainer(replace(threaded, epochs=3)), []
    gradient = trainer.gradient

    def counted(rollout, rows, *rest):  # type: ignore[no-untyped-def]
        taken.append((id(rollout), rows.tolist()))
        return gradient(rollout, rows, *rest)

    monkeypatch.setattr(trainer, "gradient", counted)
    losses = trainer.update(0, 0.0)
    for worker in {name for name, _ in taken}:
        rows = sorted(row for name, part in taken if name == worker for row in part)
        assert rows == sorted(3 * list(range(48)))
    assert losses["clip_fraction"] >= 0.0
    assert losses["entropy"] > 0.0
