"""The VecEnv against a Simulator stepped by hand, and a short PPO."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecMonitor

from warehouse_env import EnvConfig, Simulator, WarehouseVecEnv, parallel_env, vec_env
from warehouse_env.config import RobotSpec
from warehouse_env.errors import ActionError


def random_actions(env: WarehouseVecEnv, rng: np.random.Generator) -> np.ndarray:
    if env.action_space.shape:
        return rng.uniform(-1, 1, (env.num_envs, *env.action_space.shape)).astype(np.float32)
    return rng.integers(0, env.action_space.n, env.num_envs)  # type: ignore[attr-defined]


def test_rows_are_worlds_times_robots(every_config: EnvConfig) -> None:
    """Twelve steps end the episode in each mode; thirty go well into the third."""
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
    """Drives along the route at full speed, as evaluate_policy of stable-baselines3 asks."""

    def __init__(self, env: WarehouseVecEnv) -> None:
        self._action = env.get_attr("cruise_action")[0]

    def predict(self, observation: np.ndarray, state: Any = None, **more: Any) -> tuple[np.ndarray, Any]:
        return np.stack([self._action] * len(observation)), state


def one_shots(tiny: EnvConfig, episodes: int) -> list[tuple[float, int]]:
    """Return and length of every robot's episodes in PettingZoo, where robots that have arrived leave."""
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


@pytest.mark.filterwarnings("ignore:.*already wrapped with a `Monitor`")  # which says that VecMonitor is not needed
@pytest.mark.parametrize("wrapped", [False, True])
def test_a_robot_that_parks_ends_once(tiny: EnvConfig, wrapped: bool) -> None:
    """stable-baselines3 finds the episodes of PettingZoo, whether it reads the infos or counts itself."""
    returns, lengths = zip(*one_shots(tiny, 3), strict=True)
    assert len(set(lengths)) > 3
    assert max(lengths) < 500
    plain = vec_env(1, tiny, tasks="one_shot", max_steps=500)
    env = VecMonitor(plain) if wrapped else plain
    env.seed(2)
    found = evaluate_policy(Cruise(plain), env, n_eval_episodes=9, return_episode_rewards=True)  # type: ignore[arg-type]
    assert sorted(found[0]) == pytest.approx(returns, abs=1e-4)
    if not wrapped:  # VecMonitor counts the time that a row waits for its world to the next episode
        assert sorted(found[1]) == sorted(lengths)


def test_routes_are_planned_once_for_equal_maps(tiny: EnvConfig) -> None:
    configs = [tiny, tiny.replace(num_agents=2), tiny.replace(layout="narrow"), tiny.replace(planner="dijkstra")]
    configs.append(tiny.replace(robot=RobotSpec(width=0.8)))
    books = [block.simulator.route_book for block in vec_env(configs=configs).blocks]
    assert books[0] is books[1]
    assert len({id(book) for book in books}) == 4


def test_attributes_and_methods(tiny: EnvConfig) -> None:
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


def test_each_row_is_told_of_its_own_world(tiny: EnvConfig) -> None:
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
