"""The environment of torch tensors: Gymnasium's vector interface, and what a training step needs of it."""

from __future__ import annotations

import pytest
import torch

import warehouse_env
from warehouse_env import ConfigError, EnvConfig

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
    env.simulator.download([0, 1, 2])
    for world in range(3):
        assert env.state()[world].tolist() == env.simulator.host.global_state(world).tolist()


def test_the_same_seed_gives_the_same_episode_in_any_number_of_worlds() -> None:
    few, many = warehouse_env.tensor_env(1, CONFIG, device="cpu"), warehouse_env.tensor_env(4, CONFIG, device="cpu")
    assert torch.equal(few.reset(seed=9)[0], many.reset(seed=9)[0][:6])


def test_it_takes_the_changes_that_every_env_takes() -> None:
    env = warehouse_env.tensor_env(2, device="cpu", num_agents=3, layout="narrow")
    assert env.num_envs == 6
    with pytest.raises(ConfigError, match="num_agent"):
        warehouse_env.tensor_env(2, device="cpu", num_agent=3)  # type: ignore[call-arg]
    with pytest.raises(ConfigError, match="people"):
        warehouse_env.tensor_env(2, device="cpu", people=1)
