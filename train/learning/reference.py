"""How trainings by a shipped recipe went, beside which a new one stands: quantiles over the rows of several seeds.

`python -m train.learning.reference runs/a runs/b > agents/weights/NAME/curves.json` makes those of a recipe.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from bisect import bisect_left
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents import WEIGHTS_FOLDER
from agents.weights_folder import read_record
from train.learning.config import TrainingConfig
from train.reporting.rows import Row, read_rows
from warehouse_env.checked import from_plain
from warehouse_env.errors import WeightsError
from warehouse_env.files import read_json

QUANTILES = {"low": 0.05, "median": 0.5, "high": 0.95}
_FIGURES = ("goals_per_robot_hour", "collisions_per_km", "stuck", "reward", "entropy")
_POINTS = 20  # parts of the budget
_FREE = {  # options that do not change what a training learns
    "name", "recipe", "out", "resume", "seed", "caution", "checkpoint_seconds", "evaluation_seconds", "threads",
    "progress",
}  # fmt: skip


class Reference(NamedTuple):
    """Figures of several trainings over their agent-steps."""

    options: dict[str, Any]  # of the first
    trainings: int
    steps: list[int]  # [_POINTS], at the end of each part of the budget
    quantiles: dict[str, dict[str, list[float]]]  # name of QUANTILES -> figure -> [_POINTS]

    def at(self, quantile: str, steps: int) -> dict[str, float]:
        """Return the figures of the part of the budget in which `steps` lie."""
        point = min(bisect_left(self.steps, steps), len(self.steps) - 1)
        return {name: values[point] for name, values in self.quantiles[quantile].items()}


def reference_of(config: TrainingConfig) -> Reference | None:
    """Return the reference of a training's recipe; None if it has none, or has learned by other options."""
    path = WEIGHTS_FOLDER / str(config.recipe) / "curves.json"
    if config.recipe is None or not path.is_file():
        return None
    found = Reference(**read_json(path, "reference", 100_000, WeightsError))
    its = from_plain(type(config), found.options)
    other = {one.name for one in dataclasses.fields(config) if getattr(config, one.name) != getattr(its, one.name)}
    return found if other <= _FREE else None


def summary(runs: Sequence[Sequence[Row]], options: dict[str, Any]) -> Reference:
    """Return the reference of some trainings by the same options, each by the rows of its progress."""
    rows = [row for run in runs for row in run]
    part = np.clip(np.ceil([row["spent"] * _POINTS for row in rows]).astype(int) - 1, 0, _POINTS - 1)
    values = {name: np.array([row[name] for row in rows]) for name in _FIGURES}
    quantiles = {
        label: {
            name: [float(f"{np.quantile(of[part == k], share):.3g}") for k in range(_POINTS)]
            for name, of in values.items()
        }
        for label, share in QUANTILES.items()
    }
    most = max(row["steps"] for row in rows)
    kept = {name: value for name, value in options.items() if name not in _FREE}
    return Reference(kept, len(runs), [most * (k + 1) // _POINTS for k in range(_POINTS)], quantiles)


if __name__ == "__main__":
    folders = [Path(name) for name in sys.argv[1:]]
    config = read_record(folders[0]).training["config"]
    print(json.dumps(summary([read_rows(folder / "progress.jsonl") for folder in folders], config)._asdict()))
