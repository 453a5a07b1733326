"""Test the central planner: its motions, its choices, who gives way, and its place in evaluations."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from train.cli import main
from train.epibt import NEEDS, Epibt, check_config
from train.epibt.inheritance import touch
from train.epibt.planner import scene_of
from train.epibt.sequences import (
    ARC_SPEED,
    COS,
    KEPT,
    SIN,
    STAGE,
    STANDS,
    SWEEP,
    TWO_ARCS,
    X,
    Y,
    estimate,
    make_sequences,
    programs,
    roll_out,
)  # fmt: skip
from train.evaluation.recorded import record
from train.evaluation.rollout import Experiment, make_experiment, run
from train.live.world import World, WorldSetting, live_floors
from train.reporting.rows import read_rows
from warehouse_env.config import EnvConfig, FleetPart, RobotSpec
from warehouse_env.errors import ConfigError
from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment
from warehouse_env.simulation.tasks.duty import Doing
from warehouse_env.simulation.tasks.orders import Order
from warehouse_env.traffic_spec import UncertaintySpec
from warehouse_env.work import BatterySpec, OrderSpec, ServiceSpec

ROBOTS = 24
WORK: dict[str, Any] = {
    "arrival": "stop", "service": ServiceSpec(3.0, 3.0, load=500.0),
    "fleet": (FleetPart(ROBOTS // 2, RobotSpec(0.7, 0.5)), FleetPart(ROBOTS // 2, RobotSpec(max_speed=1.0))),
}  # fmt: skip


def _config(robots: int = ROBOTS, **given: Any) -> EnvConfig:
    return EnvConfig(num_agents=robots, planner="astar_turns", max_steps=10_000, **NEEDS).replace(**given)


def _planner(simulator: Simulator) -> tuple[Epibt, list[np.random.Generator]]:
    return Epibt(simulator.config, 1), [np.random.default_rng(0)]


def _experiment(episodes: int = 2) -> Experiment:
    base = EnvConfig("narrow", ROBOTS, "astar_turns")
    return make_experiment("epibt", base, episodes, 10.0, 31_000_000)


@kernel
def _touching(held, params, sequences):
    """Return the number of pairs of robots whose sequences touch."""
    count = 0
    for i in range(len(held)):
        for j in range(i):
            count += touch(i, held[i], j, held[j], params, sequences)
    return count


@pytest.mark.parametrize("given", [{}, WORK], ids=["alike", "of two kinds, served and under loads"])
def test_robots_drive_their_sequences_which_never_touch(given: dict[str, Any]) -> None:
    simulator = Simulator(_config(layout="single_lane", **given), 1)
    simulator.reset([7])
    (planner, generators), goals, robots = _planner(simulator), 0, simulator.robots[0]
    for step in range(200):
        params = scene_of(simulator, 0, planner._table).params.copy()
        actions = planner.act(simulator, generators)
        held, sequences = planner._choosing.held, planner._sequences
        if step % STAGE == 0:
            assert _touching(held, params, sequences) == 0
        simulator.step(actions)
        goals += int(robots["events"]["arrived"].sum())
        last = np.minimum((step % STAGE + 1) * simulator.config.substeps, sequences.counts[range(ROBOTS), held] - 1)
        poses, motion, back = sequences.poses[range(ROBOTS), held, last], robots["motion"], params["offset"]
        middle = np.stack([motion["x"] - back * motion["cos"], motion["y"] - back * motion["sin"]], -1)
        np.testing.assert_allclose(poses[:, [X, Y]], middle, atol=1e-5)
        np.testing.assert_allclose(poses[:, [COS, SIN]], np.stack([motion["cos"], motion["sin"]], -1), atol=1e-5)
    assert goals > (ROBOTS // 3 if given else ROBOTS // 2)  # those that are served stand
    assert not robots["totals"]["hits_robot"].any()
    assert not robots["totals"]["hits_shelf"].any()


def test_its_robots_carry_out_orders_and_then_rest_and_charge() -> None:
    fleet = tuple(dataclasses.replace(part, count=2) for part in WORK["fleet"])
    work = WORK | {"orders": OrderSpec(), "battery": BatterySpec(chargers=2), "fleet": fleet}
    config = _config(4, layout="aisles:seed=741", **work)
    picks, stations, _ = make_layout(config.layout).endpoints
    orders = [Order(0.0, (picks[90 * robot],), stations[8 * robot], 500.0, 500.0) for robot in range(4)]
    simulator = Simulator(config, orders=orders)
    simulator.reset(1)
    planner, generators = _planner(simulator)
    for _ in range(1500):
        simulator.step(planner.act(simulator, generators))
    shift = simulator.dispatcher.shifts[0]  # type: ignore[index]
    assert {duty.doing for duty in shift.duties} == {Doing.RESTS, Doing.CHARGES}
    assert not simulator.robots[0]["task"]["alive"].any()
    assert simulator.episode_metrics(0)["orders_done"] == 4
    assert not simulator.robots[0]["totals"]["hits_robot"].any()


def test_a_floor_with_a_speed_limit_is_refused() -> None:
    simulator = Simulator(_config(2), 1, grid=GridMap(np.zeros((6, 6), bool), speed=np.full((6, 6), 0.5)))
    with pytest.raises(ConfigError, match="epibt does not plan for zones"):
        _planner(simulator)[0].act(simulator, [np.random.default_rng(0)])


@kernel
def _estimate_all(scene, sequences):
    for i in range(len(scene.robots)):
        estimate(i, len(scene.table), scene, sequences)


@kernel
def _roll_out_all(scene, sequences):
    for i in range(len(scene.robots)):
        for k in range(len(scene.table)):
            roll_out(i, k, scene, sequences)


def test_a_queue_may_set_out_at_once_though_it_stands_close() -> None:
    simulator = Simulator(_config(2), 1, grid=GridMap(np.zeros((5, 14), bool), picks=[(2, 12), (0, 12)]))
    goals = simulator.grid.centre(np.array([(2, 12), (0, 12)]))
    apart = simulator.config.robot.length + 0.02
    simulator.reset(None, [Assignment(np.array([(3.0, 2.5, 0.0), (3.0 + apart, 2.5, 0.0)]), goals)])
    table = programs()
    sequences = make_sequences(simulator.config, len(table))
    scene = scene_of(simulator, 0, table)
    _roll_out_all(scene, sequences)
    ahead = int(np.flatnonzero((table == np.array([TWO_ARCS, 0.6, 0, 2, 0, 0, 0], np.float32)).all(axis=1))[0])
    for first, second, expected in ((ahead, ahead, 0), (ahead, STANDS, 1), (STANDS, ahead, 0), (STANDS, STANDS, 0)):
        assert _touching(np.array([first, second]), scene.params, sequences) == expected


def test_a_touch_between_two_poses_counts() -> None:
    simulator = Simulator(_config(2), 1)
    params, sequences = scene_of(simulator, 0, programs()).params, make_sequences(simulator.config, 1)
    sequences.counts[:] = 2
    sequences.poses[..., COS] = 1.0
    sequences.poses[0, 0, :2, X] = 0.0, 3.0  # past the other in one step
    sequences.poses[:, 0, :2, SWEEP] = [[1.5], [0.0]]
    sequences.boxes[0, 0, 1] = 3.0
    for aside, expected in ((0.0, 1), (0.58, 1), (0.63, 0)):
        sequences.poses[1, 0, :2, X], sequences.poses[1, 0, :2, Y] = 1.5, aside
        sequences.boxes[1, 0] = 1.5, 1.5, aside, aside
        assert _touching(np.zeros(2, np.int64), params, sequences) == expected


def test_a_push_that_fails_is_undone() -> None:
    occupied = np.ones((9, 9), bool)
    occupied[1:8:3, 1:8] = occupied[1:8, 1:8:3] = False  # one-cell aisles that cross
    grid = GridMap(occupied, name="crossings")
    simulator = Simulator(_config(14), 1, grid=grid)
    simulator.reset([2])
    planner, generators = _planner(simulator)
    params = scene_of(simulator, 0, planner._table).params
    for step in range(150):
        actions = planner.act(simulator, generators)
        if step % STAGE == 0:
            assert not planner._choosing.lifted.any()
            assert _touching(planner._choosing.held, params, planner._sequences) == 0
        simulator.step(actions)
    assert not simulator.robots[0]["totals"]["hits_robot"].any()


def test_estimates_are_close_to_the_costs_of_sequences_rolled_out() -> None:
    simulator = Simulator(_config(layout="single_lane"), 1)
    simulator.reset([7])
    planner, generators = _planner(simulator)
    for _ in range(4 * STAGE):
        simulator.step(planner.act(simulator, generators))
    table = programs()
    sequences = make_sequences(simulator.config, len(table))
    scene = scene_of(simulator, 0, table)
    _estimate_all(scene, sequences)
    assert not sequences.counts.any()
    estimated = sequences.costs.copy()
    _roll_out_all(scene, sequences)
    arrive = (estimated < -900.0) != (sequences.costs < -900.0)  # whether only one of the two passes the goal
    assert arrive.mean() < 0.01
    off = np.abs(estimated - sequences.costs)[~arrive]
    assert np.median(off) < 0.02
    assert (off < 0.5).mean() > 0.95  # a shelf beside the end costs a second


def test_every_sequence_ends_at_rest() -> None:
    simulator = Simulator(_config(1, layout="narrow"), 1)
    simulator.reset([3])
    planner, generators = _planner(simulator)
    table, rolled = programs(), planner._sequences
    planner.act(simulator, generators)
    rolled.left[:] = 0
    _roll_out_all(scene_of(simulator, 0, table), rolled)
    assert table[0, 0] == KEPT
    assert table[1, 0] == STANDS
    dt = simulator.config.time_step
    for k in range(len(table)):
        steps = (rolled.counts[0, k] - 1) // simulator.config.substeps
        assert abs(rolled.controls[0, k, :steps, 0].sum() * dt) < 1e-5  # of what it gains in speed from rest on


def test_a_younger_robot_backs_out_of_a_passage_for_an_older_one() -> None:
    occupied = np.ones((5, 14), bool)
    occupied[2, 1:13] = False
    occupied[1:4, 11:13] = False  # a bay at the east end; the west end is closed
    grid = GridMap(occupied, name="passage", picks=[(2, 1), (1, 12)], stations=[(3, 12), (2, 12)])
    simulator = Simulator(_config(2), 1, grid=grid)
    west, east = grid.centre(np.array([(2, 3), (2, 8)]))
    starts = np.array([(*west, 0.0), (*east, np.pi)])  # nose to nose in the aisle
    goals = grid.centre(np.array([(3, 12), (2, 1)]))
    simulator.reset(None, [Assignment(starts, goals)])
    simulator.robots[0]["task"]["age"] = 100, 0
    (planner, generators), backed = _planner(simulator), 0.0
    for _ in range(600):
        simulator.step(planner.act(simulator, generators))
        backed = max(backed, float(simulator.robots[0, 1]["motion"]["x"]) - east[0])
        if simulator.robots[0, 0]["events"]["arrived"]:
            break
    assert simulator.robots[0, 0]["events"]["arrived"]
    assert backed > 2.0
    assert not simulator.robots[0]["totals"]["hits_robot"].any()


@pytest.mark.parametrize(
    ("gap", "wheels", "ages", "seconds"),
    [
        pytest.param(2.0, 0.0, (100, 0), 90.0, id="the older one drives in"),
        pytest.param(0.95, -60.0, (0, 100), 60.0, id="the younger one, whose wheels are turned, drives in"),
    ],
)
def test_robots_leave_a_dead_end(gap: float, wheels: float, ages: tuple[int, int], seconds: float) -> None:
    occupied = np.ones((5, 24), bool)
    occupied[2, 1:23] = False
    occupied[1:4, 19:23] = False  # a bay at the east end, farther than a robot retreats; the west end is closed
    grid = GridMap(occupied, name="dead_end", picks=[(2, 1), (1, 22)], stations=[(3, 22), (2, 22)])
    simulator = Simulator(_config(2), 1, grid=grid)
    (x, y), goals = grid.centre(np.array((2, 4))), grid.centre(np.array([(2, 1), (3, 22)]))
    simulator.reset(None, [Assignment(np.array([(x + gap, y, np.pi), (x, y, np.pi)]), goals)])
    simulator.robots[0]["task"]["age"] = ages
    simulator.robots[0]["motion"]["steer"] = np.radians(wheels), 0.0
    (planner, generators), arrived = _planner(simulator), np.zeros(2, bool)
    for _ in range(round(seconds / simulator.config.time_step)):
        simulator.step(planner.act(simulator, generators))
        arrived |= simulator.robots[0]["events"]["arrived"] != 0
        if arrived.all():
            break
    assert arrived.all()
    assert not simulator.robots[0]["totals"]["hits_robot"].any()


def _corner() -> Simulator:
    """Return a world in which a robot stands askew where two one-cell aisles meet, with its goal around the corner."""
    occupied = np.ones((6, 9), bool)
    occupied[0, :] = occupied[:, 4] = False  # two one-cell aisles that meet
    grid = GridMap(occupied, name="corner", picks=[(0, 8), (5, 4)], stations=[(0, 0), (0, 1)])
    simulator = Simulator(_config(1), 1, grid=grid)
    (x, y), goal = grid.centre(np.array((0, 4))), grid.centre(np.array([(0, 8)]))
    simulator.reset(None, [Assignment(np.array([(x + 0.04, y - 0.4, -1.457)]), goal)])
    return simulator


def test_a_robot_turns_at_a_corner_where_every_single_sequence_costs_more_than_standing() -> None:
    simulator = _corner()
    planner, generators = _planner(simulator)
    for _ in range(250):
        simulator.step(planner.act(simulator, generators))
        if simulator.robots[0, 0]["events"]["arrived"]:
            break
    assert simulator.robots[0, 0]["events"]["arrived"]
    assert not simulator.robots[0]["totals"]["hits_shelf"].any()


@pytest.mark.parametrize(("field", "value"), [("age", 0), ("alive", 0)])
def test_a_robot_that_has_another_goal_or_is_served_drops_its_manoeuvre(field: str, value: int) -> None:
    simulator = _corner()
    planner, generators = _planner(simulator)
    for _ in range(100):
        simulator.step(planner.act(simulator, generators))
    arc, counts = planner._manoeuvres.arc[0, 0], planner._manoeuvres._counts[0]
    assert arc[ARC_SPEED] != 0.0
    assert counts[0] > 0
    simulator.robots[0]["task"][field] = value
    planner._manoeuvres.go_on(simulator, 0, 1)  # in which no search is due
    assert arc[ARC_SPEED] == 0.0
    assert counts[0] == 0


def test_a_row_does_not_depend_on_the_episodes_beside_it() -> None:
    rows = run(_experiment())
    alone = run(_experiment(1))
    assert {**rows[0], "ms_per_step": 0.0} == {**alone[0], "ms_per_step": 0.0}
    assert rows[0]["goals"] > 0
    assert rows[0]["collisions_robot"] == rows[0]["collisions_shelf"] == 0


def test_retreats_do_not_depend_on_the_worlds_beside_it() -> None:
    chosen = []
    for seeds in ([3, 4], [4]):
        simulator = Simulator(_config(8, layout="narrow"), len(seeds))
        simulator.reset(seeds)
        simulator.robots["clocks"]["standing_time"] = 100.0
        planner = Epibt(simulator.config, len(seeds))
        generators = [np.random.default_rng(seed) for seed in seeds]
        actions = [planner.act(simulator, generators)[-1] for _ in range(STAGE * 20)]
        chosen.append((np.array(actions), planner._backs[-1].copy()))
    np.testing.assert_array_equal(chosen[0][0], chosen[1][0])
    np.testing.assert_array_equal(chosen[0][1], chosen[1][1])
    assert chosen[0][1].any()


def test_a_recorded_episode_replays_to_the_bit() -> None:
    episode = record(_experiment(1))
    *_, last = episode.replay()
    assert last is not None
    assert episode.policy == "epibt"


def test_it_drives_a_live_world() -> None:
    world = World(WorldSetting("epibt", "narrow", ROBOTS, 7, "astar_turns"), live_floors("narrow"))
    for _ in range(50):
        world.step()
    totals = world.simulator.robots[0]["totals"]
    assert totals["distance"].min() > 0.0
    assert not totals["hits_robot"].any()


def test_advise_may_choose_it(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    budget = ["--most", "2", "--episodes", "2", "--seconds", "10", "--processes", "1"]
    assert main(["advise", "--policy", "epibt", "--layout", "narrow", *budget, "--out", str(tmp_path)]) == 0
    assert {row["policy"] for row in read_rows(tmp_path / "rows.jsonl")} == {"epibt"}
    assert "a central planner" in (tmp_path / "index.html").read_text()


@pytest.mark.parametrize(
    ("given", "what"),
    [
        ({"action_type": "discrete"}, "action types"),
        ({"action_repeat": 2}, "action_repeat=2"),
        ({"tasks": "one_shot"}, "one-shot"),
        ({"arrival": "pose"}, "stop at poses"),
        ({"people": 2}, "people"),
        ({"robot": RobotSpec(max_acceleration=0.2)}, "longer than 6 s to stop"),
        ({"uncertainty": UncertaintySpec(latency=0.3)}, "latency"),
    ],
)
def test_what_it_does_not_plan_for_is_refused(given: dict[str, Any], what: str) -> None:
    with pytest.raises(ConfigError, match=f"epibt does not plan for .*{what}"):
        check_config(_config().replace(**given))


def test_a_disturbance_of_observations_is_refused() -> None:
    with pytest.raises(ConfigError, match="sees the state"):
        make_experiment("epibt", EnvConfig(num_agents=2), 1, 1.0, 0, disturbance="long")
