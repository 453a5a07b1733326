"""Kernels find every slice that they write where the layout says that it is."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from agents import make_policy
from warehouse_env import Simulator
from warehouse_env.config import EnvConfig, SensorSpec
from warehouse_env.errors import ConfigError
from warehouse_env.observation import observation_layout
from warehouse_env.simulation.state import OWNER, field_of
from warehouse_env.traffic_spec import TrafficSpec
from warehouse_env.work import BatterySpec, ServiceSpec

ALL = EnvConfig(sensor=SensorSpec(predictions=True), traffic="shield", arrival="stop", battery=BatterySpec())
RNG = np.random.default_rng(0)
BY_OTHERS = {"lidar", "needs"}  # begins at 0; is written by shifts


@pytest.mark.parametrize("config", [EnvConfig(), EnvConfig(traffic="shield"), EnvConfig(arrival="pose"), ALL])
def test_kernels_are_told_where_slices_start(config: EnvConfig) -> None:
    layout = observation_layout(config)
    told = {name: start for name, start in layout.starts._asdict().items() if start is not None}
    assert told == {name: part.start for name, part in layout.slices.items() if name not in BY_OTHERS}


def test_slices_follow_each_other() -> None:
    layout, end = observation_layout(ALL), 0
    for part in layout.slices.values():
        assert part.start == end
        end = part.stop
    assert end == layout.size


SEEN = {"rays": "lidar", "neighbours": "neighbours", "route_points": "route"}  # options, and their slices


@pytest.mark.parametrize("without", [*((name,) for name in SEEN), tuple(SEEN)])
def test_a_robot_may_see_less_and_what_is_left_stays_the_same(without: tuple[str, ...]) -> None:
    every = EnvConfig(layout="open", num_agents=12, planner="astar", traffic="shield", people=2)
    some = every.replace(sensor=dataclasses.replace(every.sensor, **dict.fromkeys(without, 0)))
    seeing, blind = Simulator(every), Simulator(some)
    everything = seeing.layout.slices
    assert set(everything) - set(blind.layout.slices) == {SEEN[name] for name in without}
    seeing.reset(3)
    blind.reset(3)
    for _ in range(20):
        for name, part in blind.layout.slices.items():
            np.testing.assert_array_equal(
                blind.observation[..., part], seeing.observation[..., seeing.layout.slices[name]]
            )
        assert seeing.observation[..., everything["neighbours"]].any()
        for one in (seeing, blind):
            one.step(np.full((1, 12), one.cruise_action))


@pytest.mark.parametrize("shield", [False, pytest.param(True, marks=pytest.mark.nightly)])
def test_goals_and_fields_are_seen_alike_with_and_without_needs(shield: bool) -> None:
    config = EnvConfig("open", 3, planner="astar", arrival="stop", traffic=TrafficSpec(shield=shield))
    without, served = Simulator(config), Simulator(config.replace(service=ServiceSpec(1.0, 1.0), battery=BatterySpec()))
    without.reset(3)
    served.reset(3)
    served.routes[...] = without.routes
    for name in OWNER:
        field_of(served.robots, name)[...] = field_of(without.robots, name)
    served._observe()
    without._observe()
    assert np.isfinite(served.observation).all()
    for name, own in without.layout.slices.items():
        part = served.layout.slices[name]
        np.testing.assert_array_equal(served.observation[..., part], without.observation[..., own], name)


def test_a_rule_names_the_slice_that_it_needs() -> None:
    needs = {
        "follow": (), "greedy": (), "brake": ("neighbours",), "rules": ("rays", "neighbours"),
        "orca": ("neighbours", "route_points"), "apf": ("rays", "neighbours", "route_points"),
    }  # fmt: skip
    for policy, name in itertools.product(needs, SEEN):
        config = EnvConfig(sensor=SensorSpec(**{name: 0}))
        if name in needs[policy]:
            with pytest.raises(ConfigError, match=f"give it the slice '{SEEN[name]}'"):
                make_policy(policy, config)
        else:
            make_policy(policy, config).act(np.zeros((1, 8, observation_layout(config).size), np.float32), RNG)
    with pytest.raises(ConfigError, match="predictions=True must be False without neighbours"):
        SensorSpec(neighbours=0, predictions=True)
