"""Environments and simulators: whatever comes in works, or a WarehouseError says in one sentence what is wrong."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.odd import works_or_says
from warehouse_env.config import EnvConfig, RobotSpec, SensorSpec
from warehouse_env.envs.parallel import parallel_env
from warehouse_env.envs.single import single_env
from warehouse_env.envs.vector import vec_env
from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.simulator import Simulator

BASE: dict[str, Any] = {"num_agents": 2, "planner": "astar", "layout": "open", "max_steps": 6}


def ends(low: float, high: float) -> st.SearchStrategy[float]:
    return st.one_of(st.sampled_from([low, high]), st.floats(low, high))


wild_robots = st.fixed_dictionaries(
    {},
    optional={
        **{name: ends(1e-3, 1e4) for name in ("length", "width", "wheelbase", "max_speed", "max_acceleration")},
        "max_steering_rate": ends(1e-3, 1e4), "min_speed": ends(-1e4, 0.0), "max_steering": ends(1e-3, 1.57),
    },
)  # fmt: skip
wild_sensors = st.fixed_dictionaries(
    {},
    optional={
        **{name: st.sampled_from([1, 7, 4096]) for name in ("rays", "neighbours", "route_points")},
        "lidar_range": ends(1e-3, 1e4), "route_spacing": ends(1e-3, 1e4), "predictions": st.booleans(),
    },
)  # fmt: skip
wild_worlds = st.fixed_dictionaries(
    {},
    optional={
        "substeps": st.sampled_from([1, 1000]), "time_step": ends(1e-3, 10.0), "arrival_radius": ends(1e-3, 1e4),
        "near_miss_gap": ends(1e-3, 1e4), "keep_right": ends(0.0, 100.0), "num_agents": st.sampled_from([1, 5, 40]),
        "speed_levels": st.lists(ends(-1e4, 1e4), min_size=1, max_size=3),
        "lateral_offsets": st.lists(ends(-1e4, 1e4), min_size=1, max_size=3),
    },
)  # fmt: skip
FLOORS = [None, *(GridMap(np.zeros((r, c)), cell_size=s) for r, c, s in ((3, 40, 1.0), (6, 6, 0.01), (9, 9, 30.0)))]


@settings(max_examples=20)
@given(wild_robots, wild_sensors, wild_worlds, st.sampled_from(FLOORS), st.sampled_from(["discrete", "raw"]))
def test_extreme_worlds_run_with_finite_numbers(
    robot: dict[str, Any], sensor: dict[str, Any], world: dict[str, Any], grid: GridMap | None, action_type: Any
) -> None:
    def run() -> None:
        changes = {**BASE, **world, "action_type": action_type}
        config = EnvConfig(robot=RobotSpec(**robot), sensor=SensorSpec(**sensor), **changes)
        simulator = Simulator(config, grid=grid)
        simulator.reset(3)
        simulator.action_space.seed(1)
        for _ in range(3):
            drawn = [[simulator.action_space.sample() for _ in range(config.num_agents)]]
            assert np.isfinite(simulator.step(np.array(drawn))).all()
            assert np.isfinite(simulator.reward).all()

    works_or_says(run)


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
        (lambda: Simulator(3), "config=3 must be of type EnvConfig"),  # type: ignore[arg-type]
        (lambda: parallel_env(grid="x"), "grid='x' must be of type GridMap"),
        (lambda: parallel_env(planner=3), "planner=3 must be a Planner"),
        (lambda: parallel_env({"num_agents": 3}), "config={'num_agents': 3} must be"),  # type: ignore[arg-type]
        (lambda: vec_env(1, configs=3), "configs=3 must be a list"),  # type: ignore[arg-type]
        (lambda: vec_env([[1]]), r"num_worlds=\[1\] must be"),  # type: ignore[list-item]
        (lambda: parallel_env(**BASE).reset(seed="x"), "seed='x' must be a whole number"),  # type: ignore[arg-type]
        (lambda: single_env(**BASE).reset(seed=-1), "seed=-1 must be a whole number, not negative"),
        (lambda: vec_env(1, **BASE).seed([1]), r"seed=\[1\] must be"),  # type: ignore[arg-type]
    ],
)
def test_what_was_found(make: Callable[[], Any], sentence: str) -> None:
    """Each ended in another error, or in an endless allocation, once."""
    with pytest.raises(ConfigError, match=sentence):
        make()


def test_numbers_of_numpy_will_do() -> None:
    assert vec_env(np.int64(2), **BASE).num_envs == 4  # type: ignore[arg-type]
    assert vec_env(np.array([2, 1]), configs=[EnvConfig(**BASE)] * 2).num_envs == 6  # type: ignore[arg-type]
    simulator = Simulator(EnvConfig(**BASE), 2)
    first = simulator.reset(np.array([3, 4])).copy()  # type: ignore[arg-type]
    assert np.array_equal(first, simulator.reset((3, np.int8(4))))
    assert np.array_equal(parallel_env(**BASE).reset(seed=2**70)[0]["robot_0"].shape, first[0, 0].shape)


def test_large_real_valued_actions_are_clipped_in_a_vec_env_too() -> None:
    env = vec_env(1, action_type="continuous", **BASE)
    env.seed(1)
    env.reset()
    assert np.isfinite(env.step(np.full((2, 2), 1e300))[0]).all()
