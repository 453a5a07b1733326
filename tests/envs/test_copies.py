"""Test copies of every env and the Simulator: a copy continues to the bit and shares no state."""

from __future__ import annotations

import copy
import itertools
import pickle
from collections.abc import Callable
from typing import Any

import cloudpickle
import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.simulation.worlds import drawn
from warehouse_env import EnvConfig, Simulator, WarehouseVecEnv, aec_env, parallel_env, single_env, vec_env

GRID = drawn([*["............"] * 5, "....####....", *["............"] * 6])
SETTINGS: dict[str, Any] = {"num_agents": 3, "max_steps": 60, "planner": "astar", "action_repeat": 3}

WAYS: dict[str, Callable[[Any], Any]] = {
    "pickle": lambda thing: pickle.loads(pickle.dumps(thing)),
    "cloudpickle": lambda thing: cloudpickle.loads(cloudpickle.dumps(thing)),
    "deepcopy": copy.deepcopy,
}


class FullSpeed:
    """Policy of the other robots in `single_env`: full speed, a new offset each step; copies include its state."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, observation: NDArray[np.float32]) -> list[int]:
        self.calls += 1
        return [15 + self.calls % 5] * len(observation)


def action(space: Any, k: int) -> Any:
    """Return the cruise action, or every fourth step a random one, so that copies need the space's generator."""
    return space.sample() if k % 4 == 0 else np.int64(17)


def step_one(env: Any, k: int) -> tuple[Any, bool]:
    """Step; return the results, and whether the episode is over."""
    result = env.step(action(env.action_space, k))
    return result, bool(result[2] or result[3])


def step_all(env: Any, k: int) -> tuple[Any, bool]:
    result = env.step({agent: action(env.action_space(agent), k) for agent in env.agents})
    return (result, env.state()), not env.agents


def step_in_turns(env: Any, k: int) -> tuple[Any, bool]:
    seen = []
    for agent in list(env.agents):
        over = env.terminations[agent] or env.truncations[agent]
        seen.append(env.last())
        env.step(None if over else action(env.action_space(agent), k))
    return seen, not env.agents


def step_rows(env: Any, k: int) -> tuple[Any, bool]:
    result = env.step(np.array([action(env.action_space, k) for _ in range(env.num_envs)]))
    for info in result[3]:
        info.get("episode", {}).pop("t", None)  # [s] wall-clock time
    return result, False


def step_simulator(env: Any, k: int) -> tuple[Any, bool]:
    env.step([[action(env.action_space, k) for _ in range(env.num_agents)] for _ in range(env.num_worlds)])
    arrays = (env.observation, env.reward, env.reward_terms, env.truncated, env.robots, *env.state, *env.events)
    return [array.copy() for array in arrays], False


FOUR = EnvConfig(**SETTINGS | {"num_agents": 4})
KINDS: dict[str, tuple[Callable[..., Any], Callable[[Any, int], tuple[Any, bool]]]] = {
    "parallel": (lambda **options: parallel_env(grid=GRID, **SETTINGS, **options), step_all),
    "one_shot": (lambda: parallel_env(grid=GRID, tasks="one_shot", **SETTINGS), step_all),
    "aec": (lambda: aec_env(grid=GRID, **SETTINGS), step_in_turns),
    "single": (lambda: single_env(grid=GRID, others=FullSpeed(), **SETTINGS), step_one),
    "gymnasium": (lambda: gymnasium.make("Warehouse-v0", grid=GRID, **SETTINGS), step_one),
    "vec_env": (lambda **options: vec_env(2, grid=GRID, **SETTINGS, **options), step_rows),
    "mixed": (lambda: vec_env([1, 2], configs=[EnvConfig(**SETTINGS), FOUR], grid=GRID), step_rows),
    "simulator": (lambda: Simulator(EnvConfig(**SETTINGS), 2, grid=GRID), step_simulator),
}


def begin(env: Any, seed: int | None = None) -> Any:
    if not isinstance(env, WarehouseVecEnv):
        return env.reset(seed=seed)
    if seed is not None:
        env.seed(seed)
    return env.reset()


def env_at(moment: str, name: str) -> Any:
    """Return an env at a moment: "built", "driving", "ended" or "seen" (a picture)."""
    (make, step), seen = KINDS[name], moment == "seen"
    env = make(render_mode="rgb_array") if seen else make()
    agents = getattr(env, "possible_agents", None)
    for k, space in enumerate([env.action_space] if agents is None else map(env.action_space, agents)):
        space.seed(k)
    if moment == "built":
        return env
    begin(env, 3)
    for k in range(SETTINGS["max_steps"] if moment == "ended" else 7):
        if step(env, k)[1]:
            break
    if seen:
        env.get_images() if isinstance(env, WarehouseVecEnv) else env.render()
    return env


def results_from(moment: str, name: str, env: Any) -> list[Any]:
    """Return all further results of the env, into its next episode."""
    given: list[Any] = []
    if moment in ("built", "ended"):
        given.append(begin(env, 4 if moment == "built" else None))
    for k in range(60):
        result, over = KINDS[name][1](env, k)
        given.append(result)
        if over:
            given.append(begin(env))
    return given


def assert_same(given: Any, expected: Any) -> None:
    """Assert that nested values are equal to the bit."""
    if isinstance(expected, dict):
        assert list(given) == list(expected)
        assert_same(list(given.values()), list(expected.values()))
    elif isinstance(expected, (list, tuple)):
        assert len(given) == len(expected)
        for mine, other in zip(given, expected, strict=True):
            assert_same(mine, other)
    else:
        np.testing.assert_array_equal(given, expected)


CASES = [
    *itertools.product(KINDS, ("pickle", "deepcopy"), ("driving", "ended")),
    *itertools.product(("parallel", "vec_env"), ("pickle",), ("built", "seen")),
    ("single", "cloudpickle", "driving"),
]


@pytest.mark.parametrize(("name", "way", "moment"), CASES, ids=["-".join(case) for case in CASES])
def test_copy_continues_to_the_bit(name: str, way: str, moment: str) -> None:
    """Compare copy, original and an env that was never copied; the copy drives before the original."""
    if moment == "seen":
        pytest.importorskip("pygame")
    never_copied, original = env_at(moment, name), env_at(moment, name)
    twin = WAYS[way](original)
    expected = results_from(moment, name, never_copied)
    assert_same(results_from(moment, name, twin), expected)
    assert_same(results_from(moment, name, original), expected)
    for env in (never_copied, twin, original):
        if hasattr(env, "close"):
            env.close()


def test_copy_includes_the_users_policy() -> None:
    env = env_at("driving", "single")
    twin = copy.deepcopy(env)
    assert twin._others.calls == env._others.calls == 7
    twin.step(3)
    assert (twin._others.calls, env._others.calls) == (8, 7)
    twin = cloudpickle.loads(cloudpickle.dumps(single_env(grid=GRID, others=lambda seen: [3] * len(seen), **SETTINGS)))
    twin.reset(seed=0)
    twin.step(3)
