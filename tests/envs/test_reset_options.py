"""Test that every adapter obeys reset options and actions, or refuses them in one sentence."""

from __future__ import annotations

import copy
import math
import sys
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest

from warehouse_env import (
    BatterySpec,
    EnvConfig,
    OrderSpec,
    Simulator,
    aec_env,
    parallel_env,
    single_env,
    tensor_env,
    vec_env,
)
from warehouse_env.config import RobotSpec
from warehouse_env.errors import ActionError, ConfigError, WarehouseError
from warehouse_env.simulation.tasks.orders import Order

CONFIG = EnvConfig(layout="open", num_agents=2, planner="astar")
STARTS = [(2.5, 4.5, 0.3), (8.5, 2.5, math.pi / 2)]
GOALS = [(9, 2), (3, 9)]
ONE = {"parallel": parallel_env, "aec": aec_env, "single": single_env}
ADAPTERS = [*ONE, "vector", "tensors", "torchrl"]


def begin(adapter: str, options: Any) -> tuple[Simulator, Any]:
    """Reset an env with seed 3 and options; return its simulator and the VecEnv, if it is one."""
    if adapter in ONE:
        env: Any = ONE[adapter](CONFIG)
        env.reset(seed=3, options=options)
        return env.unwrapped.simulator, None
    if isinstance(options, dict):  # for two worlds; the second has the tables reversed
        options = {name: [of, of[::-1]] if isinstance(of, list) else of for name, of in options.items()}
    if adapter == "vector":
        env = vec_env(configs=[CONFIG, CONFIG])
        env.seed(3)
        env.set_options(options)
        env.reset()
        return env.blocks[0].simulator, env
    if adapter == "tensors":
        env = tensor_env(2, CONFIG, device="cpu")
        env.reset(seed=3, options=options)
        simulator = Simulator(CONFIG, 2)
        simulator.robots[:] = env.simulator.download([0, 1])
        return simulator, None
    pytest.importorskip("torchrl")
    from warehouse_env.torchrl import torchrl_env

    env = torchrl_env(2, CONFIG, seed=3)
    env.reset(options=options)
    return env.simulator, None


@pytest.mark.parametrize("adapter", ADAPTERS)
def test_options_set_starts_and_goals(adapter: str) -> None:
    simulator, vector = begin(adapter, {"starts": STARTS, "goals": GOALS, "num_agents": 2})
    np.testing.assert_allclose(simulator.state.pose[0], STARTS, atol=1e-6)
    assert simulator.state.goal[0].tolist() == [list(goal) for goal in GOALS]
    if vector is not None:
        second = vector.blocks[1].simulator.state.pose[0]
        np.testing.assert_allclose(second, STARTS[::-1], atol=1e-6)
        vector.reset()  # options apply to one reset only
        assert not np.allclose(second, STARTS[::-1], atol=0.1)
    drawn = Simulator(CONFIG)
    drawn.reset(3)
    for nothing in (None, {"num_agents": 2, "starts": None}):
        np.testing.assert_array_equal(begin(adapter, nothing)[0].state.pose[0], drawn.state.pose[0])


@pytest.mark.parametrize("adapter", ADAPTERS)
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"start": STARTS}, "unknown option of a reset 'start'; did you mean starts?"),
        ({"goals": GOALS}, "starts and goals of a reset go together"),
        ({"num_agents": 0}, "num_agents=0 must be a whole number of at least 1"),
        ({"starts": [STARTS[0]] * 2, "goals": GOALS}, "robot 1 touches"),
        (3, "options=3 must be a dict of starts, goals, num_agents"),
    ],
)
def test_invalid_options_are_refused(adapter: str, options: Any, message: str) -> None:
    with pytest.raises(ConfigError) as refused:
        begin(adapter, options)
    assert message in str(refused.value)


@pytest.mark.parametrize("adapter", ADAPTERS)
def test_more_robots_than_the_env_was_made_for_are_refused(adapter: str) -> None:
    message = "is more than the 2" if adapter in ("parallel", "aec") else "only parallel_env and aec_env change"
    with pytest.raises(ConfigError, match=message):
        begin(adapter, {"num_agents": 3})


def test_episode_of_fewer_robots_equals_a_smaller_env() -> None:
    several, four = parallel_env(CONFIG, num_agents=4), parallel_env(CONFIG, num_agents=4)
    for env in (several, four):
        env.reset(seed=3)
    seen, _ = several.reset(seed=5, options={"num_agents": 2})
    two = parallel_env(CONFIG)
    expected, _ = two.reset(seed=5)
    for step in range(30):
        assert list(seen) == several.agents == ["robot_0", "robot_1"]
        assert all(np.array_equal(seen[name], expected[name]) for name in expected)
        several = copy.deepcopy(several)
        assert several.state().shape == several.state_space.shape
        assert np.array_equal(several.state()[:16], two.state())
        assert not several.state()[16:].any()
        commands = dict.fromkeys(several.agents, step % 3)
        seen, *rest = several.step(commands)
        expected, *same = two.step(commands)
        assert repr(rest) == repr(same)
    with pytest.raises(ActionError, match="robot_2"):
        several.step(dict.fromkeys(several.possible_agents, 0))
    several.reset(seed=3)
    assert several.agents == several.possible_agents
    for count in (3, 1, 4):  # without a seed, the last seed fixes the next episode
        seen, expected = (env.reset(options={"num_agents": count})[0] for env in (several, four))
        assert len(seen) == count
        assert all(np.array_equal(seen[name], expected[name]) for name in seen)


def test_fewer_robots_take_turns() -> None:
    env = aec_env(CONFIG, num_agents=4, max_steps=5)
    env.reset(seed=1, options={"num_agents": 3})
    acted = []
    for agent in env.agent_iter():
        over = env.terminations[agent] or env.truncations[agent]
        acted.append(agent)
        env.step(None if over else 0)
    assert acted == ["robot_0", "robot_1", "robot_2"] * 6


def test_each_world_needs_its_own_table() -> None:
    for starts in (STARTS, np.array(STARTS), 3):
        with pytest.raises(ConfigError, match="lists of a table for each of the 3 worlds"):
            vec_env(3, CONFIG).set_options({"starts": starts, "goals": [GOALS] * 3})


BASE: dict[str, Any] = {"num_agents": 2, "planner": "astar", "layout": "open", "max_steps": 6}
TINY = EnvConfig(**BASE)
STOP: dict[str, Any] = {"arrival": "stop"}


def test_robot_that_could_leap_over_the_rim_is_refused() -> None:
    """Such a robot could land beyond the map, where the lidar would read outside the map."""
    with pytest.raises(ConfigError, match="between two contact checks, more than a cell of 1 m"):
        Simulator(EnvConfig(robot=RobotSpec(wheelbase=0.001), time_step=10.0, **BASE))
    Simulator(EnvConfig(robot=RobotSpec(max_speed=15.0), **BASE))


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Simulator(EnvConfig(), 10**12), "num_worlds=1000000000000 of num_agents=8 .* GB"),
        (lambda: Simulator(EnvConfig(people=1000), 10**5), "people=1000, need .* GB"),
        (lambda: Simulator(EnvConfig(), True), "num_worlds=True must be a whole number"),
        (lambda: Simulator(EnvConfig(), 1.0), r"num_worlds=1\.0"),  # type: ignore[arg-type]
        (lambda: Simulator(EnvConfig(traffic="shield", robot=RobotSpec(max_acceleration=0.001))), "max_acceleration"),
        (lambda: Simulator(3), "config=3 must be of type EnvConfig"),  # type: ignore[arg-type]
        (lambda: parallel_env(grid="x"), "grid='x' must be of type GridMap"),
        (lambda: parallel_env(planner=3), "planner=3 must be a Planner"),
        (lambda: parallel_env({"num_agents": 3}), "config={'num_agents': 3} must be"),  # type: ignore[arg-type]
        (lambda: vec_env(1, configs=3), "configs=3 must be a list"),  # type: ignore[arg-type]
        (lambda: vec_env(1, TINY, configs=[TINY]), "either config or configs"),
        (lambda: vec_env(configs=[TINY, TINY.replace(action_type="raw")]), "the same sensor, action_type"),
        (lambda: vec_env([1, 2, 3], configs=[TINY, TINY]), "needs one number for each of the 2 configs"),
        (lambda: vec_env(0, TINY), "num_worlds=0"),
        (lambda: vec_env(1, num_agnets=3), "num_agents"),  # type: ignore[call-arg]
        (lambda: parallel_env(num_agent=3), "num_agents"),  # type: ignore[call-arg]
        (lambda: tensor_env(2, num_agent=3), "num_agents"),  # type: ignore[call-arg]
        (lambda: tensor_env(2, device="cpu", people=1, traffic="rules"), "people, live routes"),
        (lambda: vec_env([[1]]), r"num_worlds=\[1\] must be"),  # type: ignore[list-item]
        (lambda: parallel_env(**BASE).reset(seed="x"), "seed='x' must be a whole number"),  # type: ignore[arg-type]
        (lambda: single_env(**BASE).reset(seed=-1), "seed=-1 must be a whole number, not negative"),
        (lambda: vec_env(1, **BASE).seed([1]), r"seed=\[1\] must be"),  # type: ignore[arg-type]
        (lambda: Simulator(TINY, 2).reset(seed=[1, 2, 3]), "3 entries for 2 worlds"),
        (lambda: Simulator(TINY, 2).reset(seed=[4, -2]), "seed=-2"),
        (lambda: tensor_env(1, num_agents=2, device="foo"), "must be 'cpu', 'cuda'"),
        (lambda: tensor_env(1, num_agents=2, device="cuda:x"), "must be 'cpu', 'cuda'"),
        (lambda: Simulator(TINY.replace(battery=BatterySpec(chargers=4000), **STOP)), "chargers=4000 are too many"),
        (lambda: Simulator(TINY.replace(battery=BatterySpec(capacity=4.0), **STOP)), "capacity=4 Wh is too little"),
        (lambda: Simulator(TINY.replace(orders=OrderSpec(allocation="neares"), **STOP)), "did you mean nearest"),
        (lambda: Simulator(TINY, orders=[Order(0.0, ((1, 1),), (2, 2), 1.0, 1.0)]), "need orders=OrderSpec"),
    ],
)
def test_invalid_arguments_are_refused(make: Callable[[], Any], sentence: str) -> None:
    """Each argument once raised another error or allocated without end."""
    with pytest.raises(ConfigError, match=sentence):
        make()


def test_vec_env_stays_finite_under_large_continuous_actions() -> None:
    env = vec_env(1, action_type="continuous", **BASE)
    env.seed(1)
    env.reset()
    assert np.isfinite(env.step(np.full((2, 2), 1e300))[0]).all()


FACTORIES: dict[str, Callable[..., Any]] = {
    "parallel_env": parallel_env,
    "aec_env": aec_env,
    "single_env": single_env,
    "vec_env": lambda config, **options: vec_env(2, config, **options),
    "gymnasium.make": lambda config, **options: gymnasium.make("Warehouse-v0", config=config, **options),
    "gymnasium.make_vec": lambda config, **options: gymnasium.make_vec("Warehouse-v0", 1, config=config, **options),
}


@pytest.fixture
def no_render_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide all packages of the extra `render`."""
    for package in ("pygame", "matplotlib", "imageio_ffmpeg"):
        monkeypatch.setitem(sys.modules, package, None)


@pytest.mark.parametrize("factory", FACTORIES)
def test_missing_render_package_is_named_at_once(factory: str, tiny: EnvConfig, no_render_packages: None) -> None:
    with pytest.raises(WarehouseError) as caught:
        FACTORIES[factory](tiny, render_mode="rgb_array")
    assert str(caught.value) == "pictures need the package 'pygame'; pip install \"warehouse-env[render]\""


@pytest.mark.parametrize("factory", FACTORIES)
def test_env_without_pictures_needs_no_render_package(factory: str, tiny: EnvConfig, no_render_packages: None) -> None:
    FACTORIES[factory](tiny).reset()


def test_wrong_render_mode_is_named_first(tiny: EnvConfig, no_render_packages: None) -> None:
    with pytest.raises(ConfigError, match="rgb_array"):
        parallel_env(tiny, render_mode="rgb_aray")
