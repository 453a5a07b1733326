"""The environment of torch tensors: Gymnasium's vector interface, and what a training step needs of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import warehouse_env
from train.cli import main
from warehouse_env import ConfigError, EnvConfig, Simulator, UncertaintySpec
from warehouse_env.simulation.record.recording import Episode, Recorder
from warehouse_env.simulation.state import global_view

CONFIG = EnvConfig(num_agents=6, planner="astar_turns", max_steps=20)


def test_an_episode_ends_with_its_last_observation_and_metrics_and_the_next_begins() -> None:
    env = warehouse_env.tensor_env(3, CONFIG, device="cpu")
    first, _ = env.reset(seed=4)
    assert env.observation_space.shape == first.shape == (18, env.single_observation_space.shape[0])
    first = first.clone()
    cruise = torch.full((18,), int(env.simulator.host.cruise_action))
    for step in range(1, 21):
        observation, reward, terminated, truncated, infos = env.step(cruise)
        assert reward.shape == terminated.shape == (18,)
        assert not terminated.any()
        assert bool(truncated.all()) is (step == 20)
    assert sorted(infos["world_metrics"]) == [0, 1, 2]
    assert all(row["robot_km"] > 0 for row in infos["world_metrics"].values())
    assert infos["_final_obs"].all()
    assert not torch.equal(infos["final_obs"], observation)  # the worlds have begun anew
    assert not torch.equal(observation, first)  # and elsewhere
    side = max(env.simulator.host.grid.shape) * env.simulator.host.grid.cell_size
    for world, robots in enumerate(env.simulator.download([0, 1, 2])):
        assert env.state()[world].tolist() == global_view(robots, side, env.simulator.config).tolist()
        assert (env.state(per_row=True)[6 * world : 6 * world + 6] == env.state()[world]).all()


@pytest.mark.parametrize("uncertainty", [None, UncertaintySpec(pose_error=0.05, actuation_error=0.05)])
def test_recorded_worlds_equal_a_simulators_and_are_replayed_and_audited(
    uncertainty: UncertaintySpec | None, tmp_path: Path
) -> None:
    config = CONFIG.replace(uncertainty=uncertainty)
    env, host = warehouse_env.tensor_env(3, config, device="cpu"), Recorder(Simulator(config, 2), (7, 8))
    env.reset(seed=4)
    actions = torch.randint(20, (25, 3, 6), generator=torch.Generator().manual_seed(1))
    env.step(actions[0].flatten())
    recorder = env.record([2, 0], seed=7)
    seen = env.simulator.observation
    assert seen[[2, 0]].tolist() == host.simulator.observation.tolist()
    for k, step in enumerate(actions):  # the episode has 20 steps, and that of the other world ends before
        env.step(step.flatten())
        if k < 20:
            host.step(step[[2, 0]].numpy())
    recorder.episode.save(tmp_path / "two.npz")
    kept, wanted = Episode.load(tmp_path / "two.npz"), host.episode
    assert kept.seeds == wanted.seeds == (7, 8)
    assert kept.actions.tolist() == wanted.actions.tolist()
    assert kept.pose.tolist() == wanted.pose.tolist()
    assert main(["audit", str(tmp_path / "two.npz"), "--out", str(tmp_path / "audit")]) == 0
    assert main(["replay", str(tmp_path / "two.npz"), "--html", str(tmp_path / "two.html"), "--seed", "8"]) == 0
    env.record([1]).episode.save(tmp_path / "none.npz")  # before its first step
    for worlds in ([], [0, 0], [3], [-1], [[0]], 0):
        with pytest.raises(ConfigError, match="worlds"):
            env.record(worlds)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="2\\*\\*63"):
        env.record([0, 1], seed=2**63 - 1)


@pytest.mark.parametrize("changes", [{}, {"terminate_on_collision": True}, {"tasks": "one_shot", "layout": "narrow"}])
def test_rewards_and_ends_are_those_of_the_simulator(changes: dict[str, Any]) -> None:
    """Robots stay terminated until their world begins anew: once it is truncated, or all its robots have terminated."""
    config = CONFIG.replace(max_steps=150, **changes)
    env, here = warehouse_env.tensor_env(3, config, device="cpu"), Simulator(config, 3)
    env.reset(seed=4)
    here.reset(4)
    ends = parked = 0
    for step in range(400):
        actions = np.random.default_rng(step).integers(0, 20, (3, 6))
        actions[:, : 1 + step % 6] = here.cruise_action
        observation, reward, terminated, truncated, infos = env.step(torch.from_numpy(actions.reshape(-1)))
        here.step(actions)
        ended = here.truncated | here.terminated.all(axis=1)
        assert torch.equal(reward, torch.from_numpy(here.reward.reshape(-1)))
        assert torch.equal(terminated, torch.from_numpy(here.terminated.reshape(-1)))
        assert truncated.tolist() == here.truncated.repeat(6).tolist()
        if ended.any():
            assert infos["_final_obs"].tolist() == ended.repeat(6).tolist()
            assert torch.equal(infos["final_obs"], torch.from_numpy(here.observation.reshape(18, -1)))
            here.reset_worlds(np.flatnonzero(ended).tolist())
        assert torch.equal(observation, torch.from_numpy(here.observation.reshape(18, -1)))
        ends, parked = ends + int(ended.sum()), parked + int(terminated.sum())
    assert ends > 0
    assert (parked > 0) is bool(changes)


def test_the_same_seed_gives_the_same_episode_in_any_number_of_worlds() -> None:
    few, many = warehouse_env.tensor_env(1, CONFIG, device="cpu"), warehouse_env.tensor_env(4, CONFIG, device="cpu")
    assert torch.equal(few.reset(seed=9)[0], many.reset(seed=9)[0][:6])
