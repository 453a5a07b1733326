"""REINFORCE over the next action command, with a learned value as baseline; all robots share one policy.

Williams 1992, "Simple statistical gradient-following algorithms": ascend E[A grad log pi(a | o)]. Every row is used
once, so the data are on-policy except for the few gradient steps within an update: no ratio, no clip.
"""

from __future__ import annotations

from pathlib import Path

from torch import Tensor

from train.held_out import held_out
from train.learning.config import ReinforceConfig
from train.learning.threaded import ThreadedTrainer
from train.learning.training_run import run_training


class Reinforce(ThreadedTrainer):
    """The trainer: one pass over the rows of each rollout."""

    def __init__(self, config: ReinforceConfig) -> None:
        super().__init__(config, policy_loss)


def policy_loss(log_probability: Tensor, old: Tensor, advantage: Tensor) -> tuple[Tensor, Tensor]:
    """Return -E[A log pi] and 0, for no row is held back (see `ActorLoss`)."""
    return -(advantage * log_probability).mean(), advantage.new_zeros(())


def train(config: ReinforceConfig) -> Path:
    """Train by `config`; return the run's folder, a policy folder (errors: `run_training`)."""
    return run_training(config, Reinforce, held_out)
