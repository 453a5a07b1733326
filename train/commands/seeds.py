"""`warehouse train ... --seeds 5`: the same training under several seeds, and a table of how the policies drive."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

from agents.weights_folder import read_record
from train.held_out import held_out
from train.learning import checkpoint
from train.learning.config import TrainingConfig
from train.learning.progress import FIGURES
from train.learning.training_run import CHECKPOINT, is_done
from train.reporting.report import Table, make_progress, number, tell, with_interval
from train.reporting.rows import mean_interval
from warehouse_env.errors import ConfigError

_GOES_ON = "the same command goes on from the checkpoints"


def of_seeds(config: TrainingConfig, seeds: int) -> list[TrainingConfig]:
    """Return the training under `seeds` seeds from its own on, each in its own folder."""
    if config.resume is not None:
        raise ConfigError(f"--resume must be left out with --seeds {seeds}: {_GOES_ON}")
    return [
        dataclasses.replace(config, seed=config.seed + k, name=f"{config.name}-{config.seed + k}") for k in range(seeds)
    ]


def train_missing(train: Callable[[TrainingConfig], object], configs: Sequence[TrainingConfig]) -> None:
    """Train what is not trained yet, one after the other."""
    for config in [one for one in configs if not is_done(one)]:
        begun = checkpoint.exists(config.directory / CHECKPOINT)
        tell(f"seed {config.seed}")
        try:
            train(type(config)(resume=config.directory, progress=config.progress) if begun else config)
        except KeyboardInterrupt as stop:
            raise type(stop)(_GOES_ON) from None


def seeds_table(configs: Sequence[TrainingConfig]) -> Table:
    """Drive all policies on the same held-out seeds; return a line for each seed, the best one marked, and the mean."""
    with make_progress() as progress:
        bar = progress.add_task("held-out episodes", total=len(configs))
        driven = []
        for config in configs:
            driven.append(held_out(config))
            progress.advance(bar)
    best = max(range(len(configs)), key=lambda k: driven[k][FIGURES[0]])
    cells = []
    for k, (config, figures) in enumerate(zip(configs, driven, strict=True)):
        training = read_record(config.directory).training
        cells.append((
            f"{config.seed}{' (best)' * (k == best)}", f"{training['steps']:,}", number(training["seconds"] / 60, 2),
            *_shown([figures]), str(config.directory),
        ))  # fmt: skip
    cells.append(("mean", "", "", *_shown(driven), ""))
    header = ("seed", "agent-steps", "minutes", "goals/robot-h", "collisions/km", "stuck %", "folder")
    note = (
        "Each policy on the same three held-out episodes; mean over seeds [95% interval by Student's t]. These "
        "episodes also chose the best one, so drive it on others before you rely on it (warehouse evaluate)."
    )
    return Table("Trainings", header, tuple(cells), note)


def _shown(driven: Sequence[dict[str, float]]) -> list[str]:
    factors = {"stuck": 100.0}
    return [with_interval(mean_interval(one[name] for one in driven), factors.get(name, 1.0)) for name in FIGURES]
