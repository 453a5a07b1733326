"""`warehouse train reinforce`, `ppo` and `threaded_ppo`: the trainers' own options, and --json like everywhere."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from train.learning.config import PPOConfig, ReinforceConfig, ThreadedPPOConfig
from train.reporting.rows import RowFile, read_rows

_ROWS = "progress.jsonl"  # in a run's folder


@dataclass(frozen=True)
class TrainReinforce:
    """Train our policy gradient: REINFORCE over the next action command, with a learned value as baseline."""

    config: Annotated[ReinforceConfig, tyro.conf.arg(name="")] = field(default_factory=ReinforceConfig)
    json: Path | None = None
    """Also write the rows of the training's progress to this file as JSON lines."""

    def run(self) -> None:
        """Train; torch is imported here."""
        from train.reinforce import train

        _train(lambda: train(self.config), self.json)


@dataclass(frozen=True)
class TrainPPO:
    """Train proximal policy optimisation, by stable-baselines3."""

    config: Annotated[PPOConfig, tyro.conf.arg(name="")] = field(default_factory=PPOConfig)
    json: Path | None = None
    """Also write the rows of the training's progress to this file as JSON lines."""

    def run(self) -> None:
        """Train; torch and stable-baselines3 are imported here."""
        from train.ppo import train

        _train(lambda: train(self.config), self.json)


@dataclass(frozen=True)
class TrainThreadedPPO:
    """Train proximal policy optimisation of our own, in threads as REINFORCE is."""

    config: Annotated[ThreadedPPOConfig, tyro.conf.arg(name="")] = field(default_factory=ThreadedPPOConfig)
    json: Path | None = None
    """Also write the rows of the training's progress to this file as JSON lines."""

    def run(self) -> None:
        """Train; torch is imported here."""
        from train.threaded_ppo import train

        _train(lambda: train(self.config), self.json)


def _train(train: Callable[[], Path], json: Path | None) -> None:
    file = RowFile(json)
    file.add(read_rows(train() / _ROWS))
