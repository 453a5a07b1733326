"""Every rule and error, switched on: the same bits alone and among others, in a copy, and without the compiler."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from agents import Actor, make_policy
from tests import long
from tests.simulation.test_determinism import MAP, bits
from tests.simulation.worlds import drawn, plain_python
from warehouse_env.config import EnvConfig, FleetPart, RobotSpec, SensorSpec
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.traffic import live
from warehouse_env.traffic_spec import TRAFFIC, TrafficSpec, UncertaintySpec
from warehouse_env.work import BatterySpec, OrderSpec, ServiceSpec

FIELD: dict[str, Any] = {"traffic": TrafficSpec(shield=True)}
RIGHT: dict[str, Any] = {"traffic": "rules"}
ERRORS: dict[str, Any] = {"pose_error": 0.02, "heading_error": 0.02, "actuation_error": 0.05}
STACKS: dict[str, dict[str, Any]] = {
    "field, raw": {**FIELD, "action_type": "raw"},
    "right of way around rings": {"traffic": replace(TRAFFIC["rules"], right_of_way_after=2.0)},
    "ants' routes": {**RIGHT, "planner": "pf_aco:ants=6,iterations=3"},
    "searched routes": {**RIGHT, "planner": "astar_turns"},
    "people": {**RIGHT, "people": 3},
    "silence": {**RIGHT, "uncertainty": UncertaintySpec(loss=0.4), "sensor": SensorSpec(predictions=True)},
    "errors": {**FIELD, "uncertainty": UncertaintySpec(latency=0.3, **ERRORS)},
    "poses": {**RIGHT, "arrival": "pose"},
    "kinds": {**RIGHT, "fleet": (FleetPart(1, RobotSpec(length=0.7, wheelbase=0.4, max_speed=1.0)),)},
    "orders": {
        "arrival": "stop", "service": ServiceSpec(0.3, 0.2, variation=0.5), "battery": BatterySpec(chargers=1),
        "orders": OrderSpec(per_hour=600.0),
    },
    "one shot": {**RIGHT, "tasks": "one_shot"},
}  # fmt: skip
PLAIN = ("field, raw", "right of way around rings", "ants' routes", "people", "silence", "errors")
LONG = dict.fromkeys(("kinds", "errors", "poses"), pytest.mark.nightly)  # they compile kernels of their own


def make(name: str, worlds: int, robots: int) -> Simulator:
    """A simulator of a floor with shelves."""
    settings = {"planner": "astar", "action_repeat": 2, "num_agents": robots} | STACKS[name]
    grid = GridMap(drawn(MAP * 2).occupied, name="drawn")
    with pytest.MonkeyPatch.context() as patch:
        if name.endswith(" routes"):
            patch.setattr(live, "EVERY", 0.4)
            patch.setattr(live, "STOOD_FOR", 0.2)
        return Simulator(EnvConfig(**settings), worlds, grid=grid)


def drive(simulator: Simulator, first: int, steps: int) -> list[str]:
    """A digest of each world's history, given what worlds of a batch from `first` on are.

    Where right of way steps in around rings, all are said to have stood.
    """
    rng = np.random.default_rng(7)
    worlds, robots = simulator.num_worlds, simulator.num_agents
    digests = [hashlib.blake2b() for _ in range(worlds)]
    for _ in range(steps):
        given: NDArray[Any] = rng.normal(size=(4, robots, 20)).astype(np.float32)
        given[..., 15:] += 2.0
        if simulator.config.action_type != "discrete":
            given = np.clip(given[..., 14:16], -0.5, 1.0)
        if simulator.config.traffic_spec.right_of_way_after:
            simulator.robots["clocks"]["standing_time"] = simulator.robots["clocks"]["waiting_time"] = 3.0
        simulator.step(given[first : first + worlds])
        for world, (digest, now) in enumerate(zip(digests, bits(simulator), strict=True)):
            digest.update(now + simulator.people.persons[world].tobytes())
    return [digest.hexdigest() for digest in digests]


@pytest.mark.parametrize("name", [pytest.param(name, marks=LONG.get(name, ())) for name in STACKS])
def test_a_world_is_the_same_alone_and_a_copy_goes_on_alike(name: str) -> None:
    three, alone = make(name, 3, 6), make(name, 1, 6)
    three.reset([7, 8, 9])
    alone.reset(8)
    together = drive(three, 0, 100)
    assert drive(alone, 1, 100) == together[1:2]  # one seed of a list is that of a single world
    assert len(set(together)) == 3
    assert three.robots["totals"]["distance"].any(axis=1).all()
    copy = pickle.loads(pickle.dumps(alone))
    assert drive(copy, 0, 30) == drive(alone, 0, 30)
    assert not np.shares_memory(copy.people.persons, alone.people.persons)


def digests(names: Sequence[str]) -> list[str]:
    """Digests of short histories of some of STACKS."""
    found = []
    for name in names:
        simulator = make(name, 1, 3)
        simulator.reset([4])
        found += drive(simulator, 0, 5)
    return found


@pytest.mark.parametrize("names", [("people",), pytest.param(PLAIN, marks=pytest.mark.nightly)], ids=("one", "all"))
def test_plain_python_gives_the_same_bits(names: tuple[str, ...]) -> None:
    found = plain_python(f"from tests.simulation.test_all_on import digests; print(*digests({names}))")
    assert found == digests(names)


@pytest.mark.nightly
def test_two_drives_one_of_them_pickled_half_way_come_to_the_same(tmp_path: Path) -> None:
    env = long.config(8, 2, 60)
    long.drive(env, 1, tmp_path / "whole", "whole")
    whole, half = pickle.loads((tmp_path / "whole").read_bytes()), long.Drive(env, 1)
    act = Actor(make_policy(long.POLICY, env), env)
    for k in range(60):
        half = pickle.loads(pickle.dumps(half)) if k == 30 else half
        half.step(act)
    assert whole.digest == half.digest
    assert [part[0] for part in whole.parts] == [str(done) for done in range(6, 61, 6)]
    assert not whole.jammed
