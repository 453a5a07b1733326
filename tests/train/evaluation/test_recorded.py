"""A recorded episode is the one that an evaluation drives; a long one of many robots makes a small page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents import make_policy
from train.evaluation.recorded import record, shares_of
from train.evaluation.rollout import make_experiment, run
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, WarehouseError
from warehouse_env.render.replay import replay_of
from warehouse_env.render.replay_page import write_replay_page

BASE = EnvConfig(layout="open", num_agents=5, planner="astar")
FULL = {"traffic": "rules"}


@pytest.mark.parametrize(("policy", "chosen"), [("brake", {}), ("ppo", FULL)])
def test_what_is_recorded_is_what_is_evaluated(policy: str, chosen: dict[str, bool]) -> None:
    experiment = make_experiment(policy, BASE, 1, 12.0, 5, chosen)
    poses, steps = list[Any](), []
    (row,) = run(experiment, [lambda simulator, steps: poses.append(simulator.state.pose[0].copy())])
    episode = record(experiment, lambda: steps.append(1))
    np.testing.assert_array_equal(episode.pose[:, 0], np.stack(poses))
    assert (episode.policy, episode.seeds) == (policy, (5,))
    assert len(steps) == len(episode.actions) == experiment.config.max_steps
    *_, last = episode.replay()
    assert last.episode_metrics(0)["robot_km"] == row["robot_km"]


@pytest.mark.parametrize(
    ("policy", "disturbance", "said"), [("brake", "breakdown", "break down"), ("central_pibt", None, "routes")]
)
def test_what_an_episode_cannot_tell_is_refused(policy: str, disturbance: str | None, said: str) -> None:
    experiment = make_experiment(policy, BASE, 1, 5.0, 5, {}, disturbance)
    with pytest.raises(ConfigError, match=said):
        record(experiment)


def test_shares_of_a_learned_policy_are_its_chances_and_of_a_rule_its_order() -> None:
    config = make_experiment("ppo", BASE, 1, 5.0, 5).config
    observation = np.random.default_rng(1).uniform(-1, 1, (1, 5, 112)).astype(np.float32)
    learned = shares_of("ppo", config)
    assert learned is not None
    logits = make_policy("ppo", config).preferences(observation)  # type: ignore[attr-defined]
    chances = learned(observation)
    np.testing.assert_allclose(chances.sum(axis=-1), 1, atol=1e-9)
    np.testing.assert_array_equal(chances.argmax(axis=-1), logits.argmax(axis=-1))
    for without in ("", "central_pibt", "follow"):
        assert shares_of(without, config) is None
    with pytest.raises(WarehouseError):
        shares_of("no/such/folder", config)


@pytest.mark.nightly
def test_64_robots_over_2000_steps_are_under_5_mb(tmp_path: Path) -> None:
    base = EnvConfig(num_agents=64, planner="astar_turns")
    experiment = make_experiment("ppo", base, 1, 200.0, 3, FULL)
    assert experiment.config.max_steps == 2000
    episode = record(experiment)
    replay = replay_of(episode, "ppo", shares_of("ppo", episode.config))
    assert replay.liked is not None
    write_replay_page(tmp_path / "one.html", [replay], "64 robots")
    write_replay_page(tmp_path / "two.html", [replay, replay], "64 robots twice")
    assert (tmp_path / "one.html").stat().st_size < 2_500_000
    assert (tmp_path / "two.html").stat().st_size < 5_000_000
