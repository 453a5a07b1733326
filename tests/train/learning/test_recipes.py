"""Test recipes: shipped policies match them, and so do commands, cards and reference trainings."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from agents import (
    POLICIES,
    WEIGHTS_FOLDER,
    Network,
    PolicyRecord,
    make_policy,
    policy_config,
    policy_tensors,
    save_policy,
)
from agents.weights_folder import read_record, read_tensors
from train.cli import COMMANDS, main
from train.commands.training import Train
from train.learning import recipes
from train.learning.checkpoint import write_card
from train.learning.config import ThreadedConfig, ThreadedPPOConfig
from train.learning.recipes import QUANTILES, RECIPES, by_recipe, reference_of, summary
from train.learning.trainer import first_net
from warehouse_env.config import EnvConfig, SensorSpec
from warehouse_env.old_names import POLICIES as OLD

SHIPPED = [path.parent.name for path in WEIGHTS_FOLDER.glob("*/config.json")]
# Options of a single run that are not part of a recipe: place, duration, machine, display and evaluations.
FREE = {
    "out", "seed", "minutes", "threads", "device", "progress", "resume", "evaluation_seconds", "floor_episodes",
    "recipe",
}  # fmt: skip

# options newer than some weights, with their values at that time
NEWER = {
    "fleet": None, "device": None, "late_braking": 0.0, "start": None, "tasks": "lifelong", "sensor": None,
}  # fmt: skip


def test_every_shipped_policy_has_a_recipe_and_every_recipe_a_command() -> None:
    assert {name for name, entry in POLICIES.items() if entry.weights} == set(SHIPPED) <= set(RECIPES)
    assert [name for name in COMMANDS if name.startswith("train ")] == [f"train {name}" for name in RECIPES]


@pytest.mark.parametrize("name", SHIPPED)
def test_recipe_equals_the_training_of_the_shipped_weights(name: str) -> None:
    config, record = by_recipe(name), read_record(WEIGHTS_FOLDER / name)
    assert (record.algorithm, config.name) == (config.algorithm, name)
    given, made = config.upgraded(record.training["config"]), config.to_dict()
    made = {key: list(value) if isinstance(value, tuple) else value for key, value in made.items()}
    made["steps"] = config.total_steps  # absent if the default applies
    newer = {key: made.pop(key) for key in NEWER.keys() & made.keys() - given.keys()}
    assert newer == {key: NEWER[key] for key in newer}
    assert {key for key in made if key not in FREE} == {key for key in given if key not in FREE}
    assert {key: made[key] for key in made.keys() - FREE} == {key: given[key] for key in given.keys() - FREE}


@pytest.mark.parametrize("name", [name for name, (kind, _) in RECIPES.items() if issubclass(kind, ThreadedConfig)])
def test_recipe_can_start(name: str) -> None:
    config = by_recipe(name, **{"device": "cpu"} if RECIPES[name][1].get("rows", 0) > 10_000 else {})
    env = config.env("open", config.robots[0])
    net = first_net(config, env)
    if config.start is not None:
        first = policy_tensors(config.start, policy_config(config.start, env))["actor.0.weight"]
        own = net.state_dict()["actor.0.weight"].numpy()
        assert np.array_equal(own[:, : first.shape[1]], first)
        assert not own[:, first.shape[1] :].any()  # the shield's slice, unknown to the start policy


@pytest.mark.parametrize("name", [name for name in RECIPES if name.startswith("fixed_routes")])
def test_fixed_routes_recipes_use_no_traffic_rules(name: str) -> None:
    config = by_recipe(name)
    env = config.driven(config.env("open", 2))
    assert (env.traffic, config.shared) == ("none", 0.0)
    assert by_recipe(name, shared=0.5).shared == 0.5


DESCRIBED = {
    "reinforce (ours)": "Train our policy gradient: REINFORCE",
    "ppo (ours)": "Train our own proximal policy optimisation (PPO)",
    "ppo (stable-baselines3)": "(PPO) of stable-baselines3",
}


def test_command_has_its_recipes_defaults_and_trainer(
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
def test_old_policy_names_still_drive_and_train(old: str, new: str, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[Train] = []
    monkeypatch.setattr(Train, "run", lambda self: ran.append(self))
    for name in (old, new):
        assert main(["train", name, "--steps", "7"]) == 0
    assert ran[0] == ran[1] == Train(by_recipe(new, steps=7))
    assert old not in POLICIES
    config = policy_config(old, EnvConfig())
    assert config == policy_config(new, EnvConfig())
    seen = np.random.default_rng(0).random(
        (1, 2, read_record(WEIGHTS_FOLDER / new).network.observation_size), np.float32
    )
    first, second = (make_policy(name, config).act(seen, np.random.default_rng(0)) for name in (old, new))
    np.testing.assert_array_equal(first, second)


def test_unknown_recipe_suggests_a_near_match(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "carefull"]) == 2
    assert "unknown train command 'carefull'; did you mean careful?" in capsys.readouterr().err


MEASURED = [path.parent.name for path in WEIGHTS_FOLDER.glob("*/curves.json")]
NAMES = ("goals_per_robot_hour", "collisions_per_km", "stuck", "reward", "entropy")


def run_of(goals: float) -> list[dict[str, float]]:
    """Return the rows of a training of 200 steps; goals grow by 1 per row."""
    return [
        {"steps": k, "spent": k / 200, **dict.fromkeys(NAMES, 0.5), "goals_per_robot_hour": goals + k}
        for k in range(1, 201)
    ]


def test_quantiles_cover_all_trainings_per_part_of_the_budget() -> None:
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


@pytest.mark.parametrize("name", MEASURED)
def test_reference_covers_several_complete_trainings(name: str) -> None:
    config = by_recipe(name)
    shipped = reference_of(config)
    assert shipped is not None, "the recipe has changed: renew or delete curves.json (train/learning/recipes.py)"
    assert shipped.trainings >= 2
    assert shipped.steps[-1] == pytest.approx(config.total_steps, rel=0.01)
    for steps in shipped.steps:
        low, median, high = (shipped.at(quantile, steps) for quantile in QUANTILES)
        assert all(low[figure] <= median[figure] <= high[figure] for figure in NAMES)
    assert (WEIGHTS_FOLDER / name / "curves.json").stat().st_size < 6000


def test_only_equal_options_have_a_reference(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recipes, "WEIGHTS_FOLDER", tmp_path)
    usual = by_recipe("careful", seed=3)
    assert reference_of(usual) is None
    (tmp_path / "careful").mkdir()
    old = {name: value for name, value in usual.to_dict().items() if name not in ("recipe", "tasks")}
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


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a policy folder with a training record."""
    network = Network(3, 2, True, (4,))
    tensors = {name: np.zeros(shape, np.float32) for name, shape in network.shapes().items()}
    config = {"seed": 7, "threads": 2, "layouts": ["narrow"], "robots": [8, 16], "planner": "astar"}
    training = {"steps": 1_234_567, "updates": 89, "seconds": 600.0, "config": config, "last_figures": {"reward": 0.5}}
    env = EnvConfig(action_repeat=2, sensor=SensorSpec(predictions=True))
    return save_policy(tmp_path, PolicyRecord("reinforce", network, env, "sample", training), tensors)


def test_card_states_the_training(folder: Path) -> None:
    text = write_card(folder).read_text()
    for part in (
        "10.0 minutes",
        "1,234,567 agent-steps",
        "| seed | 7 |",
        "| robots | 8, 16 |",
        "every 0.2 s",
        "no conflict",
    ):
        assert part in text
    assert "Not measured yet" in text
    assert "reward 0.5" in text


def test_card_states_the_start_policy(folder: Path) -> None:
    record = read_record(folder)
    record = replace(record, training=record.training | {"config": {"start": "ppo"}})
    text = write_card(save_policy(folder, record, read_tensors(folder, record.network))).read_text()
    assert "It began as the policy ppo." in text
    assert "no conflict" not in text
