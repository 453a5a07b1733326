"""Test the VecEnv and the env of torch tensors against a Simulator stepped by hand."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecMonitor

import warehouse_env
from train.cli import main
from warehouse_env import ConfigError, EnvConfig, Simulator, UncertaintySpec, WarehouseVecEnv, parallel_env, vec_env
from warehouse_env.config import RobotSpec
from warehouse_env.errors import ActionError
from warehouse_env.simulation.record.recording import Episode, Recorder
from warehouse_env.simulation.state import global_view


def random_actions(env: WarehouseVecEnv, rng: np.random.Generator) -> np.ndarray:
    if env.action_space.shape:
        return rng.uniform(-1, 1, (env.num_envs, *env.action_space.shape)).astype(np.float32)
    return rng.integers(0, env.action_space.n, env.num_envs)  # type: ignore[attr-defined]


def test_rows_are_worlds_times_robots(every_config: EnvConfig) -> None:
    """Step thirty times: an episode has twelve steps, so this reaches the third one."""
    env, simulator = vec_env(2, every_config), Simulator(every_config, 2)
    rng = np.random.default_rng(0)
    parked = np.zeros((2, 3), dtype=bool)
    env.seed(3)
    np.testing.assert_array_equal(env.reset(), simulator.reset(3).reshape(6, -1))
    for _ in range(30):
        actions = random_actions(env, rng)
        observation, reward, dones, infos = env.step(actions)
        simulator.step(actions.reshape(2, 3, *actions.shape[1:]))
        terminated = simulator.terminated.copy()
        ended = (terminated | simulator.truncated[:, None]) & ~parked
        np.testing.assert_array_equal(dones, ended.ravel())
        np.testing.assert_array_equal(reward, np.where(parked, 0, simulator.reward).ravel())
        padding = parked.ravel()
        parked = terminated & ~(simulator.truncated | terminated.all(axis=1))[:, None]
        last = simulator.observation.reshape(6, -1).copy()
        for world in np.flatnonzero(simulator.truncated | terminated.all(axis=1)):
            simulator.reset_world(int(world))
        np.testing.assert_array_equal(observation, np.where(parked[..., None], 0, simulator.observation).reshape(6, -1))
        for row, info in enumerate(infos):
            assert ("terminal_observation" in info) == ("episode" in info) == dones[row]
            if dones[row]:
                np.testing.assert_array_equal(info["terminal_observation"], last[row])
                assert info["TimeLimit.truncated"] == (not terminated.ravel()[row])
            else:
                assert info == ({"padding": True} if padding[row] else {})


class Cruise:
    """Policy at full speed along the route, with the interface of evaluate_policy of stable-baselines3."""

    def __init__(self, env: WarehouseVecEnv) -> None:
        self._action = env.get_attr("cruise_action")[0]

    def predict(self, observation: np.ndarray, state: Any = None, **more: Any) -> tuple[np.ndarray, Any]:
        return np.stack([self._action] * len(observation)), state


def one_shots(tiny: EnvConfig, episodes: int) -> list[tuple[float, int]]:
    """Return (return, length) of every robot's episodes in PettingZoo, where arrived robots leave."""
    env = parallel_env(tiny, tasks="one_shot", max_steps=500)
    found = []
    for episode in range(episodes):
        env.reset(seed=None if episode else 2)
        rewards: dict[str, list[float]] = {agent: [] for agent in env.agents}
        while env.agents:
            for agent, reward in env.step(dict.fromkeys(env.agents, env.simulator.cruise_action))[1].items():
                rewards[agent].append(reward)
        found += [(sum(each), len(each)) for each in rewards.values()]
    return sorted(found)


@pytest.mark.filterwarnings("ignore:.*already wrapped with a `Monitor`")  # VecMonitor is redundant
@pytest.mark.parametrize("wrapped", [False, True])
def test_parked_robot_ends_once(tiny: EnvConfig, wrapped: bool) -> None:
    """Check that stable-baselines3 finds PettingZoo's episodes, by the infos and by its own count."""
    returns, lengths = zip(*one_shots(tiny, 3), strict=True)
    assert len(set(lengths)) > 3
    assert max(lengths) < 500
    plain = vec_env(1, tiny, tasks="one_shot", max_steps=500)
    env = VecMonitor(plain) if wrapped else plain
    env.seed(2)
    found = evaluate_policy(Cruise(plain), env, n_eval_episodes=9, return_episode_rewards=True)  # type: ignore[arg-type]
    assert sorted(found[0]) == pytest.approx(returns, abs=1e-4)
    if not wrapped:  # VecMonitor adds a parked row's waiting time to the next episode
        assert sorted(found[1]) == sorted(lengths)


def test_equal_maps_share_their_routes(tiny: EnvConfig) -> None:
    configs = [tiny, tiny.replace(num_agents=2), tiny.replace(layout="narrow"), tiny.replace(planner="dijkstra")]
    configs.append(tiny.replace(robot=RobotSpec(width=0.8)))
    books = [block.simulator.route_book for block in vec_env(configs=configs).blocks]
    assert books[0] is books[1]
    assert len({id(book) for book in books}) == 4


def test_attributes_are_read_and_set_by_row(tiny: EnvConfig) -> None:
    env = vec_env(configs=[tiny, tiny.replace(num_agents=2)])
    env.reset()
    assert env.get_attr("num_agents") == [3, 3, 3, 2, 2]
    assert env.get_attr("num_agents", indices=[0, 4]) == [3, 2]
    assert env.get_attr("render_mode") == [None] * 5
    assert env.has_attr("config")
    assert not env.has_attr("no_such_thing")
    env.set_attr("note", "here", indices=3)
    assert env.get_attr("note", indices=4) == ["here"]
    with pytest.raises(AttributeError):
        env.get_attr("note", indices=0)
    assert env.env_is_wrapped(VecMonitor) == [False] * 5  # type: ignore[arg-type]


def test_each_row_reads_its_own_world(tiny: EnvConfig) -> None:
    env = vec_env([1, 2], configs=[tiny.replace(num_agents=2), tiny], max_steps=100)
    env.reset()
    env.step(random_actions(env, np.random.default_rng(0)))
    env.env_method("reset_world", indices=[5])  # the last world
    one, two = (block.simulator for block in env.blocks)
    expected = [one.global_state(0)] * 2 + [two.global_state(0)] * 3 + [two.global_state(1)] * 3
    assert not np.array_equal(expected[2], expected[5])
    state = env.state(per_row=True)
    assert state.shape == (8, 24)
    for row, view in enumerate(expected):
        np.testing.assert_array_equal(state[row], np.pad(view, (0, 24 - len(view))))
        np.testing.assert_array_equal(env.env_method("global_state")[row], view)
    np.testing.assert_array_equal(env.state(), state[[0, 2, 5]])
    assert env.env_method("seconds") == env.env_method("seconds", indices=range(8)) == [0.1] * 5 + [0.0] * 3
    assert env.env_method("seconds", 0) == [0.1] * 8
    assert [row["seconds"] for row in env.env_method("episode_metrics")] == env.env_method("seconds")


@pytest.mark.parametrize(
    ("action_type", "actions"),
    [
        ("discrete", np.zeros(5, dtype=int)),
        ("discrete", np.zeros(6)),
        ("discrete", np.full(6, 20)),
        ("continuous", np.zeros((6, 3))),
        ("raw", np.full((6, 2), math.inf)),
    ],
)
def test_bad_actions_are_refused(tiny: EnvConfig, action_type: str, actions: Any) -> None:
    env = vec_env(2, tiny, action_type=action_type)
    env.reset()
    with pytest.raises(ActionError):
        env.step(actions)


CONFIG = EnvConfig(num_agents=6, planner="astar_turns", max_steps=20)


def test_episode_end_gives_last_observation_and_metrics() -> None:
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
    assert not torch.equal(infos["final_obs"], observation)  # the worlds have restarted
    assert not torch.equal(observation, first)  # from other starts
    side = max(env.simulator.host.grid.shape) * env.simulator.host.grid.cell_size
    for world, robots in enumerate(env.simulator.download([0, 1, 2])):
        assert env.state()[world].tolist() == global_view(robots, side, env.simulator.config).tolist()
        assert (env.state(per_row=True)[6 * world : 6 * world + 6] == env.state()[world]).all()


# The shield shares compiled kernels with the tests of a device.
ERRORS: dict[str, Any] = {"traffic": "shield", "uncertainty": UncertaintySpec(pose_error=0.05, actuation_error=0.05)}


@pytest.mark.parametrize("changes", [{}, ERRORS], ids=["exact", "errors"])
def test_recorded_worlds_equal_the_simulator_and_pass_audit(changes: dict[str, Any], tmp_path: Path) -> None:
    config = CONFIG.replace(**changes)
    env, host = warehouse_env.tensor_env(3, config, device="cpu"), Recorder(Simulator(config, 2), (7, 8))
    env.reset(seed=4)
    actions = torch.randint(20, (25, 3, 6), generator=torch.Generator().manual_seed(1))
    env.step(actions[0].flatten())
    recorder = env.record([2, 0], seed=7)
    seen = env.simulator.observation
    assert seen[[2, 0]].tolist() == host.simulator.observation.tolist()
    for k, step in enumerate(actions):  # the recorded episodes have 20 steps; the other world's ends earlier
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
def test_rewards_and_ends_equal_the_simulators(changes: dict[str, Any]) -> None:
    """Robots stay terminated until their world restarts: when it is truncated or all its robots have terminated."""
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


def test_episode_does_not_depend_on_the_number_of_worlds() -> None:
    few, many = warehouse_env.tensor_env(1, CONFIG, device="cpu"), warehouse_env.tensor_env(4, CONFIG, device="cpu")
    assert torch.equal(few.reset(seed=9)[0], many.reset(seed=9)[0][:6])
