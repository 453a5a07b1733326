"""What a training shows: the line of its progress, and what TensorBoard finds in its log."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.train.trainings import SMALL
from train.learning import progress, training_run
from train.learning.config import ReinforceConfig
from train.learning.progress import FIGURES, ProgressLog, open_board
from train.learning.recipes import Reference
from train.trainers import train

events = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")

ROW = {
    "reward": 0.1, "goals_per_robot_hour": 122.0, "collisions_per_km": 0.236, "stuck": 0.3754, "worlds_jammed": 0.5,
    "worlds_ended": 8.0,
    "path_length_ratio": 1.1,
}  # fmt: skip


def log_of(folder: Path) -> events.EventAccumulator:
    log = events.EventAccumulator(str(folder))
    log.Reload()
    return log


def test_the_line_tells_standing_touching_and_jams_beside_goals(
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


def test_other_trainings_stand_beside_it_after_as_many_steps(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In every line, and in one at the end where a bar showed the rest."""
    monkeypatch.setattr(progress, "LOG_SECONDS", 0.0)
    for beside, lines, seconds in ((OTHERS, 2, 0.0), (OTHERS, 1, 1e9), (None, 0, 1e9)):
        monkeypatch.setattr(progress, "LINE_SECONDS", seconds)
        with ProgressLog(tmp_path, False, 0, {}, beside) as log:
            for steps, spent in ((100, 0.3), (300, 1.0)):
                log.update(steps, 60.0, spent, lambda: ROW, {"entropy": 1.0})
        said = capsys.readouterr().err.splitlines()
        assert len(said) == lines
        if lines:
            assert said[-1].startswith("100% after 60 s")
            assert said[-1].endswith(
                "; the middle 90% of 5 shipped trainings: 2 goals/robot-h, 2.00 collisions/km, 200.0% stuck to "
                "6 goals/robot-h, 6.00 collisions/km, 600.0% stuck"
            )


def test_tensorboard_has_figures_evaluations_settings_and_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
    assert [event.step for event in log.Scalars("held_out/stuck")] == [0, 192]  # the start, and what was learned
    (settings,) = log.Tensors("settings/text_summary")
    assert b"- traffic: routes" in settings.tensor_proto.string_val[0]


def test_what_a_broken_run_wrote_of_later_steps_is_hidden(tmp_path: Path) -> None:
    for done, values in ((0, ((10, 1.0), (20, 2.0), (30, 3.0))), (20, ((30, 4.0),))):
        board = open_board(tmp_path, {"seed": 0}, done)
        for step, value in values:
            board.add_scalar("train/reward", value, step)
        board.close()
        (written,) = tmp_path.glob("events.out.tfevents.[1-9]*")
        written.rename(tmp_path / f"events.out.tfevents.0{done}")  # read in the order of the names, which tell seconds
    found = [(event.step, event.value) for event in log_of(tmp_path).Scalars("train/reward")]
    assert found == [(10, 1.0), (20, 2.0), (30, 4.0)]
