"""The trainers behind `warehouse train`, each by the kind of its options."""

from __future__ import annotations

from pathlib import Path

from train.held_out import held_out
from train.learning.config import PPOConfig, ThreadedConfig, TrainingConfig
from train.learning.evaluations import Drive
from train.learning.threaded import ThreadedTrainer
from train.learning.trainer import Trainer
from train.learning.training_run import run_training


def trainer_of(config: TrainingConfig) -> Trainer:
    """Make the trainer that has these options."""
    if isinstance(config, PPOConfig):
        from train.ppo import Ppo  # needs stable-baselines3

        return Ppo(config)
    assert isinstance(config, ThreadedConfig)
    return ThreadedTrainer(config)


def train(config: TrainingConfig, drive: Drive = held_out) -> Path:
    """Train by `config`; return the run's folder, a policy folder (drive, errors: `run_training`)."""
    return run_training(config, trainer_of, drive)
