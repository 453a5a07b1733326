"""Robots of other kinds: who is judged by whose body and limits; bodies that arrive and touch no shelf."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.simulation.physics.test_no_overlap import DEEP
from tests.simulation.reference import bodies, separation, shelves
from tests.simulation.safe_stops import checked as checked  # a fixture
from tests.simulation.worlds import plain_python, room, stage
from warehouse_env.config import ArrivalMode, EnvConfig, FleetPart, RobotSpec, SensorSpec
from warehouse_env.errors import ConfigError
from warehouse_env.maps.generators import blocks
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import OWNER, field_of
from warehouse_env.traffic_spec import TrafficSpec, UncertaintySpec

pytestmark = pytest.mark.usefixtures("checked")  # all robots can stop after each step
LONG = RobotSpec(
    length=1.4, width=0.8, wheelbase=0.9, front_overhang=0.25, max_speed=0.8, min_speed=-0.3, max_acceleration=0.6,
    max_steering=0.9, max_steering_rate=1.0,
)  # fmt: skip
SMALL = RobotSpec(length=0.5, width=0.4, wheelbase=0.3, front_overhang=0.4, max_speed=2.0, max_acceleration=2.0)
# what of the world's record is a robot's own, of which a fleet has others
OWN = (
    "half_length", "half_width", "offset", "radius", "wheelbase", "min_speed", "max_speed", "max_acceleration",
    "max_steer", "max_steer_rate", "stride", "blur", "swing", "far",
)  # fmt: skip
OPTIONS: dict[str, dict[str, Any]] = {
    "all rules": {"traffic": "rules", "people": 2, "arrival": "pose"},
    "errors": {"action_type": "continuous", "uncertainty": UncertaintySpec(pose_error=0.01, heading_error=0.01)},
}


def parts(*kinds: RobotSpec, count: int = 3) -> tuple[FleetPart, ...]:
    return tuple(FleetPart(count, kind) for kind in kinds)


def outcome(simulator: Simulator, steps: int = 16) -> list[bytes]:
    """All that there is of a simulator after a drive that mostly cruises."""
    simulator.reset(seed=4)
    shape, rng = (1, simulator.num_agents), np.random.default_rng(0)
    for k in range(steps):
        if simulator.config.action_type != "discrete":
            simulator.step(rng.uniform(-0.5, 1.0, (*shape, 2)))
        else:
            simulator.step(np.full(shape, 3) if k % 4 else rng.integers(0, 4, shape))
    robots, jams = simulator.robots, simulator.jams()
    fields = [field_of(robots, name).tobytes() for name in OWNER]
    return [*fields, *(one.tobytes() for one in (simulator.observation, simulator.reward, *jams))]


def differ(name: str) -> list[str]:
    """What is not as it must be with some options, of a fleet of three kinds and of one whose parts are alike."""
    sensor = SensorSpec(rays=3, neighbours=2, predictions=True)
    config = EnvConfig(
        layout="open", num_agents=6, planner="astar", lateral_offsets=(0.0,), sensor=sensor, **OPTIONS[name]
    )
    mixed = config.replace(fleet=parts(LONG, SMALL, count=2))
    spoiled = Simulator(mixed)
    for limit in OWN:
        spoiled._params[limit] = spoiled._true_params[limit] = np.nan
    pairs = {
        "spoiled": (spoiled, Simulator(mixed)),  # the world's record is asked for what is one's own
        "alike": (Simulator(config.replace(fleet=parts(RobotSpec()))), Simulator(config)),
    }
    return [name for name, (one, other) in pairs.items() if outcome(one) != outcome(other)]


@pytest.mark.parametrize("name", ["all rules", pytest.param("errors", marks=pytest.mark.nightly)])
def test_parts_that_are_as_all_others_change_no_bit_and_nobody_is_judged_by_the_worlds_record(name: str) -> None:
    """Without the compiler, which would take minutes for so many options."""
    program = f"from tests.simulation.test_fleet import differ; print('differences', *differ({name!r}))"
    assert plain_python(program) == ["differences"]


def corners(simulator: Simulator) -> NDArray[np.float64]:
    """Corners [N, 4, 2] of the bodies, in double precision."""
    sizes = np.array([(one.length, one.width, one.front_overhang) for one in simulator.config.robots]).T
    return bodies(*simulator.state.pose[0].astype(np.float64).T, *sizes)


@pytest.mark.parametrize("guarded", [False, True])
def test_bodies_of_several_sizes_never_overlap(guarded: bool) -> None:
    """Nine of three kinds in a small room, by random full commands; the field has each stop clear at every step."""
    rng, grid, hits = np.random.default_rng(7), room(7, 7), 0
    walls, (first, second) = shelves(grid.occupied), np.triu_indices(9, 1)
    for _ in range(3):
        poses = [(1.6 + 2.1 * (k % 3), 1.2 + 2.1 * (k // 3), rng.uniform(-0.3, 0.3)) for k in range(9)]
        order = rng.permutation(9)
        simulator = stage(
            grid, *(poses[k] for k in order), fleet=parts(LONG, SMALL), traffic=TrafficSpec(shield=guarded)
        )
        commands = rng.choice([-1.0, 1.0], (1, 9, 2))
        for _ in range(150):
            fresh = rng.choice([-1.0, 0.0, 1.0], (1, 9, 2), p=[0.3, 0.1, 0.6])
            commands = np.where(rng.random((1, 9, 1)) < 0.15, fresh, commands)
            simulator.step(commands)
            polygons = corners(simulator)
            assert separation(polygons[first], polygons[second]).min() > (0.0 if guarded else -DEEP)
            assert separation(polygons[:, None], walls[None]).min() > -DEEP
        hits += int(simulator.robots["totals"]["hits_robot"].sum())
        assert simulator.robots["totals"]["distance"].min() > 0.1
    assert (hits == 0) == guarded


@pytest.mark.parametrize(
    ("action_type", "action", "wanted"),
    [("discrete", 15, (1.5, 0.8)), ("discrete", 0, (-0.4, -0.3)), ("continuous", (1.0, 0.0), (1.5, 0.8)),
     ("continuous", (-1.0, 0.0), (-0.5, -0.3)), ("raw", (1.0, 1.0), (1.0, 0.6))],
)  # fmt: skip
def test_commands_are_cut_off_at_the_own_limits(action_type: Any, action: Any, wanted: tuple[float, float]) -> None:
    config = EnvConfig(
        layout="open", num_agents=2, planner="astar", action_type=action_type, fleet=parts(LONG, count=1)
    )
    simulator = Simulator(config)
    simulator.actions.decode(np.array([[action, action]]), simulator._commands[0], simulator._choices)
    np.testing.assert_allclose(simulator._commands[0, 0, :, 0], wanted, rtol=1e-6)


def test_configs_of_fleets() -> None:
    config = EnvConfig(fleet=parts(LONG, SMALL))
    assert EnvConfig.from_dict(config.to_dict()) == config
    assert config.kind_of == (0, 0, 1, 1, 1, 2, 2, 2)
    assert config.bodies == (RobotSpec(), LONG, SMALL)
    widest = config.widest_body
    assert (widest.width, widest.front_overhang, widest.rear_reach) == pytest.approx((0.8, 0.4, 1.15))
    assert EnvConfig(num_agents=3, fleet=parts(LONG)).bodies == (LONG,)
    with pytest.raises(ConfigError, match="at most 5 robots"):
        config.replace(num_agents=5)
    with pytest.raises(ConfigError, match="unknown RobotSpec parameter 'lenth'"):
        EnvConfig.from_dict({"fleet": [{"count": 1, "robot": {"lenth": 1}}]})


BODIES = {
    "large": RobotSpec(length=3.0, width=2.0, wheelbase=2.0, front_overhang=0.5),
    "large front": RobotSpec(length=3.0, width=2.0, wheelbase=2.0, front_overhang=2.5, max_steering=math.radians(50.0)),
    "small": RobotSpec(length=0.5, width=0.4, wheelbase=0.34, front_overhang=0.08),
    "small front": RobotSpec(length=0.5, width=0.4, wheelbase=0.34, front_overhang=0.42),
}


def floor_for(name: str) -> GridMap:
    """Shelves with aisles of two lengths of the body, in cells of a third of a metre or a metre."""
    wide = blocks(
        36, 36, block_rows=2, block_columns=8, aisle=6, cross=7, zone_rows=2, zone_columns=2, rim_rows=7, rim_columns=7
    )
    return wide if name.startswith("large") else dataclasses.replace(wide, cell_size=0.2)


@pytest.mark.nightly
@pytest.mark.parametrize("arrival", ["pass", "stop", "pose"])
@pytest.mark.parametrize("name", BODIES)
def test_bodies_drive_and_arrive(name: str, arrival: ArrivalMode) -> None:
    config = EnvConfig(
        num_agents=1, planner="astar_turns", arrival=arrival, robot=BODIES[name], max_steps=10**6,
        arrival_radius=0.5 if name.startswith("large") else 0.3,
    )  # fmt: skip
    simulator = Simulator(config, 8, grid=floor_for(name))
    simulator.reset(31600007)
    cruise = np.full((8, 1), simulator.cruise_action)
    for _ in range(1000):
        simulator.step(cruise)
    robots = simulator.robots
    assert robots["totals"]["hits_shelf"].sum() == 0
    assert robots["totals"]["goals"].min() >= 1
    assert robots["totals"]["goals"].mean() >= 2
