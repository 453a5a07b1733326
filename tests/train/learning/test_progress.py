"""Test what a training shows: progress lines, TensorBoard's log, and periodic evaluations."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.train.trainings import SMALL
from train.learning import progress, training_run
from train.learning.config import PPOConfig, ReinforceConfig, ThreadedPPOConfig, TrainingConfig
from train.learning.progress import FIGURES, Evaluations, ProgressLog, open_board
from train.learning.recipes import Reference
from train.trainers import held_out, train

ROW = {
    "reward": 0.1, "goals_per_robot_hour": 122.0, "collisions_per_km": 0.236, "stuck": 0.3754, "worlds_jammed": 0.5,
    "worlds_ended": 8.0,
    "path_length_ratio": 1.1,
}  # fmt: skip


def log_of(folder: Path) -> Any:
    events = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    log = events.EventAccumulator(str(folder))
    log.Reload()
    return log


def test_progress_line_shows_stuck_robots_collisions_and_jams(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "LOG_SECONDS", 0.0)
    monkeypatch.setattr(progress, "LINE_SECONDS", 0.0)
    with ProgressLog(tmp_path, False, 0) as log:
        log.update(1_500_000, 60.0, 0.5, lambda: ROW, {"entropy": 1.0})
        log.evaluated({"goals_per_robot_hour": 99.6, "collisions_per_km": 0.0, "stuck": 0.0625}, 1_500_000, 2.0)
    first, second = capsys.readouterr().err.splitlines()
    assert first.startswith("50% after 60 s: 1.50 M, ")
    assert first.endswith("122 goals/robot-h, 0.24 collisions/km, 37.5% stuck, 4 of the last 8 worlds reset for a jam")
    assert second == "held-out seeds after 1.50 M, in 2.0 s: 100 goals/robot-h, 0.00 collisions/km, 6.2% stuck"


OTHERS = Reference(
    {}, 5, [150, 300],
    {"low": {name: [1.0, 2.0] for name in FIGURES}, "median": {name: [3.0, 4.0] for name in FIGURES},
     "high": {name: [5.0, 6.0] for name in FIGURES}},
)  # fmt: skip


def test_progress_shows_reference_trainings_at_equal_steps(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The reference appears in every line, or once at the end after a progress bar."""
    monkeypatch.setattr(progress, "LOG_SECONDS", 0.0)
    for beside, lines, seconds in ((OTHERS, 2, 0.0), (OTHERS, 1, 1e9), (None, 0, 1e9)):
        monkeypatch.setattr(progress, "LINE_SECONDS", seconds)
        with ProgressLog(tmp_path, False, 0, {}, beside) as log:
            for steps, spent in ((100, 0.3), (300, 1.0)):
                log.update(steps, 60.0, spent, lambda: ROW, {"entropy": 1.0})
        printed = capsys.readouterr().err.splitlines()
        assert len(printed) == lines
        if lines:
            assert printed[-1].startswith("100% after 60 s")
            assert printed[-1].endswith(
                "; the middle 90% of 5 shipped trainings: 2 goals/robot-h, 2.00 collisions/km, 200.0% stuck to "
                "6 goals/robot-h, 6.00 collisions/km, 600.0% stuck"
            )


def test_tensorboard_shows_figures_settings_and_references(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training_run, "reference_of", lambda config: OTHERS)
    config = ReinforceConfig(out=tmp_path, steps=8 * 6 * 4, **SMALL)
    folder = train(config) / "tensorboard"
    for name, values in OTHERS.quantiles.items():
        drawn = log_of(folder / f"shipped_{name}").Scalars("train/stuck")
        assert [(event.step, event.value) for event in drawn] == list(zip(OTHERS.steps, values["stuck"], strict=True))
    log = log_of(folder)
    tags = set(log.Tags()["scalars"])
    assert {f"train/{name}" for name in (*ROW, "entropy", "steps_per_second")} <= tags
    assert {f"held_out/{name}" for name in FIGURES} <= tags
    assert [event.step for event in log.Scalars("held_out/stuck")] == [0, 192]  # at the start and at the end
    (settings,) = log.Tensors("settings/text_summary")
    assert b"- traffic: routes" in settings.tensor_proto.string_val[0]


def test_resumed_board_hides_later_steps_of_the_broken_run(tmp_path: Path) -> None:
    for done, values in ((0, ((10, 1.0), (20, 2.0), (30, 3.0))), (20, ((30, 4.0),))):
        board = open_board(tmp_path, {"seed": 0}, done)
        for step, value in values:
            board.add_scalar("train/reward", value, step)
        board.close()
        (written,) = tmp_path.glob("events.out.tfevents.[1-9]*")
        written.rename(tmp_path / f"events.out.tfevents.0{done}")  # read in the order of names, which hold seconds
    found = [(event.step, event.value) for event in log_of(tmp_path).Scalars("train/reward")]
    assert found == [(10, 1.0), (20, 2.0), (30, 4.0)]


LONGER = {"layouts": ("open", "narrow"), "rows": 16, "steps": 16 * 6 * 6, "episode_seconds": 6.0}
TRAINERS = [ReinforceConfig, ThreadedPPOConfig, PPOConfig]


@pytest.mark.parametrize("options", TRAINERS)
def test_evaluations_do_not_change_training(
    options: type[TrainingConfig], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "SHARE", 1e9)  # an evaluation after every update
    driven = []

    def counted(config: TrainingConfig) -> dict[str, float]:
        driven.append(config.name)
        return held_out(config)

    config = options(out=tmp_path, **SMALL | LONGER)
    without = train(replace(config, name="without", evaluation_seconds=0.0), counted)
    assert driven == []
    often = train(replace(config, name="often", evaluation_seconds=1e-9), counted)
    assert len(driven) == 1 + 6
    assert (often / "weights.safetensors").read_bytes() == (without / "weights.safetensors").read_bytes()


class Log:
    def evaluated(self, figures: dict[str, float], steps: int, seconds: float) -> None: ...


def test_long_evaluations_wait_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two threads work all the time; evaluations take one thread 9, 6 and 0.75 s."""
    now, worked = [0.0], [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(progress.time, "process_time", lambda: worked[0])
    costs = [9.0, 6.0, 0.75]

    def drive(config: TrainingConfig) -> dict[str, float]:
        worked[0] += costs[0]
        now[0] += costs.pop(0)
        return {}

    made = Evaluations(ReinforceConfig(evaluation_seconds=60.0), drive, None)
    waits = []
    for update in range(3):
        made.run(update, 0, Log())  # type: ignore[arg-type]
        ended = now[0]
        while not made.due:
            now[0], worked[0] = now[0] + 1.0, worked[0] + 2.0
        waits.append(now[0] - ended)
    assert waits == [150.0, 100.0, 60.0]  # 3% of 300 and 200 s of work; then the requested interval
    before = now[0]
    made.run(2, 0, Log())  # type: ignore[arg-type]
    assert now[0] == before  # evaluated already
    assert not Evaluations(ReinforceConfig(evaluation_seconds=0.0), drive, None).due
