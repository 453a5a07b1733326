"""Every env and the Simulator, copied at any moment in any way: the copy goes on to the bit and shares nothing."""

from __future__ import annotations

import copy
import itertools
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import cloudpickle
import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import RecordEpisodeStatistics, TimeLimit
from numpy.typing import NDArray

from tests.simulation.worlds import drawn
from warehouse_env import EnvConfig, GridMap, Simulator, aec_env, make_planner, parallel_env, single_env, vec_env
from warehouse_env.routes.book import RouteBook

GRID = drawn([*["............"] * 5, "....####....", *["............"] * 6])
SETTINGS: dict[str, Any] = {"num_agents": 3, "max_steps": 60, "planner": "astar", "action_repeat": 3}

WAYS: dict[str, Callable[[Any], Any]] = {
    "pickle": lambda thing: pickle.loads(pickle.dumps(thing)),
    "cloudpickle": lambda thing: cloudpickle.loads(cloudpickle.dumps(thing)),
    "deepcopy": copy.deepcopy,
}


class Hasty:
    """Drives the others in `single_env` at full speed, each step with another offset: it has a state to go along."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, observation: NDArray[np.float32]) -> list[int]:
        self.calls += 1
        return [15 + self.calls % 5] * len(observation)


class Drive:
    """A way to make an env, to start it and to step it; what comes out goes into one comparable value."""

    def __init__(self, make: Callable[..., Any]) -> None:
        self.make = make

    def begin(self, env: Any, seed: int | None = None) -> Any:
        """Reset."""
        return env.reset(seed=seed)

    def action(self, space: Any, k: int) -> Any:
        """Drive on, with an action by chance from time to time, so that the spaces' generators count."""
        return space.sample() if k % 4 == 0 else np.int64(17)

    def step(self, env: Any, k: int) -> tuple[Any, bool]:
        """Return all that a step gives, and whether the episode is over."""
        result = env.step(self.action(env.action_space, k))
        return result, bool(result[2] or result[3])

    def spaces(self, env: Any) -> list[Any]:
        """The spaces that actions are drawn from."""
        return [env.action_space]


class DriveParallel(Drive):
    def step(self, env: Any, k: int) -> tuple[Any, bool]:
        result = env.step({agent: self.action(env.action_space(agent), k) for agent in env.agents})
        return (result, env.state()), not env.agents

    def spaces(self, env: Any) -> list[Any]:
        return [env.action_space(agent) for agent in env.possible_agents]


class DriveInTurns(DriveParallel):
    def step(self, env: Any, k: int) -> tuple[Any, bool]:
        seen = []
        for agent in list(env.agents):
            over = env.terminations[agent] or env.truncations[agent]
            seen.append(env.last())
            env.step(None if over else self.action(env.action_space(agent), k))
        return seen, not env.agents


class DriveRows(Drive):
    def begin(self, env: Any, seed: int | None = None) -> Any:
        if seed is not None:
            env.seed(seed)
        return env.reset()

    def step(self, env: Any, k: int) -> tuple[Any, bool]:
        observation, reward, dones, infos = env.step(
            np.array([self.action(env.action_space, k) for _ in range(env.num_envs)])
        )
        for info in infos:
            info.get("episode", {}).pop("t", None)  # [s] of the clock
        return (observation, reward, dones, infos), False


class DriveSimulator(Drive):
    def step(self, env: Any, k: int) -> tuple[Any, bool]:
        actions = [[self.action(env.action_space, k) for _ in range(env.num_agents)] for _ in range(env.num_worlds)]
        env.step(actions)
        arrays = (env.observation, env.reward, env.reward_terms, env.truncated, env.robots, *env.state, *env.events)
        return [array.copy() for array in arrays], False


def wrapped(**options: Any) -> Any:
    made = gymnasium.make("Warehouse-v0", grid=GRID, **SETTINGS, **options)
    return RecordEpisodeStatistics(TimeLimit(made, 50))


DRIVES: dict[str, Drive] = {
    "parallel": DriveParallel(lambda **options: parallel_env(grid=GRID, **SETTINGS, **options)),
    "one_shot": DriveParallel(lambda **options: parallel_env(grid=GRID, tasks="one_shot", **SETTINGS, **options)),
    "aec": DriveInTurns(lambda **options: aec_env(grid=GRID, **SETTINGS, **options)),
    "single": Drive(lambda **options: single_env(grid=GRID, others=Hasty(), **SETTINGS, **options)),
    "gymnasium": Drive(lambda **options: gymnasium.make("Warehouse-v0", grid=GRID, **SETTINGS, **options)),
    "wrapped": Drive(wrapped),
    "vec_env": DriveRows(lambda **options: vec_env(2, grid=GRID, **SETTINGS, **options)),
    "mixed": DriveRows(
        lambda **options: vec_env(
            [1, 2], configs=[EnvConfig(**SETTINGS), EnvConfig(**SETTINGS | {"num_agents": 4})], grid=GRID, **options
        )
    ),
    "simulator": DriveSimulator(lambda: Simulator(EnvConfig(**SETTINGS), 2, grid=GRID)),
}


def brought_to(moment: str, drive: Drive) -> Any:
    """Return an env at a moment: "built", "reset", "driving", "ended", "seen" (a picture) or "shown" (a window)."""
    mode = {"seen": "rgb_array", "shown": "human"}.get(moment)
    env = drive.make(render_mode=mode) if mode else drive.make()
    for k, space in enumerate(drive.spaces(env)):
        space.seed(k)
    if moment == "built":
        return env
    drive.begin(env, 3)
    steps = {"reset": 0, "ended": 10**6}.get(moment, 7)
    for k in range(min(steps, SETTINGS["max_steps"])):
        if drive.step(env, k)[1]:
            break
    if mode:
        drawn = env.get_images() if isinstance(drive, DriveRows) else env.render()
        assert (drawn is not None) == (mode == "rgb_array" or isinstance(drive, DriveRows))
    return env


def went_on(moment: str, drive: Drive, env: Any) -> list[Any]:
    """Return all that the env gives from here on, into its next episode."""
    given: list[Any] = []
    fresh = moment in ("built", "ended")
    if fresh:
        given.append(drive.begin(env, 4 if moment == "built" else None))
    for k in range(10 if moment == "shown" else 60):
        result, over = drive.step(env, k)
        given.append(result)
        if over:
            given.append(drive.begin(env))
    return given


def same(given: Any, expected: Any) -> None:
    """Compare to the bit, nested as they may be; steps' times on the clock are no part of the env."""
    if isinstance(expected, dict):
        assert list(given) == list(expected)
        for key in expected:
            if (key, type(expected[key])) != ("t", float):
                same(given[key], expected[key])
    elif isinstance(expected, (list, tuple)):
        assert len(given) == len(expected)
        for mine, other in zip(given, expected, strict=True):
            same(mine, other)
    else:
        np.testing.assert_array_equal(given, expected)


CASES = [
    *itertools.product(DRIVES, ("pickle", "deepcopy"), ("driving", "ended")),
    *itertools.product(("parallel", "vec_env"), ("pickle",), ("built", "seen", "shown")),
    ("single", "cloudpickle", "driving"),
]


@pytest.fixture
def no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows show pictures as fast as they come."""
    pygame = pytest.importorskip("pygame")
    monkeypatch.setattr(pygame.time, "Clock", mock.Mock)


@pytest.mark.parametrize(("name", "way", "moment"), CASES, ids=["-".join(case) for case in CASES])
def test_a_copy_goes_on_to_the_bit(name: str, way: str, moment: str, request: pytest.FixtureRequest) -> None:
    """So do the original and a third, never copied; the copy drives first, and is done with before the original."""
    if moment in ("seen", "shown"):
        request.getfixturevalue("no_waiting")
    drive = DRIVES[name]
    never_copied, original = brought_to(moment, drive), brought_to(moment, drive)
    twin = WAYS[way](original)
    expected = went_on(moment, drive, never_copied)
    same(went_on(moment, drive, twin), expected)
    same(went_on(moment, drive, original), expected)
    for env in (never_copied, twin, original):
        if hasattr(env, "close"):
            env.close()


def test_what_the_user_gave_goes_along_as_it_is() -> None:
    env = brought_to("driving", DRIVES["single"])
    twin = copy.deepcopy(env)
    assert twin._others.calls == env._others.calls == 7
    twin.step(3)
    assert (twin._others.calls, env._others.calls) == (8, 7)
    twin = cloudpickle.loads(cloudpickle.dumps(single_env(grid=GRID, others=lambda seen: [3] * len(seen), **SETTINGS)))
    twin.reset(seed=0)
    twin.step(3)


@pytest.fixture
def slow_plans(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> GridMap:
    """A cache of the test's own, which keeps every plan."""
    monkeypatch.setenv("WAREHOUSE_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr("warehouse_env.routes.book.WORTH_KEEPING", 0.0)
    return GRID


def test_a_copy_finds_on_disk_what_was_about_to_be_written(slow_plans: GridMap) -> None:
    book = RouteBook(slow_plans, make_planner("astar"))
    expected = book.route((0, 0), (4, 5)).line
    twin = pickle.loads(pickle.dumps(book))
    assert twin._stored((0, 0), (4, 5)) is not None
    np.testing.assert_array_equal(twin.route((0, 0), (4, 5)).line, expected)
