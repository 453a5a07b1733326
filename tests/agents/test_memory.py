"""Test that one policy object drives many worlds and keeps their memories apart."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from agents import POLICIES, Actor, add_policy, make_policy, policy_config
from tests.pages import PAGES, fenced
from train.evaluation.recorded import record, shares_of
from train.evaluation.rollout import Experiment, make_experiment, run
from train.live.world import Make, World, WorldSetting, live_floors
from warehouse_env import EnvConfig, Simulator, observation_layout
from warehouse_env.config import TrafficMode
from warehouse_env.errors import ConfigError
from warehouse_env.render.replay import replay_of

COUNTING = '''

class Counting(Polite):
    """Stops at every third decision of a world."""
    drawn = False

    def memory(self, worlds):
        return np.zeros((worlds, self._robots), np.int64)

    def act(self, observation, rng, memory):
        speed = np.where(memory % 3 == 2, 0.0, self._command.cruise_speed)
        return self._command.at_speed(observation, speed), memory + 1

class Preferring(Counting):
    def preferences(self, observation, memory):
        first, memory = self.act(observation, None, memory)
        return np.eye(20, dtype=np.float32)[first], memory

class Unsaid(Counting):
    def act(self, observation, rng, memory):
        return super().act(observation, rng, memory)[0]

class Half(Preferring):
    @property
    def drawn(self):
        raise AttributeError

class Alike(Counting):
    def memory(self, worlds):
        return np.zeros(self._robots)
'''
BASE = EnvConfig(layout="open", num_agents=3, planner="astar")


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, registries: None) -> Path:
    """Return a working folder whose my_policy.py holds the page's policies and those above."""
    monkeypatch.chdir(tmp_path)
    Path("my_policy.py").write_text(fenced(PAGES["docs/how_to/policy.md"], "python")[0] + COUNTING, encoding="utf-8")
    return tmp_path


def experiment(name: str, **chosen: Any) -> Experiment:
    """Return an experiment of four episodes with a policy of my_policy.py."""
    add_policy(f"my_policy.py:{name}")
    return make_experiment(f"my_policy.py:{name}", BASE, 4, 6.0, 5, chosen)


def expected_poses(seed: int, decisions: int) -> NDArray[np.float32]:
    """Drive a world by hand as Counting would; return its poses."""
    simulator = Simulator(policy_config("follow", BASE))
    simulator.reset([seed])
    follow, poses = make_policy("follow", simulator.config), [simulator.state.pose[0].copy()]
    stop = np.full((1, 3), 1 * len(simulator.config.lateral_offsets))  # second speed level, no lateral offset
    for k in range(decisions):
        simulator.step(stop if k % 3 == 2 else follow.act(simulator.observation, np.random.default_rng(0)))
        poses.append(simulator.state.pose[0].copy())
    return np.stack(poses)


def test_memory_counts_decisions_when_evaluated_recorded_and_live(here: Path) -> None:
    four, poses = experiment("Counting"), list[Any]()
    together = run(four, [lambda simulator, steps: poses.append(simulator.state.pose[0].copy())])
    np.testing.assert_array_equal(np.stack(poses), expected_poses(5, four.config.max_steps))
    for k, row in enumerate(together):
        alone = dataclasses.replace(four, episodes=(k,))
        np.testing.assert_array_equal(record(alone).pose[:, 0], expected_poses(5 + k, four.config.max_steps))
        assert run(alone)[0]["robot_km"] == row["robot_km"]
    live = World(WorldSetting(four.policy, "open", 3, 6, "astar"), live_floors("open"))
    for seed in (6, 7):
        live.make(Make(seed=seed))
        for pose in expected_poses(seed, 5)[1:]:
            live.step()
            np.testing.assert_array_equal(live.simulator.state.pose[0], pose)


def test_replay_shows_preferences_with_their_memory(here: Path) -> None:
    one = experiment("Preferring", traffic="rules")
    episode = record(one)
    liked = replay_of(episode, "mine", shares_of(one.policy, one.config)).liked
    assert liked is not None
    stops = liked.argmax(axis=-1) < 10  # backwards or at rest
    assert stops[:, 0].tolist() == [k % 3 == 2 for k in range(len(liked))]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("Unsaid", r"must return two arrays from act: the actions, and the next memory \[1, 3\]"),
        ("Alike", r"must keep a memory \[worlds, ...\]: memory\(1\) is \(3,\), and memory\(2\) is \(3,\)"),
        ("Half", "cannot be used as policy: it has no drawn"),
    ],
)
def test_invalid_memory_is_refused(here: Path, name: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        experiment(name)


class Constant:
    """Generator of constant draws, so that a batch draws the same as each of its worlds."""

    def random(self, shape: Any) -> Any:
        return np.full(shape, 0.3)

    def standard_exponential(self, shape: Any, dtype: Any) -> Any:
        return np.ones(shape, dtype)


@pytest.mark.parametrize("name", [*POLICIES, "my_policy.py:Wary", "my_policy.py:Preferring"])
@pytest.mark.parametrize("traffic", ["shield", "rules"])
def test_batch_equals_single_worlds_and_reset_equals_new_policy(here: Path, name: str, traffic: TrafficMode) -> None:
    add_policy(name)
    config = policy_config(name, EnvConfig(num_agents=5)).replace(traffic=traffic)
    rng, policy = cast(np.random.Generator, Constant()), make_policy(name, config)
    new = Actor(make_policy(name, config), config, 4)
    seen = np.random.default_rng(3).uniform(-1, 1, (8, 4, 5, observation_layout(config).size)).astype(np.float32)
    batch, alone = Actor(policy, config, 4), [Actor(policy, config) for _ in range(4)]
    first = []
    for look in seen:
        first.append(batch(look, rng))
        if batch.memory is None:  # and on each robot alone
            np.testing.assert_array_equal(
                first[-1].reshape(20, 1, -1), batch(look.reshape(20, 1, -1), rng).reshape(20, 1, -1)
            )
        np.testing.assert_array_equal(first[-1], np.concatenate([alone[b](look[b : b + 1], rng) for b in range(4)]))
    if batch.memory is not None:
        batch.memory[:] = policy.memory(4)  # type: ignore[attr-defined]
    for look, before in zip(seen, first, strict=True):
        np.testing.assert_array_equal(before, batch(look, rng))
        np.testing.assert_array_equal(before, new(look, rng))
