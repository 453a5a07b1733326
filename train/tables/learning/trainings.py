"""The trainings whose policies are compared: some seeds of each algorithm, and the start before any update."""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Iterator
from pathlib import Path

from agents.weights_folder import CONFIG
from train.learning import checkpoint
from train.learning.config import PPOConfig, ReinforceConfig, ThreadedPPOConfig, TrainingConfig
from train.learning.training_run import CHECKPOINT
from warehouse_env.errors import ConfigError

START = "start"
ALGORITHMS: dict[str, tuple[str, type[TrainingConfig]]] = {  # name -> module with `train`, options
    "reinforce": ("train.reinforce", ReinforceConfig),
    "ppo": ("train.ppo", PPOConfig),  # stable-baselines3's
    "threaded_ppo": ("train.threaded_ppo", ThreadedPPOConfig),
}


def configs(folder: Path, seeds: range, steps: int) -> dict[str, list[TrainingConfig]]:
    """Return the trainings by algorithm, and as START the one that ends before it has learned anything.

    steps: agent-steps of each training. Each has one thread, for what is learned depends on how many there are: so the
    table is the same whatever the machine's cores.
    """
    made: dict[str, list[TrainingConfig]] = {
        name: [config(name=f"{name}-{seed}", out=folder, seed=seed, steps=steps, threads=1) for seed in seeds]
        for name, (_, config) in ALGORITHMS.items()
    }
    return {START: [ReinforceConfig(name=START, out=folder, steps=1, learning_rate=1e-12, threads=1)], **made}


def train_missing(trainings: dict[str, list[TrainingConfig]]) -> Iterator[str]:
    """Train what is not trained yet, and go on where a training was stopped; yield a line before each begins.

    Raises KeyboardInterrupt if a training was stopped before its end.
    """
    for algorithm, group in trainings.items():
        module = importlib.import_module(ALGORITHMS.get(algorithm, ALGORITHMS["reinforce"])[0])
        for config in group:
            if _is_done(config):
                continue
            yield f"training {config.name}: {config.steps:,} agent-steps"
            begun = checkpoint.exists(config.directory / CHECKPOINT)
            module.train(type(config)(resume=config.directory, progress=config.progress) if begun else config)
            if not _is_done(config):
                raise KeyboardInterrupt(f"the same command goes on with {config.directory}")


def _is_done(config: TrainingConfig) -> bool:
    if not (config.directory / CONFIG).exists() or not checkpoint.exists(config.directory / CHECKPOINT):
        return False
    saved = checkpoint.read(config.directory / CHECKPOINT).data
    stored = type(config).from_dict(saved["config"])
    if dataclasses.replace(stored, resume=None) != config:
        raise ConfigError(f"{config.directory} was trained with other options: name another --out, or remove it")
    return bool(config.steps is not None and saved["steps"] >= config.steps)
