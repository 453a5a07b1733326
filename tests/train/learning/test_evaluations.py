"""Evaluations in the course of a training: on seeds of their own, now and then, and without a trace in the weights."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.train.trainings import SMALL
from train.learning import progress
from train.learning.config import PPOConfig, ReinforceConfig, ThreadedPPOConfig, TrainingConfig
from train.learning.progress import Evaluations
from train.trainers import held_out, train

LONGER = {"layouts": ("open", "narrow"), "rows": 16, "steps": 16 * 6 * 6, "episode_seconds": 6.0}
TRAINERS = [ReinforceConfig, ThreadedPPOConfig, PPOConfig]


@pytest.mark.parametrize("options", TRAINERS)
def test_what_is_learned_does_not_depend_on_them(
    options: type[TrainingConfig], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "SHARE", 1e9)  # one after every update
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


def test_one_that_takes_long_waits_long(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two threads work all the time, and the evaluations take one of them 6 s, the first 3 s more."""
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
    assert waits == [150.0, 100.0, 60.0]  # 3% of 300 and of 200 s of work; the last as often as was asked for
    before = now[0]
    made.run(2, 0, Log())  # type: ignore[arg-type]
    assert now[0] == before  # driven already
    assert not Evaluations(ReinforceConfig(evaluation_seconds=0.0), drive, None).due
