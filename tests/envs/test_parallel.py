"""Test PettingZoo and Gymnasium adapters: library checks, returned values and clear errors."""

from __future__ import annotations

import copy
import json
import math
import pickle
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test, render_test, seed_test
from stable_baselines3.common.env_checker import check_env as sb3_check

import warehouse_env
from warehouse_env import EnvConfig, Simulator, WarehouseParallelEnv, aec_env, parallel_env, single_env
from warehouse_env.errors import ActionError
from warehouse_env.simulation.senses.rewards import REWARD_TERMS


def strict(test: Callable[..., None]) -> Callable[..., None]:
    """Fail a test on any warning except that observations are unbounded (metres off the route are)."""
    return pytest.mark.filterwarnings("ignore:.*infinity")(pytest.mark.filterwarnings("error")(test))


@strict
def test_parallel_api(every_config: EnvConfig) -> None:
    parallel_api_test(parallel_env(every_config), num_cycles=15)


@strict
def test_parallel_seed(every_config: EnvConfig) -> None:
    parallel_seed_test(lambda: parallel_env(every_config), num_cycles=10)


@strict
def test_aec_seed(every_config: EnvConfig) -> None:
    seed_test(lambda: aec_env(every_config), num_cycles=15)


@strict
def test_aec_api(every_config: EnvConfig) -> None:
    api_test(aec_env(every_config), num_cycles=15)


def test_render_modes(tiny: EnvConfig) -> None:
    pytest.importorskip("pygame")
    render_test(lambda render_mode: aec_env(tiny, render_mode=render_mode))


def samples(env: WarehouseParallelEnv) -> dict[str, Any]:
    return {agent: env.action_space(agent).sample() for agent in env.agents}


def test_every_value_equals_the_simulators(tiny: EnvConfig) -> None:
    env, simulator = parallel_env(tiny), Simulator(tiny)
    observations, infos = env.reset(seed=5)
    expected = simulator.reset(5)
    assert list(observations) == ["robot_0", "robot_1", "robot_2"] == list(infos)
    rng = np.random.default_rng(0)
    for _ in range(12):
        np.testing.assert_array_equal(np.stack(list(observations.values())), expected[0])
        actions = rng.integers(0, simulator.action_space.n, 3)  # type: ignore[attr-defined]
        observations, rewards, terminations, truncations, infos = env.step(dict(zip(env.agents, actions, strict=True)))
        expected = simulator.step(actions[None])
        assert list(rewards.values()) == simulator.reward[0].tolist()
        assert list(terminations.values()) == [False] * 3
        assert list(truncations.values()) == [bool(simulator.truncated[0])] * 3
        for robot, info in enumerate(infos.values()):
            assert list(info["reward_terms"]) == list(REWARD_TERMS)
            assert list(info["reward_terms"].values()) == simulator.reward_terms[0, robot].tolist()
            assert info["collisions_robot"] == simulator.events.hit_robot[0, robot]
            assert info["gap"] == simulator.events.gap[0, robot]
    assert truncations["robot_0"]
    assert env.agents == []
    np.testing.assert_array_equal(env.state(), simulator.global_state(0))
    assert env.state() in env.state_space


READINGS: dict[str, Callable[[Any], Any]] = {
    "[]": lambda infos: infos["robot_1"],
    "iter": list,
    "values": lambda infos: list(infos.values()),
    "dict": dict,
    "**": lambda infos: {**infos},
    "|": lambda infos: infos | {"all": 1},
    "| from the right": lambda infos: {"all": 1} | infos,
    "pop": lambda infos: (infos.pop("robot_0"), dict(infos)),
    "deepcopy": copy.deepcopy,
    "pickle": lambda infos: pickle.loads(pickle.dumps(infos)),
    "json": json.dumps,
}


@pytest.mark.parametrize("name", READINGS)
def test_unread_infos_act_as_a_dict(tiny: EnvConfig, name: str) -> None:
    env, read = parallel_env(tiny), READINGS[name]
    env.reset(seed=1)
    infos, kept = (env.step(samples(env))[4] for _ in range(2))
    env.step(samples(env))
    expected = [dict(info) for info in env._infos.read(infos.unread[1])]  # type: ignore[attr-defined]
    plain = dict(zip(env.possible_agents, expected, strict=True))
    assert read(infos) == read(plain)
    assert infos == plain
    assert kept != plain


def cruise(env: WarehouseParallelEnv) -> dict[str, Any]:
    return dict.fromkeys(env.agents, env.simulator.cruise_action)


def test_arrived_robot_leaves_while_others_continue(tiny: EnvConfig) -> None:
    env = parallel_env(tiny, tasks="one_shot", max_steps=2000, num_agents=4)
    env.reset(seed=2)
    left: list[str] = []
    while env.agents:
        before = list(env.agents)
        observations, rewards, terminations, truncations, infos = env.step(cruise(env))
        assert before == list(observations) == list(rewards) == list(infos)
        over = [agent for agent in before if terminations[agent] or truncations[agent]]
        assert env.agents == [agent for agent in before if agent not in over]
        left += [agent for agent in over if terminations[agent]]
        assert all(infos[agent]["goals"] == 1 for agent in over if terminations[agent])
    assert left, "nobody arrived, so this tests nothing"
    assert sorted(set(left)) == sorted(left)


def test_actions_after_the_end_are_refused(tiny: EnvConfig) -> None:
    env = parallel_env(tiny, max_steps=1)
    env.reset(seed=0)
    actions = samples(env)
    env.step(actions)
    assert env.step({}) == ({}, {}, {}, {}, {})
    with pytest.raises(ActionError, match="robot_0"):
        env.step(actions)


@pytest.mark.parametrize(
    ("action_type", "bad"),
    [
        ("discrete", -1),
        ("discrete", "go"),
        ("continuous", [math.nan, 0.0]),
        ("continuous", [0.1, 0.2, 0.3]),
        ("raw", [[0.0, 0.0]]),
    ],
)
def test_bad_action_names_its_robot(tiny: EnvConfig, action_type: str, bad: object) -> None:
    env = parallel_env(tiny, action_type=action_type)
    env.reset(seed=0)
    with pytest.raises(ActionError, match="robot_1"):
        env.step({**samples(env), "robot_1": bad})
    env.step(samples(env))  # the env still works


def test_missing_and_extra_actions_name_their_robot(tiny: EnvConfig) -> None:
    env = parallel_env(tiny)
    env.reset(seed=0)
    actions = samples(env)
    with pytest.raises(ActionError, match="robot_9"):
        env.step({**actions, "robot_9": 0})
    del actions["robot_2"]
    with pytest.raises(ActionError, match="robot_2"):
        env.step(actions)


def test_action_of_a_departed_robot_is_ignored(tiny: EnvConfig) -> None:
    """TorchRL passes an action for every robot until the last one has left."""
    env, other = (parallel_env(tiny, tasks="one_shot", max_steps=2000) for _ in range(2))
    env.reset(seed=2)
    other.reset(seed=2)
    while len(env.agents) == 3:
        env.step(cruise(env))
        other.step(cruise(other))
    assert env.agents
    (gone,) = set(env.possible_agents) - set(env.agents)
    mine, its = env.step({**cruise(env), gone: math.nan}), other.step(cruise(other))
    assert gone not in mine[0]
    for agent in env.agents:
        np.testing.assert_array_equal(mine[0][agent], its[0][agent])
    with pytest.raises(ActionError, match="robot_9"):
        env.step({**cruise(env), gone: 0, "robot_9": 0})


@strict
def test_gymnasium_and_sb3_check(every_config: EnvConfig) -> None:
    made = gymnasium.make("Warehouse-v0", config=every_config)
    gymnasium_check(made.unwrapped, skip_render_check=True)
    sb3_check(made.unwrapped, skip_render_check=True)


def test_import_registers_the_env() -> None:
    code = (
        "import gymnasium\n"
        "env = gymnasium.make('warehouse_env:Warehouse-v0', layout='open', num_agents=2, planner='astar')\n"
        "env.reset(seed=0)\n"
        "env.step(env.action_space.sample())\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "Warehouse-v0" in gymnasium.registry
    assert warehouse_env.__name__ in sys.modules


@pytest.mark.parametrize("with_policy", [False, True])
def test_others_cruise_or_follow_their_own_policy(tiny: EnvConfig, with_policy: bool) -> None:
    seen: list[np.ndarray] = []

    def stand(observation: np.ndarray) -> np.ndarray:
        seen.append(observation)
        return np.full(len(observation), 5)

    env, simulator = single_env(tiny, others=stand if with_policy else None), Simulator(tiny)
    env.reset(seed=4)
    simulator.reset(4)
    theirs = 5 if with_policy else simulator.cruise_action
    for _ in range(12):
        now = simulator.observation[0, 1:].copy()
        observation, reward, terminated, truncated, _ = env.step(7)
        simulator.step(np.array([[7, theirs, theirs]]))
        np.testing.assert_array_equal(observation, simulator.observation[0, 0])
        assert reward == simulator.reward[0, 0]
        if with_policy:
            np.testing.assert_array_equal(seen[-1], now)
    assert truncated
    assert not terminated


def test_bad_others_and_missing_reset_are_refused(tiny: EnvConfig) -> None:
    with pytest.raises(gymnasium.error.ResetNeeded):
        single_env(tiny).step(0)
    env = single_env(tiny, others=lambda observation: [0, math.nan])
    env.reset(seed=0)
    with pytest.raises(ActionError, match="robot_2"):
        env.step(0)
    env = single_env(tiny, others=lambda observation: [0])
    env.reset(seed=0)
    with pytest.raises(ActionError, match="others"):
        env.step(0)
