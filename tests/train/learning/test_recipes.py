"""Recipes: what is shipped is what is trained by default, and the command line says and overrides it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents import policy_config, policy_tensors, weights_folder
from agents.weights_folder import read_record
from train.cli import main
from train.commands.training import TrainPPO, TrainReinforce, TrainThreadedPPO
from train.learning.config import PPOConfig, ReinforceConfig, ThreadedPPOConfig, TrainingConfig
from train.learning.recipes import RECIPES, by_recipe
from train.learning.trainer import first_net

WEIGHTS = Path(weights_folder.__file__).parent / "weights"
SHIPPED: dict[str, tuple[type[TrainingConfig], str]] = {
    "reinforce": (ReinforceConfig, "shipped"),
    "ppo": (PPOConfig, "shipped"),
    "threaded_ppo": (ThreadedPPOConfig, "shipped"),
    "unshielded": (ThreadedPPOConfig, "unshielded"),
    "careful": (ThreadedPPOConfig, "careful"),
}
# What a user chooses anew: where it goes, for how long, on what machine, and what shows itself or is judged.
FREE = {"out", "seed", "minutes", "threads", "progress", "resume", "evaluation_seconds", "floor_episodes"}

# options than some weights, which had them off
NEWER = {
    "fleet": None, "device": None, "late_braking": 0.0, "start": None, "tasks": "lifelong", "sensor": None,
    "caution": 1.0,
}  # fmt: skip


def test_every_shipped_policy_has_a_recipe() -> None:
    assert {path.parent.name for path in WEIGHTS.glob("*/config.json")} == set(SHIPPED)


@pytest.mark.parametrize("name", SHIPPED)
def test_the_recipe_is_what_the_shipped_weights_were_trained_by(name: str) -> None:
    kind, recipe = SHIPPED[name]
    config = by_recipe(kind, recipe)
    given, made = kind.upgraded(read_record(WEIGHTS / name).training["config"]), config.to_dict()
    made = {key: list(value) if isinstance(value, tuple) else value for key, value in made.items()}
    made["steps"] = config.total_steps  # left out where a default says them
    newer = {key: made.pop(key) for key in NEWER.keys() & made.keys() - given.keys()}
    assert newer == {key: NEWER[key] for key in newer}
    assert {key for key in made if key not in FREE} == {key for key in given if key not in FREE}
    assert {key: made[key] for key in made.keys() - FREE} == {key: given[key] for key in given.keys() - FREE}


def test_caution_is_for_driving_not_for_training() -> None:
    careful = by_recipe(ThreadedPPOConfig, "careful")
    trained = careful.env("open", 2)
    assert (trained.sensor.caution, careful.driven(trained).sensor.caution) == (1.0, 5 / 3)


@pytest.mark.parametrize("recipe", RECIPES[ThreadedPPOConfig])
def test_a_recipe_can_begin(recipe: str) -> None:
    """What it begins with fits, though it may have been driven with other caution."""
    config = by_recipe(ThreadedPPOConfig, recipe)
    env = config.env("open", config.robots[0])
    net = first_net(config, env)
    if config.start is not None:
        first = policy_tensors(config.start, policy_config(config.start, env))["actor.0.weight"]
        assert np.array_equal(net.state_dict()["actor.0.weight"].numpy(), first)


@pytest.mark.parametrize("kind", RECIPES)
def test_bare_leaves_all_to_the_policy(kind: type[TrainingConfig]) -> None:
    bare = by_recipe(kind, "bare")
    env = bare.driven(bare.env("open", 2))
    assert (env.traffic, bare.shared) == ("none", 0.0)
    assert by_recipe(kind, "bare", shared=0.5).shared == 0.5


@pytest.mark.parametrize("command", [TrainReinforce, TrainPPO, TrainThreadedPPO])
def test_every_recipe_can_be_named_on_the_command_line(
    command: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    kind, ran = type(command().config), []
    monkeypatch.setattr(command, "run", lambda self: ran.append(self))
    word = command.module.removeprefix("train.")
    for recipe in RECIPES[kind]:
        assert main(["train", word, "--recipe", recipe]) == 0
        assert main(["train", word, f"--recipe={recipe}", "--robots", "3", "5", "--shared", "0.25"]) == 0
        plain, chosen = ran[-2:]
        assert (plain.recipe, plain.config) == (recipe, by_recipe(kind, recipe))
        assert chosen.config == by_recipe(kind, recipe, robots=(3, 5), shared=0.25)
    assert main(["train", word]) == 0
    assert ran[-1].config == kind()
    assert main(["train", word, "--recipe", "brae"]) == 2
    assert "unknown recipe 'brae'; did you mean bare?" in capsys.readouterr().err
