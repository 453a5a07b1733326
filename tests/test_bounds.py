"""Drive random episodes over all options with bounds checks in all kernels.

    make bounds                                                                    # EPISODES=100, and hostile inputs
    NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=DIR EPISODES=18 pytest tests/test_bounds.py -k "[17]"      # one of them

Negative indices count as out of range: no kernel uses them. Episode K depends on K alone. GROUP consecutive
episodes share the same SHAPES, because each new combination compiles for minutes.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
from collections.abc import Callable
from random import Random
from typing import Any

import numba
import numpy as np
import pytest
from numba.np import arrayobj
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig, FleetPart, RewardWeights, RobotSpec, SensorSpec
from warehouse_env.errors import WarehouseError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import LAYOUTS
from warehouse_env.maps.movingai import EXAMPLE_MAP
from warehouse_env.planning import PLANNERS
from warehouse_env.simulation.physics.deviation import errs
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment
from warehouse_env.traffic_spec import ErrorBounds, TrafficSpec, UncertaintySpec
from warehouse_env.work import BatterySpec, OrderSpec, ServiceSpec

GROUP, ATTEMPTS = 5, 20
STEPS, WORLDS = 60, 2

LONG = RobotSpec(length=1.4, width=0.8, wheelbase=0.9, front_overhang=0.25)
FORK = RobotSpec(length=2.6, width=1.0, wheelbase=1.6, front_overhang=2.2, max_speed=1.0)
SMALL = RobotSpec(length=0.5, width=0.4, wheelbase=0.3, front_overhang=0.1, max_speed=2.5, max_acceleration=3.0)


def _one(*values: Any) -> Callable[[Random], Any]:
    return lambda rng: rng.choice(values)


CHOICES: dict[str, Callable[[Random], Any]] = {  # field of EnvConfig -> function that draws a value
    "layout": lambda rng: rng.choice([*sorted(LAYOUTS), str(EXAMPLE_MAP)]),
    "num_agents": lambda rng: rng.choice([1, 2, 3, 8, 40]),
    "planner": lambda rng: rng.choice(["astar", "astar_turns", "pf_aco", rng.choice(sorted(PLANNERS))]),
    "tasks": _one("lifelong", "lifelong", "one_shot"),
    "action_type": _one("discrete", "continuous", "raw"),
    "max_steps": _one(20, 1000),
    "time_step": _one(0.05, 0.1, 0.2),
    "substeps": _one(1, 2, 5),
    "action_repeat": _one(1, 2, 3),
    "arrival": _one("pass", "stop", "pose"),
    "arrival_radius": _one(0.05, 0.5, 3.0),
    "pose_radius": _one(0.01, 0.05, 1.0),
    "pose_angle": _one(0.01, 0.1, math.pi),
    "near_miss_gap": _one(0.01, 0.1, 2.0),
    "quick_searches": _one(False, False, True),
    "stuck_after": _one(1.0, 60.0),
    "terminate_on_collision": _one(False, True),
    "speed_levels": _one((-0.4, 0.0, 0.5, 1.5), (0.0, 1e4), (-1e4,)),
    "lateral_offsets": _one((0.0, 0.6, -0.6, 1.2, -1.2), (0.0,), (-1e4, 1e4)),
    "keep_right": _one(0.0, 0.5, 100.0),
    "people": _one(0, 0, 1, 4),
    "traffic": lambda rng: TrafficSpec(
        shield=rng.choice([False, True, True]), margin=rng.choice([0.0, 0.02, 1.0]),
        right_of_way=rng.random() < 0.5, right_of_way_after=rng.choice([0.0, 5.0]),
        routes=rng.choice([False, True, "barred"]),
    ),
    "uncertainty": lambda rng: UncertaintySpec(
        latency=rng.choice([0.0, 0.3]), pose_error=rng.choice([0.0, 0.0, 0.02, 1.0]),
        heading_error=rng.choice([0.0, 0.5]), actuation_error=rng.choice([0.0, 0.5]), loss=rng.choice([0.0, 0.3, 1.0]),
        burst=rng.choice([0.0, 2.0]), declared=rng.choice([None, ErrorBounds(), ErrorBounds(latency=0.3)]),
    ),
    "service": _one(None, ServiceSpec(1.0, 1.0, 0.5, load=200.0)),
    "orders": _one(None, OrderSpec(per_hour=2000.0, picks=3)),
    "battery": _one(None, BatterySpec(capacity=5.0, chargers=1)),
    "robot": _one(RobotSpec(), RobotSpec(), LONG, FORK, SMALL),
    "fleet": _one((), (), (FleetPart(1, LONG),), (FleetPart(1, SMALL), FleetPart(1, FORK))),
    "sensor": lambda rng: SensorSpec(
        rays=rng.choice([0, 16, 90]), lidar_range=rng.choice([0.3, 6.0, 100.0]), neighbours=rng.choice([0, 6, 20]),
        route_points=rng.choice([0, 5]), route_spacing=rng.choice([0.01, 1.0, 50.0]),
    ),
    "reward": _one(RewardWeights(), RewardWeights(path_length=-1.0)),
}  # fmt: skip
SHAPES = (
    "tasks", "action_type", "arrival", "terminate_on_collision", "traffic", "uncertainty", "people",
    "service", "orders", "battery", "fleet",
)  # fmt: skip


def _room(rows: int, columns: int, **more: Any) -> GridMap:
    bare = GridMap(np.zeros((rows, columns)), name="room", **more)
    return dataclasses.replace(bare, picks=bare.free_cells[::2], stations=bare.free_cells[1::2])


FLOORS: dict[str, Callable[[Random], GridMap | None]] = {
    "layout": lambda rng: None,  # the layout of the config
    "tiny": lambda rng: _room(3, 3, cell_size=rng.choice([0.8, 1.0, 2.0])),
    "lane": lambda rng: _room(rng.choice([1, 2]), rng.randint(8, 12)),
    "fine": lambda rng: _room(16, 24, cell_size=0.3),
    "discs": lambda rng: _room(9, 12, discs=np.array([[4.3, 4.4, 0.6], [0.2, 0.2, 0.3], [11.9, 8.0, 0.25]])),
    "slow": lambda rng: _room(7, 9, speed=np.where(np.arange(63).reshape(7, 9) % 5, np.inf, 0.4)),
    "one way": lambda rng: _room(5, 9, one_way=np.array([[0] * 9, [1] * 9, [0] * 9, [3] * 9, [0] * 9], np.uint8)),
}


def options_of(number: int, attempt: int = 0) -> tuple[EnvConfig, GridMap | None]:
    """Return config and floor of an attempt at an episode; None is the floor that the config names."""
    shape, own = Random(f"0 shape {number // GROUP}"), Random(f"0 {number} {attempt}")
    while True:
        with contextlib.suppress(WarehouseError):
            given = {name: CHOICES[name](shape) for name in SHAPES}
            EnvConfig(**{"num_agents": 8, **given})
            break
    grid = list(FLOORS.values())[number // GROUP % len(FLOORS)](own)
    if grid is not None:
        given["battery"] = None  # no room for chargers beside the traffic
    while True:
        drawn = {name: choose(own) for name, choose in CHOICES.items() if name not in SHAPES}
        if grid is not None and drawn["num_agents"] > grid.occupied.size // 4:
            continue
        with contextlib.suppress(WarehouseError):
            return EnvConfig(**{**given, **drawn}), grid


def _begun(number: int) -> Simulator | None:
    """Return the simulator of the first attempt that can start, or None if no robots fit on the floor."""
    for again in range(ATTEMPTS):
        config, grid = options_of(number, again)
        with contextlib.suppress(WarehouseError):
            simulator = Simulator(config, WORLDS, grid=grid)
            simulator.reset([number, 0])
            return simulator
    return None


@pytest.mark.skipif(not numba.config.BOUNDSCHECK, reason="`make bounds` compiles kernels that check their indices")  # type: ignore[attr-defined]
@pytest.mark.parametrize("number", range(int(os.environ.get("EPISODES", "1"))))
def test_episode_stays_within_its_arrays(number: int) -> None:
    simulator, rng = _begun(number), np.random.default_rng([0, number])
    if simulator is None:
        pytest.skip("no robots fit on the floor")
    for step in range(STEPS):
        if step % 15 == 14:
            with contextlib.suppress(WarehouseError):  # contacts, or goals without a path
                _disturb(simulator, rng)
        simulator.step(_actions(simulator, rng))
        assert np.isfinite(simulator.observation).all()
        points, side = simulator.state.pose[..., :2], simulator.grid.cell_size * np.array(simulator.grid.shape[::-1])
        assert errs(simulator.config) or ((points >= 0) & (points <= side.astype(np.float32))).all()


def _actions(simulator: Simulator, rng: np.random.Generator) -> NDArray[Any]:
    """Return actions at the limits, along the route, or in between."""
    shape, kind = (simulator.num_worlds, simulator.num_agents), rng.integers(4)
    config = simulator.config
    if config.action_type == "discrete":
        count = len(config.speed_levels) * len(config.lateral_offsets)
        if kind == 0:
            return rng.normal(size=(*shape, count)).astype(np.float32)
        return rng.integers(count, size=shape) if kind == 1 else np.tile(simulator.cruise_action, shape)
    if kind == 3 and config.action_type != "raw":
        return np.tile(simulator.cruise_action, (*shape, 1))
    limits = rng.choice([-1.0, 1.0], (*shape, 2))
    return limits if kind else rng.uniform(-1.0, 1.0, (*shape, 2))


def _disturb(simulator: Simulator, rng: np.random.Generator) -> None:
    """Put robots or people anywhere (also on the rim or on each other), reset, or break a robot down."""
    shape, side = (simulator.num_worlds, simulator.num_agents), np.array(simulator.grid.shape[::-1])
    points = rng.uniform(-0.2, 1.2, (*shape, 2)).clip(0, 1) * side * simulator.grid.cell_size
    pose = np.concatenate([points, rng.choice([0.0, 0.5, 1.0, 1e20], (*shape, 1)) * math.pi], axis=-1)
    limits = np.array([(robot.min_speed, robot.max_speed) for robot in simulator.config.robots])
    kind = rng.integers(5)
    if kind <= 1:
        simulator.put(pose, np.where(rng.random(shape) < 0.5, *limits.T))
    elif kind == 2:
        cells = rng.permutation(simulator.grid.free_cells)
        persons = simulator.people.persons[0]
        persons["x"], persons["y"] = simulator.grid.centre(cells[: len(persons)]).T
        simulator.break_down(1, int(rng.integers(simulator.num_agents)))
    elif kind == 3:
        free = simulator.grid.centre(rng.permutation(simulator.grid.free_cells)[: 2 * shape[1]])
        poses = np.column_stack([free, rng.uniform(-1e3, 1e3, len(free))])
        simulator.reset(None, [Assignment(poses[: shape[1]], poses[shape[1] :])] * shape[0])
    else:
        simulator.reset_world(0, int(rng.integers(9)))


def check_negative_indices() -> None:
    """Make negative indices out of range in kernels; call this before any kernel compiles."""

    def unchanged(context: Any, builder: Any, kind: Any, index: Any, size: Any) -> Any:
        return context.cast(builder, index, kind, numba.types.intp)

    assert callable(arrayobj.fix_integer_index)
    arrayobj.fix_integer_index = unchanged


if numba.config.BOUNDSCHECK:  # type: ignore[attr-defined]
    check_negative_indices()


def test_episodes_cover_every_option() -> None:
    names = {field.name for field in dataclasses.fields(EnvConfig)}
    drawn = [options_of(number) for number in range(100)]
    assert set(CHOICES) == names
    assert {name for name in names if len({repr(getattr(config, name)) for config, _ in drawn}) > 1} == names
    floors = [grid for _, grid in drawn if grid is not None]
    assert any(grid.shape == (3, 3) for grid in floors)
    assert any(len(grid.discs) for grid in floors)
    assert any(grid.speed is not None for grid in floors)


@pytest.mark.parametrize("index", [-1, 3])
def test_out_of_range_and_negative_indices_are_errors(index: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arrayobj, "fix_integer_index", arrayobj.fix_integer_index)  # restored after the test
    check_negative_indices()
    entry = numba.njit(lambda array, k: array[k], boundscheck=True)
    assert entry(np.arange(3), 2) == 2
    with pytest.raises(IndexError):
        entry(np.arange(3), index)
