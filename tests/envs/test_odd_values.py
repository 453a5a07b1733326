"""Environments and simulators: whatever comes in works, or a WarehouseError says in one sentence what is wrong."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest

from warehouse_env import BatterySpec, EnvConfig, OrderSpec, aec_env, parallel_env, single_env, tensor_env, vec_env
from warehouse_env.config import RobotSpec
from warehouse_env.errors import ConfigError, WarehouseError
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.orders import Order

BASE: dict[str, Any] = {"num_agents": 2, "planner": "astar", "layout": "open", "max_steps": 6}
TINY = EnvConfig(**BASE)
STOP: dict[str, Any] = {"arrival": "stop"}


def test_a_robot_that_could_leap_over_the_rim_is_refused() -> None:
    """Once it came down beyond the map, and the lidar read memory that is not its own."""
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
def test_what_was_found(make: Callable[[], Any], sentence: str) -> None:
    """Each ended in another error, or in an endless allocation, once."""
    with pytest.raises(ConfigError, match=sentence):
        make()


def test_large_real_valued_actions_are_clipped_in_a_vec_env_too() -> None:
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
def bare(monkeypatch: pytest.MonkeyPatch) -> None:
    """No package of the extra `render` is installed."""
    for package in ("pygame", "matplotlib", "imageio_ffmpeg"):
        monkeypatch.setitem(sys.modules, package, None)


@pytest.mark.parametrize("factory", FACTORIES)
def test_a_missing_package_is_named_at_once(factory: str, tiny: EnvConfig, bare: None) -> None:
    with pytest.raises(WarehouseError) as caught:
        FACTORIES[factory](tiny, render_mode="rgb_array")
    assert str(caught.value) == "pictures need the package 'pygame'; pip install \"warehouse-env[render]\""


@pytest.mark.parametrize("factory", FACTORIES)
def test_without_pictures_no_package_is_missed(factory: str, tiny: EnvConfig, bare: None) -> None:
    FACTORIES[factory](tiny).reset()


def test_a_wrong_mode_is_named_first(tiny: EnvConfig, bare: None) -> None:
    with pytest.raises(ConfigError, match="rgb_array"):
        parallel_env(tiny, render_mode="rgb_aray")
