"""Trainings that begin with a policy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from agents.networks import begin_with
from agents.weights_folder import PolicyRecord, save_policy
from tests.train.trainings import SMALL
from train.learning.config import ThreadedPPOConfig
from train.learning.threaded import ThreadedTrainer
from warehouse_env.errors import ConfigError, WeightsError


@pytest.fixture
def config(tmp_path: Path) -> ThreadedPPOConfig:
    """Return a training of some seconds."""
    return ThreadedPPOConfig(out=tmp_path, steps=16 * 6 * 4, **SMALL | {"rows": 16, "threads": 1})


def saved(trainer: ThreadedTrainer, config: ThreadedPPOConfig, folder: Path) -> Path:
    """Save what a trainer has learned."""
    record = PolicyRecord("ours", trainer.network, config.driven(trainer.env))
    return save_policy(folder, record, trainer.policy_tensors())


def test_a_training_begins_with_a_policy(config: ThreadedPPOConfig, tmp_path: Path) -> None:
    first = ThreadedTrainer(config)
    first.update(0, 0.0)
    seen = torch.randn(10, first.network.observation_size)
    started = ThreadedTrainer(replace(config, start=str(saved(first, config, tmp_path / "first"))))
    assert torch.equal(started.net.output(seen), first.net.output(seen))
    assert torch.equal(started.net.value(seen), first.net.value(seen))
    actor = {name: array for name, array in first.policy_tensors().items() if not name.startswith("critic.")}
    begin_with(started.net, actor)
    wide = ThreadedTrainer(replace(config, hidden=(40, 40)))
    with pytest.raises(ConfigError, match=r"actor\.0\.weight"):
        begin_with(wide.net, actor)
    with pytest.raises(ConfigError, match="rule"):
        ThreadedTrainer(replace(config, start="brake"))


def test_a_policy_of_other_senses_is_no_beginning(config: ThreadedPPOConfig, tmp_path: Path) -> None:
    folder = saved(ThreadedTrainer(replace(config, predictions=False)), config, tmp_path / "blind")
    with pytest.raises(WeightsError, match=r"112|112 values|made for"):
        ThreadedTrainer(replace(config, start=str(folder)))


def test_the_update_judges_the_decisions_of_the_rollout(
    config: ThreadedPPOConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Until the first step the probabilities are those of the draws."""
    trainer = ThreadedTrainer(replace(config, minibatch=1000))

    def compared(log_probability: Tensor, old: Tensor, advantage: Tensor) -> tuple[Tensor, Tensor]:
        assert torch.allclose(log_probability, old, atol=1e-5)
        return (advantage * log_probability).mean(), advantage.new_zeros(())

    monkeypatch.setattr(trainer, "_actor_loss", compared)
    monkeypatch.setattr(trainer, "epochs", 1)
    with torch.no_grad():
        for parameter in trainer.net.actor_parameters():
            parameter.add_(0.3 * torch.randn_like(parameter))
    for number in range(2):
        trainer.update(number, 0.0)
