"""A training around its updates: folder, budget, log, checkpoints, and a clean stop on Ctrl-C."""

import dataclasses
import importlib.metadata
import os
import shlex
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Self

import numpy as np

from agents.weights_folder import CONFIG, PolicyRecord, save_policy
from train.books import simulator_of
from train.job_files import FileDigests, file_digests
from train.learning import checkpoint
from train.learning.checkpoint import write_card
from train.learning.config import ThreadedConfig, TrainingConfig
from train.learning.floors import HELD_OUT_FLOORS, floor_of
from train.learning.plan_ahead import plan_ahead
from train.learning.progress import Drive, Evaluations, ProgressLog
from train.learning.recipes import by_recipe, reference_of
from train.learning.trainer import Trainer, first_net
from train.reporting.report import tell
from train.reporting.rows import held
from warehouse_env.checked import from_plain
from warehouse_env.errors import ConfigError, WarehouseError, WeightsError
from warehouse_env.files import check_writable
from warehouse_env.old_names import ALGORITHMS
from warehouse_env.plugins import digests

CHECKPOINT = "checkpoint"
LOCK = ".lock"  # in a run's folder, while it is trained in
_MANY_ROWS = 100_000  # whose step takes half a second on a core
_NAMED = 3  # floors that the first line names
_FREE_ON_RESUME = ("resume", "progress")  # options that do not change the schedule


@dataclasses.dataclass
class Position:
    """The progress of a training, as the checkpoint holds it."""

    update: int = 0
    steps: int = 0  # agent-steps
    seconds: float = 0.0
    files: FileDigests = dataclasses.field(default_factory=dict)  # of floors
    code: dict[str, str] = dataclasses.field(default_factory=dict)  # the user's own parts, each with its digest

    @classmethod
    def of(cls, saved: checkpoint.Checkpoint) -> Self:
        """Return that of a checkpoint; earlier versions kept neither files nor digests."""
        return cls(
            **{field.name: saved.data[field.name] for field in dataclasses.fields(cls) if field.name in saved.data}
        )

    def spent(self, config: TrainingConfig) -> float:
        """Return the share of the budget used, 0 to 1."""
        shares = [0.0]
        if config.total_steps is not None:
            shares.append(self.steps / config.total_steps)
        if config.minutes is not None:
            shares.append(self.seconds / (60.0 * config.minutes))
        return min(max(shares), 1.0)


def run_training(config: TrainingConfig, make: Callable[[TrainingConfig], Trainer], drive: Drive) -> Path:
    """Train until the budget is used or a signal stops it; return the run's folder, which is a policy folder.

    make: makes the trainer. drive: see `Evaluations`. SIGINT and SIGTERM take effect once everything is saved.

    Raises ConfigError if the folder holds a run already and `resume` is not given, WeightsError if the run to resume
    has no usable checkpoint or is of another algorithm, WarehouseError if another process trains in the folder or it
    cannot be written.
    """
    with ExitStack() as stack:
        if config.resume is None:
            check_writable(config.directory / CONFIG)
        if config.resume is None or config.resume.is_dir():  # else _begin raises
            stack.enter_context(held(config.directory / LOCK, config.directory))
        config, saved = _begin(config)
        if saved is not None:
            _check_unchanged(config, Position.of(saved))
        _check(config)
        tell(_beginning(config))
        plan_ahead(config)
        trainer = stack.enter_context(closing(make(config)))
        if saved is None:
            position = Position(files=file_digests(config.layouts), code=_code(config))
        else:
            trainer.load(saved.arrays)
            position = Position.of(saved)
        stop = stack.enter_context(stop_signal())
        settings, beside = config.to_dict(), reference_of(config)
        log = stack.enter_context(ProgressLog(config.directory, config.progress, position.steps, settings, beside))
        evaluations = Evaluations(config, drive, None if saved is None else position.update)
        if saved is None:
            _save(config, trainer, position, log.last)  # from here on it can be resumed
            evaluations.run(position.update, position.steps, log)
        _loop(config, trainer, position, log, evaluations, stop)
        _save(config, trainer, position, log.last)
        if not stop.is_set():
            evaluations.run(position.update, position.steps, log)
        if config.progress:
            tell(_split(trainer))
    return config.directory


@contextmanager
def stop_signal() -> Iterator[threading.Event]:
    """Yield an event that Ctrl-C or SIGTERM sets, so that the running update ends; a second signal exits at once.

    At the end the signal is raised again with its usual effect.
    """
    stop = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return

    asked: list[signal.Signals] = []

    def ask(number: int, frame: object) -> None:
        if asked:
            os._exit(130)
        asked.append(signal.Signals(number))
        stop.set()

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if asked:
        signal.raise_signal(asked[0])
        raise KeyboardInterrupt  # where the signal is ignored, as it is in the background of a shell


def _code(config: TrainingConfig) -> dict[str, str]:
    return digests(*config.layouts, config.router, config.tasks, config.sensor or "")


def _check_unchanged(config: TrainingConfig, position: Position) -> None:
    """Raise WeightsError if a floor's files or the user's own code changed since the training began."""
    if not isinstance(position.files, dict):
        raise WeightsError(f"the list of files in the checkpoint of {config.directory} is damaged: start a new run")
    files, code = file_digests(position.files), _code(config)
    for name, known in position.files.items():
        if name not in files:
            raise WeightsError(
                f"{name} is missing, a floor of {config.directory}: resume in the folder where the training began, put "
                "it back, or start a new run"
            )
        if files[name] != known:
            raise WeightsError(
                f"the files of {name} are not those that {config.directory} was trained with: put them back, or start "
                "a new run"
            )
    for name, digest in position.code.items():
        if code.get(name, digest) != digest:
            raise WeightsError(
                f"{name} is not the code that {config.directory} was trained with: restore it, or start a new run"
            )


def _begin(config: TrainingConfig) -> tuple[TrainingConfig, checkpoint.Checkpoint | None]:
    """Check the run's folder; return the config to train with, and the checkpoint to resume from, if any."""
    directory = config.directory
    if config.resume is None:
        if checkpoint.exists(directory / CHECKPOINT) or (directory / CONFIG).exists():
            again = shlex.quote(str(directory))
            raise ConfigError(f"{directory} holds a training already: go on with --resume {again}, or use --name")
        return config, None
    saved = checkpoint.read(directory / CHECKPOINT)
    try:
        trainer = ALGORITHMS.get(saved.data["algorithm"], saved.data["algorithm"])
        if trainer != config.algorithm:
            raise WeightsError(f"{directory} was trained by {trainer}, not by {config.algorithm}")
        stored = from_plain(type(config), saved.data["config"])
    except (KeyError, TypeError) as error:
        raise WeightsError(f"the checkpoint in {directory} lacks the entry {error}") from None
    usual = by_recipe(config.recipe) if config.recipe else type(config)()
    for field in dataclasses.fields(config):
        given, default = getattr(config, field.name), getattr(usual, field.name)
        if field.name not in _FREE_ON_RESUME and given not in (default, getattr(stored, field.name)):
            raise ConfigError(f"--resume goes on with the schedule of {directory}: leave out {field.name}={given!r}")
    kept = {name: getattr(config, name) for name in _FREE_ON_RESUME}
    return dataclasses.replace(stored, **kept), saved


def _check(config: TrainingConfig) -> None:
    """Raise what is wrong with floors, robots, planner and `start`, before anything is printed or compiled."""
    if isinstance(config, ThreadedConfig) and config.device is None and config.rows >= _MANY_ROWS:
        raise ConfigError(f"{config.rows:,} rows are for a GPU: add --device cuda, or take fewer --rows")
    envs = dict.fromkeys(env.replace(layout=floor_of(env.layout, HELD_OUT_FLOORS)) for env, _ in config.worlds(1))
    for env in envs:
        simulator_of(env, 1)
    if isinstance(config, ThreadedConfig):
        first_net(config, env)


def _beginning(config: TrainingConfig) -> str:
    """Return the first line; compiling may delay the next one for a minute."""
    if config.resume is not None:
        return f"goes on with {config.resume}; Ctrl-C stops and keeps what is learned"
    budget = [f"{config.minutes:g} minute{'s' * (config.minutes != 1)}"] if config.minutes is not None else []
    budget += [f"{config.total_steps:,} agent-steps"] if config.total_steps is not None else []
    more = len(config.layouts) - _NAMED
    floors = ", ".join(config.layouts[:_NAMED]) + (f" and {more} more" if more > 0 else "")
    shield = f"{'under' if config.traffic_spec.shield else 'without'} the shield"
    routes = f"{'with' if config.traffic_spec.routes else 'without'} live routes"
    kinds = "" if config.fleet is None else f" (of {config.fleet.words})"
    robots = f"{', '.join(map(str, config.robots))} robots{kinds}"
    return (
        f"trains for {' or '.join(budget)} on {floors} with {robots}, {shield} and {routes}, into {config.directory}; "
        "Ctrl-C stops and keeps what is learned"
    )


def _loop(
    config: TrainingConfig, trainer: Trainer, position: Position, log: ProgressLog, evaluations: Evaluations,
    stop: threading.Event,
) -> None:  # fmt: skip
    begun, saved = time.monotonic() - position.seconds, time.monotonic()
    while (spent := position.spent(config)) < 1.0 and not stop.is_set():
        losses = _update(config, trainer, position, spent)
        position.update += 1
        position.steps += trainer.rows * trainer.rollout
        position.seconds = time.monotonic() - begun
        log.update(position.steps, position.seconds, position.spent(config), trainer.take_figures, losses)
        if (due := evaluations.due) or time.monotonic() - saved >= config.checkpoint_seconds:
            _save(config, trainer, position, log.last)
            saved = time.monotonic()
        if due:  # of what was just saved
            evaluations.run(position.update, position.steps, log)


def _update(config: TrainingConfig, trainer: Trainer, position: Position, spent: float) -> dict[str, float]:
    """Return an update's losses. WarehouseError if it leaves weights that are not finite; nothing is saved then."""
    try:
        losses, failed = trainer.update(position.update, spent), None
    except ValueError as error:  # torch does not draw from what is no number
        losses, failed = {}, error
    if not all(np.isfinite(tensor).all() for tensor in trainer.policy_tensors().values()):
        raise WarehouseError(
            f"update {position.update} of {config.directory} left weights that are not finite, after "
            f"{position.steps:,} agent-steps; the folder holds the last good ones: try a smaller --learning-rate, or "
            "--gradient-clip"
        )
    if failed is not None:
        raise failed
    return losses


def _save(config: TrainingConfig, trainer: Trainer, position: Position, figures: dict[str, float]) -> None:
    """Write the checkpoint, the current policy and its card."""
    plain = {key: value for key, value in config.to_dict().items() if key != "resume"}
    data = {"algorithm": config.algorithm, "config": plain, **dataclasses.asdict(position)}
    directory = config.directory
    checkpoint.write(directory / CHECKPOINT, trainer.arrays(), data)
    versions = {name: importlib.metadata.version(name) for name in ("torch", "numpy", "numba")} | _code(config)
    training = {
        "steps": position.steps, "updates": position.update, "seconds": round(position.seconds, 1),
        "spent": position.spent(config), "config": plain, "last_figures": figures, "versions": versions,
    }  # fmt: skip
    record = PolicyRecord(config.algorithm, trainer.network, config.driven(trainer.env), config.mode, training)
    save_policy(directory, record, trainer.policy_tensors())
    write_card(directory)


def _split(trainer: Trainer) -> str:
    """Return a line that says where the time went."""
    parts = trainer.split.seconds
    total = max(sum(parts.values()), 1e-9)
    shares = ", ".join(f"{name.removesuffix('_s')} {100 * value / total:.0f}%" for name, value in parts.items())
    return f"the time went to: {shares}"
