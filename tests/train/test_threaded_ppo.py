"""Our PPO: the clipped loss by hand, drawn probabilities, and every row once a pass."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from agents.networks import ActorCritic
from agents.weights_folder import Network
from tests.train.trainings import SMALL
from train.learning.config import ThreadedPPOConfig
from train.learning.threaded import joint_scale
from train.learning.trainer import rng_of
from train.threaded_ppo import ThreadedPpo, clipped_loss


@pytest.fixture
def config(tmp_path: Path) -> ThreadedPPOConfig:
    """Return a training of some seconds: worlds on the open floor, four updates."""
    return ThreadedPPOConfig(out=tmp_path, steps=16 * 6 * 4, **SMALL | {"rows": 16, "threads": 2})


def test_the_clipped_loss_by_hand() -> None:
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
def test_a_draw_comes_with_its_log_probability(discrete: bool, device: str | None) -> None:
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


def test_every_pass_takes_every_row_once(config: ThreadedPPOConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    trainer, taken = ThreadedPpo(replace(config, epochs=3)), []
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
