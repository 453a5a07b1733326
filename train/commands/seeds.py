"""`warehouse train ... --seeds 5`: the same training under several seeds, here or on a cluster; a table."""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

from agents.weights_folder import read_record
from train.evaluation.cluster import joined, streams
from train.evaluation.kernels import compile_missing
from train.held_out import held_out
from train.job_files import pack
from train.learning import checkpoint
from train.learning.away import content_of, train_away, write
from train.learning.board import FIGURES
from train.learning.config import TrainingConfig
from train.learning.training_run import CHECKPOINT, LOCK, is_done
from train.own import taken_in
from train.reporting.lock import held
from train.reporting.report import Table, make_progress, number, tell, with_interval
from train.reporting.rows import mean_interval
from warehouse_env.errors import ConfigError, LostError

_GOES_ON = "the same command goes on from the checkpoints"


def of_seeds(config: TrainingConfig, seeds: int) -> list[TrainingConfig]:
    """Return the training under so many seeds from its own on, each with a folder of its own."""
    if config.resume is not None:
        raise ConfigError(f"--resume must be left out with --seeds {seeds}: {_GOES_ON}")
    return [
        dataclasses.replace(config, seed=config.seed + k, name=f"{config.name}-{config.seed + k}") for k in range(seeds)
    ]


def train_here(module: str, configs: Sequence[TrainingConfig]) -> None:
    """Train what is not trained yet, one after the other."""
    train = importlib.import_module(module).train
    for config in [one for one in configs if not is_done(one)]:
        begun = checkpoint.exists(config.directory / CHECKPOINT)
        tell(f"seed {config.seed}")
        try:
            train(type(config)(resume=config.directory, progress=config.progress) if begun else config)
        except KeyboardInterrupt as stop:
            raise type(stop)(_GOES_ON) from None


def train_on_cluster(module: str, configs: Sequence[TrainingConfig], address: str) -> None:
    """Train what is not trained yet side by side, each on as many cores of a node as it has threads."""
    if configs[0].out.is_absolute():
        raise ConfigError(f"--out {configs[0].out} must be relative: other machines have folders of their own")
    missing = [config for config in configs if not is_done(config)]
    if not missing:
        return

    def begin(which: int) -> tuple[Any, ...]:
        config = missing[which]
        return module, config, content_of(config.directory), pack(config.layouts), taken_in()

    with ExitStack() as stack:
        for config in missing:
            stack.enter_context(held(config.directory / LOCK, config.directory))
        ray = stack.enter_context(joined(address, compile_missing))
        progress = stack.enter_context(make_progress())
        names = [f"seed {config.seed}" for config in missing]
        bars = [progress.add_task(name, total=100) for name in names]
        try:
            for which, changes in streams(ray, train_away, missing[0].threads, names, begin):
                write(missing[which].directory, changes)
                spent = read_record(missing[which].directory).training["spent"]
                progress.update(bars[which], completed=round(100 * spent))
        except KeyboardInterrupt as stop:
            raise type(stop)(_GOES_ON) from None
        except LostError as error:
            raise LostError(f"{error}; {_GOES_ON}") from None


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
        "Each policy on the same three held-out episodes; mean over seeds [95% interval by Student's t]. The best was "
        "chosen by these very episodes: before you rely on it, drive it on others (warehouse evaluate)."
    )
    return Table("Trainings", header, tuple(cells), note)


def _shown(driven: Sequence[dict[str, float]]) -> list[str]:
    factors = {"stuck": 100.0}
    return [with_interval(mean_interval(one[name] for one in driven), factors.get(name, 1.0)) for name in FIGURES]
