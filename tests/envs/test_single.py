"""Gymnasium: registration, both libraries' checkers, and who drives the other robots."""

from __future__ import annotations

import math
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check
from stable_baselines3.common.env_checker import check_env as sb3_check

import warehouse_env
from tests.envs.test_parallel import strict
from warehouse_env import EnvConfig, Simulator, single_env
from warehouse_env.errors import ActionError


@strict
def test_gymnasium_and_sb3_check(every_config: EnvConfig) -> None:
    made = gymnasium.make("Warehouse-v0", config=every_config)
    gymnasium_check(made.unwrapped, skip_render_check=True)
    sb3_check(made.unwrapped, skip_render_check=True)


def test_registered_by_the_import_alone() -> None:
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


@pytest.mark.parametrize("told", [False, True])
def test_others_cruise_unless_they_act_by_their_own_observations(tiny: EnvConfig, told: bool) -> None:
    seen: list[np.ndarray] = []

    def stand(observation: np.ndarray) -> np.ndarray:
        seen.append(observation)
        return np.full(len(observation), 5)

    env, simulator = single_env(tiny, others=stand if told else None), Simulator(tiny)
    env.reset(seed=4)
    simulator.reset(4)
    theirs = 5 if told else simulator.cruise_action
    for _ in range(12):
        now = simulator.observation[0, 1:].copy()
        observation, reward, terminated, truncated, _ = env.step(7)
        simulator.step(np.array([[7, theirs, theirs]]))
        np.testing.assert_array_equal(observation, simulator.observation[0, 0])
        assert reward == simulator.reward[0, 0]
        if told:
            np.testing.assert_array_equal(seen[-1], now)
    assert truncated
    assert not terminated


def test_bad_others_and_a_missing_reset_are_named(tiny: EnvConfig) -> None:
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
