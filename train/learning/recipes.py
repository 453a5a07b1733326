"""Recipes by the name of the policy that each makes: the trainer, as its options, and what changes their defaults.

Beside a new training stands how those by the same recipe went: quantiles over the rows of several seeds.
`python -m train.learning.recipes runs/a runs/b > agents/weights/NAME/curves.json` makes those of a recipe.
"""

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
from train.learning.config import DRAWN, PPOConfig, ReinforceConfig, ThreadedPPOConfig, TrainingConfig
from train.reporting.rows import Row, read_rows
from warehouse_env.checked import from_plain
from warehouse_env.errors import WeightsError, check_known
from warehouse_env.files import read_json

# As in the papers, routes are fixed and the policy alone avoids collisions: no shield, live routes or shared rewards.
_FIXED_ROUTES: dict[str, Any] = {
    "layouts": ("paper46", "narrow"), "planner": None, "collision_last": -30.0, "shared": 0.0,
    "traffic": "none",
}  # fmt: skip
_THREADED = {"robots": (16, 24, 32), "rows": 768, "hidden": (64, 64)}
# Live routes only, and large contact penalties.
_UNSHIELDED = {"steps": 100_000_000, "collision_last": -300.0, "traffic": "routes"}
# Goes on from there on floors drawn anew.
_CAREFUL = _UNSHIELDED | {
    "steps": 36_864_000, "layouts": ("paper46", "narrow", "single_lane", *("aisles:seed=new",) * 12),
    "robots": (32, 64), "rows": 1920, "start": "unshielded", "collision_first": -300.0,
    "collision_last": -800.0, "late_braking": -40.0, "entropy_first": 0.003, "learning_rate": 3e-4,
}  # fmt: skip

# Goes on from there in thousands of worlds on a GPU, which draws no floors.
_BUSY = _CAREFUL | {
    "steps": 802_000_000, "layouts": ("paper46", "narrow", "single_lane", *DRAWN), "rows": 393_216,
    "start": "careful", "collision_first": -800.0, "gamma": 0.99, "rollout": 10, "minibatch": 65_536, "epochs": 1,
    "entropy_first": 0.002, "entropy_last": 0.0005, "learning_rate": 4e-4,
}  # fmt: skip
# Goes on from there in crowds under the shield.
_SHIELDED = {
    "steps": 18_000_000, "layouts": ("paper46", "narrow", "single_lane", *("aisles:seed=new",) * 8),
    "robots": (64, 128), "rows": 2112, "start": "busy", "gamma": 0.997, "gae_lambda": 0.97, "entropy_first": 0.002,
    "entropy_last": 0.0005, "learning_rate": 4e-4,
}  # fmt: skip
# The same as busy with fixed routes.
_PATIENT = _BUSY | {
    "steps": 760_000_000, "traffic": "none", "layouts": ("paper46", "single_lane", *DRAWN[:5]),
}  # fmt: skip

RECIPES: dict[str, tuple[type[TrainingConfig], dict[str, Any]]] = {
    "reinforce": (ReinforceConfig, {}),
    "ppo": (PPOConfig, {}),
    "shielded": (ThreadedPPOConfig, _SHIELDED),
    "unshielded": (ThreadedPPOConfig, _UNSHIELDED),
    "careful": (ThreadedPPOConfig, _CAREFUL),
    "fixed_routes": (ThreadedPPOConfig, _FIXED_ROUTES | _THREADED),
    "fixed_routes_reinforce": (ReinforceConfig, _FIXED_ROUTES | _THREADED),
    "fixed_routes_ppo": (PPOConfig, _FIXED_ROUTES | {"robots": (12, 16, 24), "rows": 384, "rollout": 48}),
    "busy": (ThreadedPPOConfig, _BUSY),
    "patient": (ThreadedPPOConfig, _PATIENT),
}


def by_recipe(recipe: str, **options: Any) -> Any:
    """Return the options of a recipe's trainer; those that are given override it. ConfigError for no recipe."""
    check_known("recipe", [recipe], RECIPES)
    kind, changes = RECIPES[recipe]
    return kind(**({"name": recipe, "recipe": recipe} | changes | options))


QUANTILES = {"low": 0.05, "median": 0.5, "high": 0.95}
_FIGURES = ("goals_per_robot_hour", "collisions_per_km", "stuck", "reward", "entropy")
_POINTS = 20  # parts of the budget
_FREE = {  # options that do not change what a training learns
    "name", "recipe", "out", "resume", "seed", "checkpoint_seconds", "evaluation_seconds", "threads",
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
