"""`warehouse train reinforce`, `ppo` and `threaded_ppo`: the trainers' own options, and --json like everywhere."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, TypeVar

import tyro

from agents.weights_folder import read_record
from train.learning.config import PPOConfig, ReinforceConfig, ThreadedPPOConfig, TrainingConfig
from train.reporting.rows import RowFile, read_rows

_ROWS = "progress.jsonl"  # in a run's folder

Config = TypeVar("Config", bound=TrainingConfig)


@dataclass(frozen=True)
class TrainReinforce:
    """Train our policy gradient: REINFORCE over the next action command, with a learned value as baseline."""

    config: Annotated[ReinforceConfig, tyro.conf.arg(name="")] = field(default_factory=ReinforceConfig)
    json: Path | None = None
    """Also write the rows of the training's progress to this file as JSON lines."""

    def run(self) -> None:
        """Train; torch is imported here."""
        from train.reinforce import train

        _train(self.config, train, self.json)


@dataclass(frozen=True)
class TrainPPO:
    """Train proximal policy optimisation, by stable-baselines3."""

    config: Annotated[PPOConfig, tyro.conf.arg(name="")] = field(default_factory=PPOConfig)
    json: Path | None = None
    """Also write the rows of the training's progress to this file as JSON lines."""

    def run(self) -> None:
        """Train; torch and stable-baselines3 are imported here."""
        from train.ppo import train

        _train(self.config, train, self.json)


@dataclass(frozen=True)
class TrainThreadedPPO:
    """Train proximal policy optimisation of our own, in threads as REINFORCE is."""

    config: Annotated[ThreadedPPOConfig, tyro.conf.arg(name="")] = field(default_factory=ThreadedPPOConfig)
    json: Path | None = None
    """Also write the rows of the training's progress to this file as JSON lines."""

    def run(self) -> None:
        """Train; torch is imported here."""
        from train.threaded_ppo import train

        _train(self.config, train, self.json)


def _train(config: Config, train: Callable[[Config], Path], json: Path | None) -> None:
    """Train; the last line says what was written and where."""
    file = RowFile(json)
    directory = train(config)
    file.add(read_rows(directory / _ROWS))
    print(_end(directory, json))


def _end(directory: Path, json: Path | None) -> str:
    """Return the closing line: figures of the training, and what lies where."""
    training = read_record(directory).training
    command = read_record(directory).algorithm
    rest = "" if training["spent"] >= 1 else f"; go on with `warehouse train {command} --resume {directory}`"
    rows = "" if json is None else f", the rows to {json}"
    return (
        f"{training['steps']:,} agent-steps in {training['seconds']:.0f} s; wrote the policy, its card and its log to "
        f"{directory}{rows}{rest}"
    )
