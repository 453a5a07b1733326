"""The trainers' benchmark: a row each, measured in turns, and how they compare with stable-baselines3's."""

from __future__ import annotations

from typing import Any

import pytest

from train.benchmarks import trainers
from train.benchmarks.trainers import training
from train.commands.bench import ratios
from train.learning.recipes import by_recipe

SMALL: dict[str, Any] = {
    "layouts": ("open",), "robots": (2,), "rows": 8, "planner": "astar", "rollout": 4, "hidden": (20,), "threads": 1,
}  # fmt: skip


def test_every_trainer_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trainers, "by_recipe", lambda kind, recipe, **given: by_recipe(kind, recipe, **given | SMALL))
    rows = list(training(0.05, 3))
    assert [row["what"] for row in rows] == ["train_reinforce", "train_threaded_ppo", "train_ppo"]
    for row in rows:
        assert row["low"] <= row["agent_steps_per_s"] <= row["high"]
        assert sum(row["shares"].values()) == pytest.approx(1.0)
        assert all(share > 0 for share in row["shares"].values())
        assert (row["envs"], row["agents"], row["hidden"]) == (4, "2", [20])


def test_the_others_are_held_against_stable_baselines3() -> None:
    rows = [
        {"what": f"train_{name}", "trainer": name, "envs": 1, "agents": "2", "agent_steps_per_s": speed}
        for name, speed in (("reinforce", 300.0), ("threaded_ppo", 250.0), ("ppo", 100.0))
    ]
    assert ratios(rows) == ["train_reinforce over train_ppo: 3.00", "train_threaded_ppo over train_ppo: 2.50"]
