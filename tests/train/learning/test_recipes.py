"""Recipes: what is shipped is what is trained by default, and the command line says and overrides it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agents import POLICIES, make_policy, policy_config, policy_tensors, weights_folder
from agents.weights_folder import read_record
from train.cli import COMMANDS, main
from train.commands.training import Train
from train.learning.config import ThreadedConfig
from train.learning.recipes import RECIPES, by_recipe
from train.learning.trainer import first_net
from warehouse_env.config import EnvConfig
from warehouse_env.old_names import POLICIES as OLD

WEIGHTS = Path(weights_folder.__file__).parent / "weights"
SHIPPED = [path.parent.name for path in WEIGHTS.glob("*/config.json")]
# What a user chooses anew: where it goes, for how long, on what machine, and what shows itself or is judged.
FREE = {
    "out", "seed", "minutes", "threads", "device", "progress", "resume", "evaluation_seconds", "floor_episodes",
    "recipe",
}  # fmt: skip

# options than some weights, which had them off
NEWER = {
    "fleet": None, "device": None, "late_braking": 0.0, "start": None, "tasks": "lifelong", "sensor": None,
    "caution": 1.0,
}  # fmt: skip


def test_every_shipped_policy_has_a_recipe_and_every_recipe_a_command() -> None:
    assert {name for name, entry in POLICIES.items() if entry.weights} == set(SHIPPED) <= set(RECIPES)
    assert [name for name in COMMANDS if name.startswith("train ")] == [f"train {name}" for name in RECIPES]


@pytest.mark.parametrize("name", SHIPPED)
def test_the_recipe_is_what_the_shipped_weights_were_trained_by(name: str) -> None:
    config, record = by_recipe(name), read_record(WEIGHTS / name)
    assert (record.algorithm, config.name) == (config.algorithm, name)
    given, made = config.upgraded(record.training["config"]), config.to_dict()
    made = {key: list(value) if isinstance(value, tuple) else value for key, value in made.items()}
    made["steps"] = config.total_steps  # left out where a default says them
    newer = {key: made.pop(key) for key in NEWER.keys() & made.keys() - given.keys()}
    assert newer == {key: NEWER[key] for key in newer}
    assert {key for key in made if key not in FREE} == {key for key in given if key not in FREE}
    assert {key: made[key] for key in made.keys() - FREE} == {key: given[key] for key in given.keys() - FREE}


def test_caution_is_for_driving_not_for_training() -> None:
    careful = by_recipe("careful")
    trained = careful.env("open", 2)
    assert (trained.sensor.caution, careful.driven(trained).sensor.caution) == (1.0, 5 / 3)


@pytest.mark.parametrize("name", [name for name, (kind, _) in RECIPES.items() if issubclass(kind, ThreadedConfig)])
def test_a_recipe_can_begin(name: str) -> None:
    """What it begins with fits, though it may have been driven with other caution."""
    config = by_recipe(name, **{"device": "cpu"} if name == "patient" else {})  # refused for what a device has not
    env = config.env("open", config.robots[0])
    net = first_net(config, env)
    if config.start is not None:
        first = policy_tensors(config.start, policy_config(config.start, env))["actor.0.weight"]
        assert np.array_equal(net.state_dict()["actor.0.weight"].numpy(), first)


@pytest.mark.parametrize("name", [name for name in RECIPES if name.startswith("fixed_routes")])
def test_with_fixed_routes_all_is_left_to_the_policy(name: str) -> None:
    config = by_recipe(name)
    env = config.driven(config.env("open", 2))
    assert (env.traffic, config.shared) == ("none", 0.0)
    assert by_recipe(name, shared=0.5).shared == 0.5


DESCRIBED = {
    "reinforce (ours)": "Train our policy gradient: REINFORCE",
    "ppo (ours)": "Train our own proximal policy optimisation (PPO)",
    "ppo (stable-baselines3)": "(PPO) of stable-baselines3",
}


def test_a_command_has_the_defaults_and_the_trainer_of_its_recipe(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    ran: list[Train] = []
    monkeypatch.setattr(Train, "run", lambda self: ran.append(self))
    for recipe in RECIPES:
        assert main(["train", recipe]) == 0
        assert main(["train", recipe, "--robots", "3", "5", "--shared", "0.25"]) == 0
        assert [one.config for one in ran[-2:]] == [by_recipe(recipe), by_recipe(recipe, robots=(3, 5), shared=0.25)]
        assert main(["train", recipe, "--help"]) == 0
        assert DESCRIBED[by_recipe(recipe).algorithm] in capsys.readouterr().out


@pytest.mark.parametrize(("old", "new"), OLD.items())
def test_a_policys_old_name_still_drives_and_trains(old: str, new: str, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[Train] = []
    monkeypatch.setattr(Train, "run", lambda self: ran.append(self))
    for name in (old, new):
        assert main(["train", name, "--steps", "7"]) == 0
    assert ran[0] == ran[1] == Train(by_recipe(new, steps=7))
    assert old not in POLICIES
    config = policy_config(old, EnvConfig())
    assert config == policy_config(new, EnvConfig())
    seen = np.random.default_rng(0).random((1, 2, read_record(WEIGHTS / new).network.observation_size), np.float32)
    first, second = (make_policy(name, config).act(seen, np.random.default_rng(0)) for name in (old, new))
    np.testing.assert_array_equal(first, second)


def test_a_recipe_that_is_none_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "carefull"]) == 2
    assert "unknown train command 'carefull'; did you mean careful?" in capsys.readouterr().err
