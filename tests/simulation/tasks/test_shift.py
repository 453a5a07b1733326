"""Shifts: service takes its time, orders are carried out, queues stand aside, loads slow, nobody strands."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.errors import WarehouseError
from warehouse_env.maps.layouts import make_layout
from warehouse_env.maps.moves import label_regions
from warehouse_env.routes.goals import face
from warehouse_env.simulation.record.recording import Episode, Recorder
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import OWNER, field_of
from warehouse_env.simulation.tasks.duty import GRAVITY, Batteries, Doing, service_time
from warehouse_env.simulation.tasks.orders import Order, write_orders
from warehouse_env.simulation.tasks.places import Places, standing_places
from warehouse_env.simulation.tasks.sampled import disc_of
from warehouse_env.simulation.tasks.shifts import slowed
from warehouse_env.work import BatterySpec, OrderSpec, ServiceSpec

FLOOR = make_layout("open")
PICKS, STATIONS, _ = FLOOR.endpoints
ORDERS = OrderSpec(per_hour=3000, picks=2)
BASE = EnvConfig(layout="open", num_agents=4, planner="astar", arrival="stop", max_steps=10**6)
BATTERY = BatterySpec(capacity=40.0, power=4000.0)
BUSY = BASE.replace(service=ServiceSpec(3.0, 2.0, variation=0.5), orders=ORDERS, battery=BATTERY)


def cruise(simulator: Simulator, steps: int = 1) -> None:
    actions = np.full((simulator.num_worlds, simulator.num_agents), simulator.cruise_action)
    for _ in range(steps):
        simulator.step(actions)


def until(simulator: Simulator, doing: Doing, robot: int = 0, most: int = 2000) -> Any:
    """Drive until a robot of the first world is at something; return its duty."""
    for _ in range(most):
        duty = simulator.dispatcher.shifts[0].duties[robot]  # type: ignore[index]
        if duty.doing == doing:
            return duty
        cruise(simulator)
    raise AssertionError(f"robot {robot} never {doing.name}")


def single(orders: list[Order], **changes: Any) -> Simulator:
    config = BASE.replace(num_agents=1, orders=OrderSpec(), **changes)
    simulator = Simulator(config, orders=orders)
    simulator.reset(1)
    return simulator


def same(one: Simulator, other: Simulator) -> bool:
    a, b = one.robots, other.robots
    kept = all(np.array_equal(field_of(a, name), field_of(b, name), equal_nan=name == "goal_heading") for name in OWNER)
    return kept and np.array_equal(one.observation, other.observation)


def test_a_service_takes_its_time_and_the_robot_stands() -> None:
    order = Order(0.0, (PICKS[5],), STATIONS[3], 500.0, 300.0)
    simulator = single([order], service=ServiceSpec(pick=4.0, station=2.0))
    until(simulator, Doing.SERVED)
    begun, place = simulator.steps[0], simulator.state.pose[0, 0].copy()
    needs = simulator.observation[0, 0, simulator.layout.slices["needs"]]
    assert needs[1] == 1 and needs[2] == pytest.approx(4 / 60)  # noqa: PT018
    until(simulator, Doing.STOP)
    assert simulator.steps[0] - begun == 40  # four seconds of 0.1 s
    np.testing.assert_array_equal(simulator.state.pose[0, 0], place)
    shift = simulator.dispatcher.shifts[0]  # type: ignore[index]
    assert shift.load[0] == 300
    assert shift.carries[0]
    until(simulator, Doing.RESTS)
    row = simulator.episode_metrics()
    assert (row["orders_done"], row["orders_late"], row["goals"]) == (1, 0, 2)
    assert row["served_share"] * row["seconds"] == pytest.approx(6.0)
    assert row["station_utilisation"] * row["seconds"] * len(STATIONS) == pytest.approx(2.0)
    assert shift.load[0] == 0


def test_service_varies_about_its_mean_as_asked() -> None:
    rng, spec = np.random.default_rng(0), ServiceSpec(pick=20.0, station=40.0, variation=0.5)
    for at_station, mean in ((False, 20.0), (True, 40.0)):
        drawn = [service_time(spec, at_station, rng) for _ in range(4000)]
        assert np.mean(drawn) == pytest.approx(mean, rel=0.05)
        assert np.std(drawn) == pytest.approx(mean / 2, rel=0.05)
    assert service_time(ServiceSpec(pick=7.0), False, rng) == 7.0
    assert service_time(None, True, rng) == 0.0


def test_a_load_slows_by_the_rule() -> None:
    robot = RobotSpec(mass=300.0)
    speed, acceleration = slowed(robot, 100.0)
    assert acceleration == pytest.approx(0.75)
    assert speed**2 / acceleration == pytest.approx(robot.max_speed**2 / robot.max_acceleration)  # stops as soon
    simulator = single([Order(0.0, (PICKS[0],), STATIONS[-1], 500.0, 500.0)])
    fastest = {False: 0.0, True: 0.0}
    for _ in range(700):
        shift, before = simulator.dispatcher.shifts[0], float(simulator.state.speed[0, 0])  # type: ignore[index]
        loaded = bool(shift.carries[0])
        cruise(simulator)
        now = float(simulator.state.speed[0, 0])
        fastest[loaded] = max(fastest[loaded], now)
        if loaded and bool(shift.carries[0]):
            assert now - before <= 0.05 + 1e-6
    assert fastest[True] == pytest.approx(1.5 * math.sqrt(0.5), abs=1e-3)
    assert fastest[False] > 1.4


def test_a_robot_that_wants_a_held_cell_queues_and_gets_it_next() -> None:
    places = Places(waiting=[(0, 0), (0, 5)], spare=[(9, 9)])
    places.take(1, (5, 5))
    assert places.near((1, 4)) == (0, 5)
    places.take(2, (0, 5))
    places.queue(2, (5, 5))
    places.take(3, (0, 0))
    places.queue(3, (5, 5))
    assert places.near((1, 4)) == (9, 9)
    assert places.next_in() == []
    places.leave(1)
    assert places.next_in() == [(2, (5, 5))]
    places.take(2, (5, 5))
    assert places.queued((5, 5)) == 1
    places.queue(3, (1, 1))  # a charger, say, since its battery is low: it waits for nothing else any more
    assert places.queued((5, 5)) == 0
    assert places.queued((1, 1)) == 1
    assert not places.stands(2)
    assert places.stands(3)


def test_robots_that_rest_or_charge_stand_along_the_wall_beside_them() -> None:
    config = BASE.replace(layout="aisles:seed=741", orders=OrderSpec(), battery=BatterySpec(chargers=2))
    picks, stations, _ = make_layout(config.layout).endpoints
    orders = [Order(0.0, (picks[90 * robot],), stations[8 * robot], 500.0, 0.0) for robot in range(4)]
    simulator = Simulator(config, orders=orders)
    simulator.reset(1)
    shift, robots = simulator.dispatcher.shifts[0], simulator.robots[0]  # type: ignore[index]
    cruise(simulator, 1500)
    assert {duty.doing for duty in shift.duties} == {Doing.RESTS, Doing.CHARGES}
    parked = robots[robots["task"]["alive"] == 0]
    assert len(parked) == 4
    off = (parked["motion"]["heading"] + math.pi / 4) % (math.pi / 2) - math.pi / 4  # from the nearest axis
    assert abs(off).max() <= BASE.pose_angle


@pytest.mark.parametrize("layout", ["paper46", "narrow", "aisles:seed=741"])
def test_robots_at_all_places_leave_all_endpoints_connected(layout: str) -> None:
    grid, config = make_layout(layout), BASE.replace(num_agents=40)
    places = standing_places(grid, config, 44)
    free = ~grid.occupied
    for place in places:
        along = face(grid, place, config.robot).poses  # in the middle of the cell, which holds the body
        cells = np.array([place]) if along else disc_of(config, grid.cell_size) + place
        free[tuple(cells[((cells >= 0) & (cells < grid.shape)).all(axis=1)].T)] = False
    labels = label_regions(free)
    assert len({int(labels[cell]) for cell in grid.endpoints[2]}) == 1
    assert len(places) >= 26
    assert not set(places) & set(grid.endpoints[2])


def test_a_battery_gives_by_hand() -> None:
    spec = BatterySpec(capacity=100.0, resistance=0.05, standing=72.0, power=720.0)
    config = BASE.replace(num_agents=2, robot=RobotSpec(mass=400.0), battery=spec)
    batteries = Batteries(config, np.full((2, 2), 100.0))
    batteries.charge[:] = 50.0
    batteries.use(10.0, np.array([20.0, 0.0]), np.array([100.0, 0.0]), np.array([False, True]))
    driven = 0.05 * 500.0 * GRAVITY * 20.0 / 3600.0
    np.testing.assert_allclose(batteries.charge, [50.0 - driven - 0.2, 50.0 - 0.2 + 2.0])
    assert batteries.row(10.0)["charging_share"] == 0.5
    needed = 1.5 * 100.0 * (0.05 * 500.0 * GRAVITY + 144.0) / 3600.0
    assert batteries.needed(100.0, 100.0) == pytest.approx(needed)
    batteries.charge[:] = needed - 0.1, needed + 0.1
    np.testing.assert_array_equal(batteries.is_critical(np.zeros((2, 2), int), np.full(2, 100.0)), [True, False])


def test_nobody_strands_and_orders_are_carried_out() -> None:
    simulator = Simulator(BUSY.replace(num_agents=2))
    simulator.reset(31_000_001)
    charged = set()
    for _ in range(6000):
        cruise(simulator)
        duties = simulator.dispatcher.shifts[0].duties  # type: ignore[index]
        charged |= {robot for robot, duty in enumerate(duties) if duty.doing == Doing.CHARGES}
        held = [duty.stops[0] for duty in duties if duty.doing in (Doing.STOP, Doing.SERVED)]
        assert len(set(held)) == len(held)
    row = simulator.episode_metrics()
    assert row["orders_done"] > 10
    assert row["stranded"] == 0 < row["lowest_charge"]
    assert charged == {0, 1}
    assert 0 < row["empty_driving"] < 1


def test_an_episode_of_a_file_of_orders_replays_without_the_file(tmp_path: Path) -> None:
    path = tmp_path / "orders.csv"
    write_orders(path, [Order(float(k), (PICKS[3 * k],), STATIONS[k], 300.0, 50.0) for k in range(8)])
    recorder = Recorder(Simulator(BUSY.replace(orders=OrderSpec(file=str(path)))), (7,))
    for _ in range(200):
        recorder.step(np.full((1, 4), recorder.simulator.cruise_action))
    recorder.episode.save(tmp_path / "e.npz")
    path.unlink()
    *_, last = Episode.load(tmp_path / "e.npz").replay()
    assert same(last, recorder.simulator)
    arrays = dict(np.load(tmp_path / "e.npz"))
    cells = "[[1, 2]], [1, 2]"
    for orders in ("[", "[3]", "[[0, [], [1, 2], 9, 1]]", f"[[NaN, {cells}, 9, 1]]", '[[0, [[1, 2.5]], "12", 9, 1]]'):
        np.savez(tmp_path / "damaged.npz", **arrays | {"orders": np.frombuffer(orders.encode(), np.uint8)})
        with pytest.raises(WarehouseError, match="no complete episode file"):
            Episode.load(tmp_path / "damaged.npz")
