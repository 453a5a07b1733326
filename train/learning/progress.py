"""The progress of a training: counts, spaced evaluations, a bar or lines, progress.jsonl, and TensorBoard's log."""

import math
import time
from collections import defaultdict, deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from train.learning.config import TrainingConfig
from train.learning.recipes import QUANTILES, Reference
from train.reporting.report import tell
from train.reporting.rows import Row, RowFile, whole_rows, write_rows

_ENDS = 50  # last ended worlds, for the share that jammed


class TrainingTally:
    """Sums over the agent-steps of some simulators; pairs count once."""

    def __init__(self, simulators: Sequence[Any]) -> None:
        self._simulators, self._sums = simulators, defaultdict[str, Any](float)
        self._ends = deque[bool](maxlen=_ENDS)

    def add(self) -> None:
        """Count the step just made; on a device without waiting for it."""
        sums = self._sums
        for simulator in self._simulators:
            events, (driven, planned) = simulator.fields["events"], simulator.lengths()
            sums["steps"] += simulator.num_worlds * simulator.num_agents
            sums["goals"] += events["arrived"].sum()
            sums["collisions"] += events["hit_robot"].sum() / 2 + events["hit_shelf"].sum() + events["hit_person"].sum()
            sums["metres"] += events["driven"].sum()
            sums["reward"] += simulator.reward.sum()
            sums["driven"] += driven  # [m], for the goals reached
            sums["planned"] += planned  # [m], likewise
            sums["stuck"] += simulator.stuck
            self._ends.extend(simulator.ends)

    def take(self) -> tuple[dict[str, float], list[bool]]:
        """Return the sums since the last call, and whether each of the last worlds that ended had jammed."""
        sums, self._sums = self._sums, defaultdict(float)
        return {name: float(value) for name, value in sums.items()}, list(self._ends)


def figures_of(tallies: Sequence[TrainingTally], decision_seconds: float) -> dict[str, float]:
    """Take the sums of some tallies and return what the progress bar and the log show of them together."""
    sums, ends = defaultdict[str, float](float), list[bool]()
    for taken, last in map(TrainingTally.take, tallies):
        ends += last
        for name, value in taken.items():
            sums[name] += value
    hours, steps = sums["steps"] * decision_seconds / 3600.0, max(sums["steps"], 1)
    return {
        "reward": sums["reward"] / steps,
        "goals_per_robot_hour": sums["goals"] / hours if hours else 0.0,
        "collisions_per_km": 1000.0 * sums["collisions"] / max(sums["metres"], 1.0),
        "path_length_ratio": sums["driven"] / max(sums["planned"], 1.0),
        "stuck": sums["stuck"] / steps,
        "worlds_jammed": sum(ends) / max(len(ends), 1),  # a share of
        "worlds_ended": float(len(ends)),
    }


ROWS = "progress.jsonl"
LOG_SECONDS = 5.0  # between two rows
LINE_SECONDS = 60.0  # between two lines where no bar is shown
FIGURES = ("goals_per_robot_hour", "collisions_per_km", "stuck")  # of an evaluation on held-out seeds


def _steps(row: Row) -> float:
    """Return the agent-steps of a row, inf where it tells none."""
    steps = row.get("steps")
    return steps if isinstance(steps, (int, float)) else math.inf


class ProgressLog:
    """Writes averages over some seconds of updates to the bar, to rows, whose last is `last`, and to TensorBoard."""

    def __init__(
        self, directory: Path, show: bool, steps: int, settings: Mapping[str, Any] = {}, beside: Reference | None = None
    ) -> None:
        """Open the log of the run in `directory`.

        show: the bar, where there is a terminal. steps: agent-steps done before; later rows of a broken run go.
        settings: of the training, for TensorBoard. beside: other trainings, shown in lines and in TensorBoard.
        """
        path = directory / ROWS
        write_rows(path, [row for row in whole_rows(path) if _steps(row) <= steps])
        self._rows = RowFile(path, keep=True)
        self.last: dict[str, float] = {}
        self._console = Console(stderr=True)
        self._bare = not (show and self._console.is_terminal)
        columns = (BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), TextColumn("{task.fields[text]}"))
        self._bar = Progress(*columns, console=self._console, disable=self._bare)
        self._task = self._bar.add_task("training", total=1.0, text="first rollout")
        self._board = open_board(directory / "tensorboard", settings, steps)
        self._beside = beside
        if self._board is not None and beside is not None and not steps:
            _draw(beside, directory / "tensorboard")
        if self._board is None:
            tell('no TensorBoard log: for one, pip install "warehouse-env[train]"', self._console)
        self._since, self._steps, self._losses = time.monotonic(), steps, []  # type: tuple[float, int, list[dict[str, float]]]
        self._told = self._since

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._bar.stop()
        if self._board is not None:
            self._board.close()

    def update(
        self, steps: int, seconds: float, spent: float, figures: Callable[[], dict[str, float]],
        losses: dict[str, float],
    ) -> None:  # fmt: skip
        """Note one update; every LOG_SECONDS, and at the end of the budget, a row is written.

        steps, seconds: agent-steps and time of training in all. spent: share of the budget, 0 to 1. figures: gives what
        happened in the worlds since its last call; called with each row. losses: figures of this update alone.
        """
        self._losses.append(losses)
        self._bar.update(self._task, completed=spent)
        now = time.monotonic()
        if now - self._since < LOG_SECONDS and spent < 1.0:
            return
        rate = (steps - self._steps) / max(now - self._since, 1e-9)
        means = {key: sum(one[key] for one in self._losses) / len(self._losses) for key in losses}
        self.last = {"steps_per_second": rate, **figures(), **means}
        self._rows.add([{"steps": steps, "seconds": seconds, "spent": spent, **self.last}])
        self._add("train", self.last, steps)
        self._since, self._steps, self._losses = now, steps, []
        text = f"{steps / 1e6:.2f} M, {rate:,.0f} steps/s, {_in_words(self.last)}"
        ended = self.last["worlds_ended"]
        text += f", {ended * self.last['worlds_jammed']:.0f} of the last {ended:.0f} worlds reset for a jam"
        self._bar.update(self._task, text=text)
        if (self._bare and now - self._told >= LINE_SECONDS) or (self._beside is not None and spent >= 1.0):
            tell(f"{100 * spent:.0f}% after {seconds:.0f} s: {text}{self._others(steps)}", self._console)
            self._told = now

    def _others(self, steps: int) -> str:
        """Return how the other trainings stood after as many steps, if there are any."""
        if self._beside is None:
            return ""
        low, high = (_in_words(self._beside.at(name, steps)) for name in ("low", "high"))
        return f"; the middle 90% of {self._beside.trainings} shipped trainings: {low} to {high}"

    def evaluated(self, figures: Mapping[str, float], steps: int, seconds: float) -> None:
        """Log how the policy drove on held-out seeds after `steps` agent-steps; seconds: the time that this took."""
        self._since += seconds  # not the training's own
        self._add("held_out", figures, steps)
        tell(f"held-out seeds after {steps / 1e6:.2f} M, in {seconds:.1f} s: {_in_words(figures)}", self._console)

    def _add(self, group: str, figures: Mapping[str, float], steps: int) -> None:
        """Write figures to TensorBoard's log, if there is one."""
        for name, value in figures.items() if self._board is not None else ():
            self._board.add_scalar(f"{group}/{name}", value, steps)


def open_board(directory: Path, settings: Mapping[str, Any], steps: int) -> Any:
    """Open TensorBoard's log and write the settings of the training as a text; None if it is not installed.

    steps: agent-steps done before; what a broken run wrote of later ones is hidden.
    """
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        return None
    writer = SummaryWriter(str(directory), purge_step=steps + 1 if steps else None)
    writer.add_text("settings", "".join(f"- {name}: {value}\n" for name, value in settings.items()))
    return writer


def _draw(beside: Reference, folder: Path) -> None:
    """Write other trainings into TensorBoard's log, each quantile as a run."""
    for name in QUANTILES:
        board = open_board(folder / f"shipped_{name}", {"trainings": beside.trainings}, 0)
        for steps in beside.steps:
            for figure, value in beside.at(name, steps).items():
                board.add_scalar(f"train/{figure}", value, steps)
        board.close()


def _in_words(figures: Mapping[str, float]) -> str:
    goals, contacts, stuck = (figures[name] for name in FIGURES)
    return f"{goals:.0f} goals/robot-h, {contacts:.2f} collisions/km, {100 * stuck:.1f}% stuck"


SHARE = 0.03  # of the processor time, at most, from one to the next

Drive = Callable[[TrainingConfig], dict[str, float]]
"""Drives the policy in the folder of a training; returns FIGURES of progress.py."""


class Evaluations:
    """Drives the policy of a training from time to time and logs the result, without changing what is learned."""

    def __init__(self, config: TrainingConfig, drive: Drive, update: int | None) -> None:
        """Start the clock; update: after which the policy was driven last, if any."""
        self._config, self._drive, self._update = config, drive, update
        self._ended, self._took = (time.monotonic(), time.process_time()), 0.0

    @property
    def due(self) -> bool:
        """Whether the next evaluation is due."""
        every, (since, worked_since) = self._config.evaluation_seconds, self._ended
        worked = time.process_time() - worked_since  # of all threads; where others take the cores, it grows slowly
        return every > 0.0 and time.monotonic() - since >= every and worked * SHARE >= self._took

    def run(self, update: int, steps: int, log: ProgressLog) -> None:
        """Drive the policy that was saved after an update and `steps` agent-steps, unless this was done already."""
        if self._config.evaluation_seconds == 0.0 or update == self._update:
            return
        begun, worked = time.monotonic(), time.process_time()
        figures = self._drive(self._config)
        self._ended, self._update = (time.monotonic(), time.process_time()), update
        self._took = self._ended[1] - worked
        log.evaluated(figures, steps, self._ended[0] - begun)
