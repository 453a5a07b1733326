"""Beside which trainings a new one stands, and that only a training with the options of its recipe does."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from agents import WEIGHTS_FOLDER
from train.learning import reference
from train.learning.config import ThreadedPPOConfig
from train.learning.recipes import RECIPES, by_recipe
from train.learning.reference import QUANTILES, reference_of, summary

SHIPPED = [path.parent.name for path in WEIGHTS_FOLDER.glob("*/curves.json")]
NAMES = ("goals_per_robot_hour", "collisions_per_km", "stuck", "reward", "entropy")


def run_of(goals: float) -> list[dict[str, float]]:
    """Return the rows of a training of 200 steps, whose goals grow by 1 a row."""
    return [
        {"steps": k, "spent": k / 200, **dict.fromkeys(NAMES, 0.5), "goals_per_robot_hour": goals + k}
        for k in range(1, 201)
    ]


def test_quantiles_are_over_the_rows_of_all_trainings_in_a_part_of_the_budget() -> None:
    made = summary([run_of(0.0), run_of(100.0), run_of(300.0)], {})
    assert (made.trainings, made.steps) == (3, list(range(10, 201, 10)))
    # rows 11 to 20 of three trainings: 11 to 20, 111 to 120, 311 to 320
    assert made.at("median", 11)["goals_per_robot_hour"] == made.at("median", 20)["goals_per_robot_hour"] == 116
    low, high = (made.at(name, 20)["goals_per_robot_hour"] for name in ("low", "high"))
    assert (low, high) == (12.4, 319)  # three figures of 12.45 and 318.55
    assert made.at("median", 21)["goals_per_robot_hour"] == 126
    assert made.at("low", 0) == made.at("low", 10)
    assert made.at("high", 10**9) == made.at("high", 200)
    assert set(made.at("low", 5)) == set(NAMES)


@pytest.mark.parametrize("name", SHIPPED)
def test_what_ships_is_of_several_whole_trainings_of_its_recipe(name: str) -> None:
    config = by_recipe(name)
    shipped = reference_of(config)
    assert shipped is not None, "the recipe has changed: renew or delete curves.json (train/learning/reference.py)"
    assert shipped.trainings >= 2
    assert shipped.steps[-1] == pytest.approx(config.total_steps, rel=0.01)
    for steps in shipped.steps:
        low, median, high = (shipped.at(quantile, steps) for quantile in QUANTILES)
        assert all(low[figure] <= median[figure] <= high[figure] for figure in NAMES)
    assert (WEIGHTS_FOLDER / name / "curves.json").stat().st_size < 6000


def test_only_a_training_by_the_same_options_has_a_reference(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reference, "WEIGHTS_FOLDER", tmp_path)
    usual = by_recipe("careful", seed=3)
    assert reference_of(usual) is None
    (tmp_path / "careful").mkdir()
    old = {name: value for name, value in usual.to_dict().items() if name not in ("recipe", "caution", "tasks")}
    made = summary([run_of(0.0), run_of(1.0)], old)
    (tmp_path / "careful" / "curves.json").write_text(json.dumps(made._asdict()))
    free = {"name": "mine", "seed": 7, "threads": 3, "evaluation_seconds": 0.0, "progress": False}
    found = reference_of(by_recipe("careful", out=tmp_path, **free))
    assert found is not None
    assert found.at("median", 50) == made.at("median", 50)
    for changed in ({"robots": (8,)}, {"steps": 10**6}, {"minutes": 5.0}, {"start": None}, {"shared": 0.0}):
        assert reference_of(by_recipe("careful", **changed)) is None
    assert [name for name in RECIPES if reference_of(by_recipe(name)) is not None] == ["careful"]
    assert reference_of(ThreadedPPOConfig()) is None
