"""The trainers behind `warehouse train`, each by the kind of its options."""

from pathlib import Path
from statistics import fmean

from train.evaluation.rollout import make_experiment, run
from train.learning.config import PPOConfig, ThreadedConfig, TrainingConfig
from train.learning.floors import HELD_OUT_FLOORS, floor_of
from train.learning.progress import FIGURES, Drive
from train.learning.threaded import ThreadedTrainer
from train.learning.trainer import Trainer
from train.learning.training_run import run_training

SEED = 900_000_000  # far above those of trainings and those that `warehouse evaluate` begins with
_EPISODES = 3  # on the first floors of the training, in turn


def held_out(config: TrainingConfig) -> dict[str, float]:
    """Drive the policy in the folder of a training with its own options; return the means of FIGURES.

    Three episodes, as long as those of the training, on its first floors in turn, with its largest number of robots.
    """
    rows = []
    for number in range(_EPISODES):
        floor = floor_of(config.layouts[number % len(config.layouts)], HELD_OUT_FLOORS + number)
        base = config.env(floor, max(config.robots))
        rows += run(make_experiment(str(config.directory), base, 1, config.episode_seconds, SEED + number))
    return {name: fmean(row[name] for row in rows) for name in FIGURES}


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
