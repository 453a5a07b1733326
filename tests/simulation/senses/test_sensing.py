"""What a robot perceives: lidar, neighbours by brute force, ego, route by hand; each slice where the layout says."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from agents import make_policy
from tests.simulation.reference import OFFSET, ray_to_polygon, rectangle, shelves
from tests.simulation.worlds import drawn, lay, put, room, stage
from warehouse_env.config import EnvConfig, SensorSpec
from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.observation import observation_layout
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import OWNER, field_of
from warehouse_env.traffic_spec import TrafficSpec
from warehouse_env.work import BatterySpec, ServiceSpec

MAP = ["..........", ".##...#...", "......#...", ".#......#.", ".....##...", "..#.......", "....#...#."]


def look(simulator: Simulator, name: str, robot: int = 0) -> NDArray[np.float64]:
    """A named slice of a robot's observation, made anew."""
    simulator._observe()
    return simulator.observation[0, robot, simulator.layout.slices[name]].astype(np.float64)


def lidar(simulator: Simulator, robot: int = 0) -> NDArray[np.float64]:
    """Metres of each ray."""
    return 1.0 / look(simulator, "lidar", robot) - 1.0


def centre(simulator: Simulator, robot: int) -> tuple[float, float, float]:
    """The body's centre [m] and heading, in float64."""
    x, y, heading = (float(v) for v in simulator.state.pose[0, robot])
    return x - OFFSET * math.cos(heading), y - OFFSET * math.sin(heading), heading


def expected_lidar(simulator: Simulator, robot: int, grow: float) -> NDArray[np.float64]:
    """Metres of each ray, by crossing all edges of all obstacles grown by `grow` [m]."""
    cell = simulator.grid.cell_size
    obstacles = list(shelves(simulator.grid.occupied, cell, grow))
    others = (other for other in range(simulator.num_agents) if other != robot)
    obstacles += [rectangle(*centre(simulator, other), 0.45 + grow, 0.3 + grow) for other in others]
    cx, cy, heading = centre(simulator, robot)
    sensor = simulator.config.sensor
    reach = sensor.lidar_range
    near = [o for o in obstacles if np.hypot(*(np.clip((cx, cy), o.min(0), o.max(0)) - (cx, cy))) <= reach]
    angles = heading + 2 * math.pi * np.arange(sensor.rays) / sensor.rays
    hits = [[ray_to_polygon(np.array([cx, cy]), a, o) for o in near] or [math.inf] for a in angles.tolist()]
    return np.minimum(np.min(hits, axis=1), reach)


def assert_lidar(simulator: Simulator, robot: int) -> None:
    """Between the answers for obstacles a little larger and a little smaller, as a grazing ray may go either way."""
    got = lidar(simulator, robot)
    assert (got >= expected_lidar(simulator, robot, 5e-5) - 1e-4).all()
    assert (got <= expected_lidar(simulator, robot, -5e-5) + 1e-4).all()
    assert got.max() <= simulator.config.sensor.lidar_range + 1e-4


@pytest.mark.parametrize(
    "pose", [(3.3, 2.0, 0.0), (3.0, 2.0 + 0.3, math.pi / 2), (3.3, 2.0, 1e-9), (2.7, 2.0, math.pi)]
)
def test_a_centre_on_a_line_between_cells(pose: Any) -> None:
    # x = 3 or y = 2 in float32: rays along the line have 0 * inf in their traversal.
    simulator = stage(room(5, 9), pose)
    assert np.isfinite(look(simulator, "lidar")).all()
    assert_lidar(simulator, 0)


def test_no_ray_slips_between_shelves_that_touch_at_a_corner() -> None:
    # Shelves north and east of the cell x, y = 2..3; their common corner (3, 3) is aimed at by ray 0.
    simulator = stage(drawn(["......", "......", "..#...", "...#..", "......", "......"]), (2.5, 2.5, 0.0))
    rng = np.random.default_rng(0)
    for _ in range(200):
        cx, cy = rng.uniform(2.1, 2.9, 2)
        heading = math.atan2(3.0 - cy, 3.0 - cx)
        put(simulator, 0, (cx + OFFSET * math.cos(heading), cy + OFFSET * math.sin(heading), heading))
        assert lidar(simulator)[0] <= math.hypot(3.0 - cx, 3.0 - cy) + 1e-4


def scattered(seed: int, robots: int, grid: GridMap, **changes: Any) -> Simulator:
    """Robots anywhere, even in each other: sensing does not care."""
    simulator = stage(grid, *[(1.0, 1.0, 0.0)] * robots, **changes)
    rng = np.random.default_rng(seed)
    free = grid.centre(grid.free_cells[rng.integers(0, len(grid.free_cells), robots)])
    for i in range(robots):
        heading = rng.uniform(-math.pi, math.pi)
        x, y = free[i] + rng.uniform(-0.45, 0.45, 2) * grid.cell_size
        put(simulator, i, (x + OFFSET * math.cos(heading), y + OFFSET * math.sin(heading), heading, rng.uniform(-1, 1)))
    return simulator


@settings(max_examples=40)
@given(st.integers(0, 10**6), st.sampled_from([0.1, 0.25, 0.45]), st.sampled_from([0.6, 1.0, 1.7]))
def test_lidar_agrees_with_brute_force_among_robots(seed: int, share: float, cell: float) -> None:
    """On floors with shelves at random: no edge that counts is left out."""
    occupied: NDArray[np.bool_] = np.random.default_rng(seed).random((9, 12)) < share
    occupied[0], occupied[:, 0] = False, False  # so that there is a floor to drive on
    simulator = scattered(seed, 6, GridMap(occupied, cell_size=cell), sensor=SensorSpec(rays=16))
    assert_lidar(simulator, seed % 6)


@settings(max_examples=20)
@given(st.integers(0, 10**6), st.integers(1, 8))
def test_neighbours_agree_with_a_plain_search(seed: int, slots: int) -> None:
    simulator = scattered(seed, 8, drawn(MAP), sensor=SensorSpec(neighbours=slots, lidar_range=3.5))
    cx, cy, heading = centre(simulator, 0)
    found = []
    for j in range(1, 8):
        ox, oy, other = centre(simulator, j)
        distance = math.hypot(ox - cx, oy - cy)
        if distance < 3.5:
            turn = complex(math.cos(heading), -math.sin(heading))  # into the own frame
            at = complex(ox - cx, oy - cy) * turn
            facing = complex(math.cos(other), math.sin(other)) * turn
            velocity = float(simulator.state.speed[0, j]) * facing - float(simulator.state.speed[0, 0])
            row = (at.real / 3.5, at.imag / 3.5, facing.real, facing.imag, velocity.real / 1.5, velocity.imag / 1.5, 1)
            found.append((distance, row))
    expected = np.zeros((slots, 7))
    for k, (_, row) in enumerate(sorted(found)[:slots]):
        expected[k] = row
    np.testing.assert_allclose(look(simulator, "neighbours").reshape(slots, 7), expected, atol=2e-6)


def test_ego_and_route_by_hand() -> None:
    # Route due east along y = 4 from x = 2 to x = 8, points 0.5 m apart; the robot at (3.2, 4.25) heads 30 degrees
    # north of it and has just got its command.
    simulator = stage(room(9, 11), (3.2, 4.25, math.pi / 6, 0.6, -0.3))
    lay(simulator, (2.0, 4.0), (8.0, 4.0))
    r = simulator.robots[0, 0]
    r["on_route"]["position"] = 1.0
    r["clocks"]["contact_time"], r["clocks"]["waiting_time"], r["commanded"]["follow_steer"] = 2.5, 30.0, 0.2
    # locate is part of a step: stand still for one, with the events above put back afterwards
    r["motion"]["speed"] = 0.0
    simulator.step(np.zeros((1, 1, 2), dtype=np.float32))
    r["motion"]["speed"], r["clocks"]["contact_time"], r["clocks"]["waiting_time"] = 0.6, 2.5, 30.0
    most = math.radians(60)
    expected = [0.6 / 1.5, -0.3 / most, 0.2 / most, -1 / 6, 0.25, 4.8 / 20, 0.5, 1.0]
    assert look(simulator, "ego") == pytest.approx(expected, abs=1e-6)
    points = look(simulator, "route").reshape(-1, 2) * 5.0
    c, s = math.cos(math.pi / 6), math.sin(math.pi / 6)
    for ahead, (x, y) in zip((1.0, 2.0, 3.0, 4.0, 5.0), points, strict=True):
        dx, dy = min(3.2 + ahead, 8.0) - 3.2, -0.25
        assert (x, y) == pytest.approx((dx * c + dy * s, dy * c - dx * s), abs=2e-6)


def test_slices_cover_the_observation_once() -> None:
    simulator = stage(room(5, 5), (2.5, 2.5, 0.0), sensor=SensorSpec(rays=7, neighbours=3, route_points=4))
    slices = sorted(simulator.layout.slices.values(), key=lambda s: s.start)
    assert [s.start for s in slices] == [0, 7, 15, 23]
    assert slices[-1].stop == simulator.layout.size == 7 + 8 + 8 + 21
    assert simulator.observation.shape == (1, 1, 44)
    assert simulator.observation_space.shape == (44,)


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
        "orca": ("neighbours", "route_points"),
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
