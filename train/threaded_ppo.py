"""Our own proximal policy optimisation: the clipped loss in the threads of `train reinforce`.

Schulman et al. 2017, "Proximal policy optimization algorithms", eq. 7: ascend E[min(r A, clip(r, 1 - e, 1 + e) A)] with
the ratio r = pi(a | o) / pi_old(a | o), in some passes over each rollout. Unlike `train ppo` (stable-baselines3) it
plays worlds on all threads at once, computes the critic's values in one pass, and resumes to the same bits.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import torch
from torch import Tensor

from train.held_out import held_out
from train.learning.config import ThreadedPPOConfig
from train.learning.threaded import ThreadedTrainer
from train.learning.training_run import run_training


class ThreadedPpo(ThreadedTrainer):
    """The trainer: some passes over the rows of each rollout, with the ratio clipped."""

    def __init__(self, config: ThreadedPPOConfig) -> None:
        super().__init__(config, partial(clipped_loss, clip=config.clip))
        self.epochs = config.epochs


def clipped_loss(log_probability: Tensor, old: Tensor, advantage: Tensor, clip: float) -> tuple[Tensor, Tensor]:
    """Return -E[min(r A, clip(r) A)] (eq. 7), and the share of rows whose ratio is clipped (see `ActorLoss`)."""
    ratio = (log_probability - old).exp()
    within = ratio.clamp(1.0 - clip, 1.0 + clip)
    loss = -torch.minimum(ratio * advantage, within * advantage).mean()
    return loss, ((ratio - 1.0).abs() > clip).float().mean()


def train(config: ThreadedPPOConfig) -> Path:
    """Train by `config`; return the run's folder, a policy folder (errors: `run_training`)."""
    return run_training(config, ThreadedPpo, held_out)
