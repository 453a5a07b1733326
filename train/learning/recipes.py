"""Recipes: named changes of the trainers' default options; the defaults are the recipe `shipped`."""

from __future__ import annotations

from typing import Any, TypeVar

from train.learning.config import DRAWN, PPOConfig, ReinforceConfig, ThreadedPPOConfig, TrainingConfig
from warehouse_env.errors import unknown_name

Config = TypeVar("Config", bound=TrainingConfig)

# The policy alone avoids collisions, as in the papers: no shield, live routes or shared rewards.
_BARE: dict[str, Any] = {
    "layouts": ("paper46", "narrow"), "planner": None, "collision_last": -30.0, "shared": 0.0,
    "traffic": "none",
}  # fmt: skip
_THREADED = {"robots": (16, 24, 32), "rows": 768, "hidden": (64, 64)}
# Thousands of worlds on a GPU, within what a device simulates.
_DEVICE = {
    "layouts": ("paper46",), "robots": (16,), "rows": 262_144, "planner": "pf_aco", "collision_last": -30.0,
    "traffic": "none:shield=true", "hidden": (64, 64), "minibatch": 131_072, "learning_rate": 1e-3,
    "steps": 1_000_000_000,
}  # fmt: skip
# The shipped policy of this name: live routes only, and large contact penalties.
_UNSHIELDED = {
    "name": "unshielded", "steps": 100_000_000, "layouts": ("paper46", "narrow", "single_lane", *DRAWN[:4]),
    "robots": (16, 32), "rows": 1056, "planner": "astar_turns", "collision_last": -300.0, "hidden": (128, 128),
    "traffic": "routes",
}  # fmt: skip
# Goes on from there on floors drawn anew.
_CAREFUL = _UNSHIELDED | {
    "name": "careful", "steps": 36_864_000, "layouts": ("paper46", "narrow", "single_lane", *("aisles:seed=new",) * 12),
    "robots": (24, 40), "rows": 1920, "start": "unshielded", "collision_first": -300.0,
    "collision_last": -800.0, "late_braking": -40.0, "entropy_first": 0.003, "learning_rate": 3e-4,
    "caution": 5 / 3,
}  # fmt: skip

RECIPES: dict[type[TrainingConfig], dict[str, dict[str, Any]]] = {
    ReinforceConfig: {"shipped": {}, "bare": _BARE | _THREADED, "device": _DEVICE},
    PPOConfig: {"shipped": {}, "bare": _BARE | {"robots": (12, 16, 24), "rows": 384, "rollout": 48}},
    ThreadedPPOConfig: {
        "shipped": {},
        "bare": _BARE | _THREADED,
        "device": _DEVICE,
        "unshielded": _UNSHIELDED,
        "careful": _CAREFUL,
    },
}


def by_recipe(kind: type[Config], recipe: str, **options: Any) -> Config:
    """Return a trainer's options by one of its recipes; those that are given override it. ConfigError for no recipe."""
    if recipe not in RECIPES[kind]:
        raise unknown_name("recipe", recipe, RECIPES[kind])
    return kind(**(RECIPES[kind][recipe] | options))
