"""Recipes by the name of the policy that each makes: the trainer, as its options, and what changes their defaults."""

from __future__ import annotations

from typing import Any

from train.learning.config import DRAWN, PPOConfig, ReinforceConfig, ThreadedPPOConfig, TrainingConfig
from warehouse_env.errors import unknown_name

# As in the papers, routes are fixed and the policy alone avoids collisions: no shield, live routes or shared rewards.
_FIXED_ROUTES: dict[str, Any] = {
    "layouts": ("paper46", "narrow"), "planner": None, "collision_last": -30.0, "shared": 0.0,
    "traffic": "none",
}  # fmt: skip
_THREADED = {"robots": (16, 24, 32), "rows": 768, "hidden": (64, 64)}
# Live routes only, and large contact penalties.
_UNSHIELDED = {
    "steps": 100_000_000, "layouts": ("paper46", "narrow", "single_lane", *DRAWN[:4]),
    "robots": (16, 32), "rows": 1056, "planner": "astar_turns", "collision_last": -300.0, "hidden": (128, 128),
    "traffic": "routes",
}  # fmt: skip
# Goes on from there on floors drawn anew.
_CAREFUL = _UNSHIELDED | {
    "steps": 36_864_000, "layouts": ("paper46", "narrow", "single_lane", *("aisles:seed=new",) * 12),
    "robots": (32, 64), "rows": 1920, "start": "unshielded", "collision_first": -300.0,
    "collision_last": -800.0, "late_braking": -40.0, "entropy_first": 0.003, "learning_rate": 3e-4,
    "caution": 5 / 3,
}  # fmt: skip

# Goes on from there with fixed routes, in thousands of worlds on a GPU, which draws no floors.
_PATIENT = _CAREFUL | {
    "steps": 760_000_000, "traffic": "none", "layouts": ("paper46", "single_lane", *DRAWN[:5]), "rows": 393_216,
    "start": "careful", "collision_first": -800.0, "gamma": 0.99, "rollout": 10, "minibatch": 65_536, "epochs": 1,
    "entropy_first": 0.002, "entropy_last": 0.0005, "learning_rate": 4e-4,
}  # fmt: skip

RECIPES: dict[str, tuple[type[TrainingConfig], dict[str, Any]]] = {
    "reinforce": (ReinforceConfig, {}),
    "ppo": (PPOConfig, {}),
    "shielded": (ThreadedPPOConfig, {}),
    "unshielded": (ThreadedPPOConfig, _UNSHIELDED),
    "careful": (ThreadedPPOConfig, _CAREFUL),
    "fixed_routes": (ThreadedPPOConfig, _FIXED_ROUTES | _THREADED),
    "fixed_routes_reinforce": (ReinforceConfig, _FIXED_ROUTES | _THREADED),
    "fixed_routes_ppo": (PPOConfig, _FIXED_ROUTES | {"robots": (12, 16, 24), "rows": 384, "rollout": 48}),
    "patient": (ThreadedPPOConfig, _PATIENT),
}


def by_recipe(recipe: str, **options: Any) -> Any:
    """Return the options of a recipe's trainer; those that are given override it. ConfigError for no recipe."""
    if recipe not in RECIPES:
        raise unknown_name("recipe", recipe, RECIPES)
    kind, changes = RECIPES[recipe]
    return kind(**({"name": recipe, "recipe": recipe} | changes | options))
