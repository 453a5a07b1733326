"""A device's worlds: the bits of the Simulator, what is refused, and kernels that a GPU computes alike."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from warehouse_env import ConfigError, EnvConfig, RewardWeights, SensorSpec, Simulator, TrafficSpec, UncertaintySpec
from warehouse_env.config import FleetPart, RobotSpec
from warehouse_env.errors import ActionError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.simulation.device import drivers, memory
from warehouse_env.simulation.device.simulator import DeviceSimulator
from warehouse_env.simulation.state import OWNER, field_of
from warehouse_env.simulation.tasks.assignment import Assignment
from warehouse_env.simulation.tasks.dispatch import ROUTE_BLOCK
from warehouse_env.simulation.traffic.live import SMALL
from warehouse_env.traffic_spec import read_traffic


def lacking() -> str:
    """What is missing to use a GPU."""
    try:
        memory.find_card()
    except ConfigError as error:
        return str(error)
    return ""


ON_CARD = pytest.mark.skipif(lacking() != "", reason=lacking())
DEVICES = ["cpu", pytest.param("cuda", marks=ON_CARD)]
WORLDS, ROBOTS = 5, 12
SHIELD, RULES = TrafficSpec(shield=True), TrafficSpec(shield=True, right_of_way=True)
SLOW = FleetPart(5, RobotSpec(length=0.7, wheelbase=0.4, max_speed=1.0))
SETS: dict[str, dict[str, Any]] = {
    "nothing": {},
    "shield": {"traffic": SHIELD},
    "raw": {"action_type": "raw"},
    "continuous": {"action_type": "continuous", "layout": "narrow"},
    "predictions": {"sensor": SensorSpec(predictions=True)},
    "collisions end": {"terminate_on_collision": True},
    "one shot": {"tasks": "one_shot"},
    "errors and losses": {
        "traffic": SHIELD,
        "uncertainty": UncertaintySpec(
            pose_error=0.03, heading_error=0.02, actuation_error=0.1, latency=0.3, loss=0.1, burst=1.0
        ),
    },
    "right of way": {"traffic": RULES, "layout": "narrow"},
    "poses": {"arrival": "pose", "layout": "open"},
    "single lanes": {"layout": "single_lane"},
    "quick searches": {"quick_searches": True, "layout": "narrow"},
    "mixed fleet": {"traffic": RULES, "fleet": (SLOW,)},
    "live routes": {"traffic": "routes", "layout": "narrow"},
    "live routes where they are barred": {"traffic": TrafficSpec(routes="barred"), "layout": "single_lane"},
    "mixed fleet, continuous": {"action_type": "continuous", "traffic": SHIELD, "fleet": (SLOW,)},  # one set of kernels
}


def config(**changes: Any) -> EnvConfig:
    return EnvConfig(**{"num_agents": ROBOTS, "planner": "astar_turns", "max_steps": 150, **changes})


def commands(sim: Simulator, rng: np.random.Generator) -> Any:
    """Full speed along the routes, with a fifth of random commands, so that robots meet, stray and search."""
    shape = (sim.num_worlds, sim.num_agents)
    if sim.config.traffic_spec.right_of_way and sim.steps[0] % 2:  # preferences
        return rng.normal(size=(*shape, len(sim.actions.table))).astype(np.float32)
    if sim.config.action_type == "discrete":
        given = np.full(shape, sim.cruise_action)
        return np.where(rng.random(shape) < 0.2, rng.integers(0, sim.action_space.n, shape), given)
    return rng.uniform(-1.3, 1.3, (*shape, 2)).astype(np.float32) + np.float32([0.3, 0.0])


def alike(what: str, here: Any, there: Any) -> None:
    """Fail with the first place where two arrays differ, as [world, robot, ...]."""
    if here.tobytes() != there.tobytes():
        places = np.argwhere(here != there)
        first = tuple(places[0].tolist())
        pytest.fail(
            f"{what}{list(first)}: {here[first]!r} by the Simulator, {there[first]!r} on the device; "
            f"{len(places)} of {here.size} differ"
        )


def compare(here: Simulator, there: DeviceSimulator, steps: int, seconds: float = math.inf) -> int:
    """Drive both, one world of which starts anew after 100 steps; compare all that they say, and return arrivals.

    seconds: of steps, after which none follows.
    """
    alike("the reset's observation", here.reset(7), there.reset(7).cpu().numpy())
    rng, arrivals, last = np.random.default_rng(1), 0, here.num_worlds - 1
    deadline = math.inf
    for step in range(steps):
        given = commands(here, rng)
        here.step(given)
        there.step(torch.from_numpy(given).to(there.device))
        arrivals += len(here.arrivals)
        assert here.arrivals == there.arrivals, f"step {step}"
        alike(f"step {step}: truncated", here.truncated, there.truncated)
        alike(f"step {step}: terminated", here.terminated, there.terminated.cpu().numpy())
        alike(f"step {step}: observation", here.observation, there.observation.cpu().numpy())
        alike(f"step {step}: reward", here.reward, there.reward.cpu().numpy())
        if step == 50:
            here.reward_weights = there.reward_weights = RewardWeights(progress=5.0)
        if here.steps[last] == 100:
            here.reset_worlds([last])
            there.reset_worlds([last])
        deadline = min(deadline, time.monotonic() + seconds)  # from the first step on, which may compile
        if time.monotonic() > deadline:
            break
    print(f"the same bits in {step + 1} steps of {here.num_worlds} x {here.num_agents} robots")
    robots = there.download(list(range(here.num_worlds)))
    for name in OWNER:
        alike(name, field_of(here.robots, name), field_of(robots, name))
    assert repr(there.metrics([0, last])) == repr([here.episode_metrics(world) for world in (0, last)])
    return arrivals


@pytest.mark.parametrize("changes", SETS.values(), ids=SETS)
def test_a_device_has_the_bits_of_the_simulator(changes: dict[str, Any]) -> None:
    here, there = Simulator(config(**changes), WORLDS), DeviceSimulator(config(**changes), WORLDS, device="cpu")
    assert compare(here, there, 250) > 0 or "action_type" in changes


@ON_CARD
@pytest.mark.nightly
@pytest.mark.parametrize(("worlds", "robots"), [(128, 16), (32, 64), (1, 1024)])
@pytest.mark.parametrize("changes", SETS.values(), ids=SETS)
def test_a_gpu_has_the_bits_of_the_simulator(changes: dict[str, Any], worlds: int, robots: int) -> None:
    """For 1,000 steps, or as many as there is time for."""
    side = 260 if robots > 64 else 46
    grid, given = make_layout("blocks", rows=side, columns=side), config(**changes, num_agents=robots)
    if given.traffic_spec.routes and side > SMALL:
        pytest.skip("floors of this size have no live routes on a device")
    there = DeviceSimulator(given, worlds, device="cuda", grid=grid)
    compare(Simulator(given, worlds, grid=grid), there, 1000, seconds=30.0)


def test_live_routes_are_refused_on_a_floor_that_is_too_large() -> None:
    grid = make_layout("blocks", rows=SMALL + 1, columns=20)
    with pytest.raises(ConfigError, match=f"{SMALL} x {SMALL} cells, and map 'blocks' is larger"):
        DeviceSimulator(config(traffic="routes", num_agents=2), 1, device="cpu", grid=grid)


def test_all_routes_are_made_before_many_robots_begin(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("WAREHOUSE_CACHE_DIR", str(tmp_path))
    ends = {"picks": np.array([(0, 0), (3, 9)]), "stations": np.array([(5, 0), (5, 9)])}
    worlds = DeviceSimulator(config(num_agents=2), 2, device="cpu", grid=GridMap(np.zeros((6, 10), np.bool_), **ends))
    worlds.host.route_book.plan_all()
    for least, made in ((5, False), (4, True)):  # of 4 robots
        monkeypatch.setattr("warehouse_env.simulation.device.simulator.MANY", least)
        worlds.reset(0)
        assert (worlds.host.dispatcher.route_table.count == 4 * 3) == made


def test_a_reset_equals_the_simulators_on_a_floor_so_full_that_robots_begin_elsewhere() -> None:
    """Wider than the routes' first block, and so near that few robots fit on the pick faces and stations."""
    picks, stations = [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (0, 79)], [(8, 78), (8, 79), (7, 79)]
    grid = GridMap(np.zeros((9, 80), dtype=bool), cell_size=0.5, picks=np.array(picks), stations=np.array(stations))
    full = config(num_agents=8)
    here, there = Simulator(full, WORLDS, grid=grid), DeviceSimulator(full, WORLDS, device="cpu", grid=grid)
    for seed in (3, None):
        assert np.array_equal(here.reset(seed), there.reset(seed))
        robots = there.download(list(range(WORLDS)))
        assert all(field_of(here.robots, name).tobytes() == field_of(robots, name).tobytes() for name in OWNER)
    starts = {tuple(cell) for cell in grid.standing(here.state.pose[..., :2]).reshape(-1, 2).tolist()}
    assert starts - set(grid.endpoints[2])
    assert here.routes.shape[2] > ROUTE_BLOCK
    lane = GridMap(np.zeros((1, 9), dtype=bool))
    with pytest.raises(ConfigError, match="num_agents=8 do not fit"):
        DeviceSimulator(full, 1, device="cpu", grid=lane).reset(0)


def test_given_starts_and_goals_are_those_of_the_simulator() -> None:
    here, there = Simulator(config(), 2), DeviceSimulator(config(), 2, device="cpu")
    here.reset(1)
    given = [Assignment(here.state.pose[world], here.state.goal[world].astype(np.int64)) for world in range(2)]
    assert np.array_equal(here.reset(5, given), there.reset(5, given))
    cruise = np.full((2, ROBOTS), here.cruise_action)
    for _ in range(100):
        assert np.array_equal(here.step(cruise), there.step(torch.from_numpy(cruise)))
    points = [Assignment(here.state.pose[world], here.grid.centre(one.goal)) for world, one in enumerate(given)]
    with pytest.raises(ConfigError, match="goals on a device must be cells"):
        there.reset(None, points)


@pytest.mark.parametrize("name", ["shield", "errors and losses"])
def test_robots_are_put_as_by_the_simulator(name: str) -> None:
    here, there = Simulator(config(**SETS[name]), 3), DeviceSimulator(config(**SETS[name]), 3, device="cpu")
    here.reset(1)
    there.reset(1)
    pose = np.roll(here.state.pose, 1, axis=0)  # those of another world
    pose[0, 1] = pose[0, 0]
    free = here.put(pose, 0.2)
    assert not free[0]
    alike("whether each world is free", free, there.put(pose, 0.2))
    alike("observation", here.observation, there.observation.numpy())
    cruise = np.full((3, ROBOTS), here.cruise_action)
    alike("the next", here.step(cruise), there.step(torch.from_numpy(cruise)).numpy())


WIDE = ("routes", "live.routes", "live.cells")  # arrays that are as wide as a simulator ever needed


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("traffic", ["none:shield=true", "routes"])
def test_a_saved_state_continues_to_the_same_bits(device: str, traffic: str) -> None:
    given = config(traffic=read_traffic(traffic), layout="narrow")
    first, second = (DeviceSimulator(given, WORLDS, device=device) for _ in range(2))
    rng, like = np.random.default_rng(1), Simulator(given, WORLDS)
    pool = [torch.from_numpy(commands(like, rng)).to(first.device) for _ in range(200)]
    first.reset(7)
    second.reset(8)
    for actions in pool[:100]:
        first.step(actions)
    saved, ends = first.save_state(), []
    for simulator in (first, second):
        simulator.load_state(saved)
        for actions in pool[100:]:
            simulator.step(actions)
            ended = np.flatnonzero(simulator.truncated).tolist()
            simulator.reset_worlds(ended)
        state = {name: tensor.cpu().numpy() for name, tensor in simulator.save_state().items()}
        ends.append({name: array[:, :, :64] if name in WIDE else array for name, array in state.items()})
    assert simulator.steps.tolist() == [50] * WORLDS
    for name, array in ends[0].items():
        alike(name, array, ends[1][name])


def test_threads_share_the_worlds_and_have_scratch_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory.Memory, "threads", lambda self, most: 3)  # five worlds: 1, 2 and 2
    assert [drivers.part_of(thread, 3, WORLDS) for thread in range(3)] == [(0, 1), (1, 3), (3, 5)]
    test_a_device_has_the_bits_of_the_simulator(SETS["shield"])


@pytest.mark.parametrize("bad", [torch.zeros(WORLDS, ROBOTS), torch.zeros(WORLDS, 1, dtype=torch.int64)])
def test_actions_of_another_kind_or_shape_are_refused(bad: torch.Tensor) -> None:
    simulator = DeviceSimulator(config(), WORLDS, device="cpu")
    simulator.reset(0)
    with pytest.raises(ActionError, match="whole numbers of shape"):
        simulator.step(bad)


@pytest.mark.parametrize("bad", [-1, 99])
def test_actions_out_of_range_are_refused(bad: int) -> None:
    simulator = DeviceSimulator(config(), WORLDS, device="cpu")
    simulator.reset(0)
    before = simulator.robots.clone()
    with pytest.raises(ActionError, match=r"0\.\.K-1"):
        simulator.step(torch.full((WORLDS, ROBOTS), bad))
    assert torch.equal(simulator.robots, before)
