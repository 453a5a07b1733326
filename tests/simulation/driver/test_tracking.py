"""The path follower: where it thinks it is, where it steers, and that alone it neither hits a shelf nor gets stuck."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from tests.simulation.worlds import drawn, give_line, lay, room, stage, write
from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import LAYOUTS, make_layout
from warehouse_env.maps.movingai import EXAMPLE_MAP, read_map
from warehouse_env.simulation.driver import tracking
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import ALONE, AROUND_OTHERS, field_of
from warehouse_env.simulation.traffic import recovery

LEVELS, OFFSETS = 4, 5  # of the default discrete actions
STOP, BACK = 1 * OFFSETS, 0 * OFFSETS


def on_route(grid: GridMap, pose: tuple[float, ...], *corners: tuple[float, float], **changes: Any) -> Simulator:
    """A robot at a pose with a route along straight lines between corners, points 0.5 m apart."""
    simulator = stage(grid, pose, action_type="discrete", **changes)
    lay(simulator, *corners)
    return simulator


def facing_back(**changes: Any) -> Simulator:
    """A robot in an aisle of two cells whose route begins behind it."""
    grid = drawn(["#" * 24, "." * 24, "." * 24, "#" * 24])
    return on_route(grid, (12.0, 2.0, math.pi), (12.0, 2.0), (22.0, 2.0), **changes)


def drive(simulator: Simulator, action: int, steps: int) -> Any:
    for _ in range(steps):
        simulator.step(np.full((1, 1), action))
    return simulator.robots[0, 0]


def test_position_lateral_and_bearing_by_hand() -> None:
    # East along y = 2 to x = 8, then north.
    simulator = on_route(room(12, 12), (4.3, 2.25, 0.1), (2.0, 2.0), (8.0, 2.0), (8.0, 9.0))
    simulator.robots["on_route"]["position"] = 2.0
    r = drive(simulator, STOP, 1)
    assert r["on_route"]["position"] == pytest.approx(2.3, abs=1e-5)
    assert r["on_route"]["lateral"] == pytest.approx(0.25, abs=1e-5)
    assert r["on_route"]["bearing"] == pytest.approx(-0.1, abs=1e-5)
    assert simulator.events.progress[0, 0] == pytest.approx(0.3, abs=1e-5)
    # on the second leg: 6 m and 3 m; right of it is negative
    r["motion"]["x"], r["motion"]["y"], r["on_route"]["position"] = 8.4, 5.0, 8.5
    drive(simulator, STOP, 1)
    assert r["on_route"]["position"] == pytest.approx(9.0, abs=1e-5)
    assert r["on_route"]["lateral"] == pytest.approx(-0.4, abs=1e-5)
    assert r["on_route"]["bearing"] == pytest.approx(math.pi / 2 - 0.1, abs=1e-5)


def test_a_route_that_comes_back_beside_itself_is_not_skipped() -> None:
    # There along y = 3, back along y = 4: half a metre off the way out, the way back must not be taken for it.
    simulator = on_route(room(10, 16), (6.0, 3.45, 0.0), (2.0, 3.0), (12.0, 3.0), (12.0, 4.0), (2.0, 4.0))
    simulator.robots["on_route"]["position"] = 4.0
    r = drive(simulator, STOP, 1)
    assert r["on_route"]["position"] == pytest.approx(4.0, abs=1e-5)
    r["motion"]["y"] = 3.55  # even nearer to the way back
    drive(simulator, STOP, 1)
    assert r["on_route"]["position"] == pytest.approx(4.0, abs=1e-5)


@pytest.mark.parametrize("start", [(2.0, 4.0, 0.0), (2.0, 4.5, -0.6), (2.0, 3.6, 0.9)])
def test_it_comes_to_the_route_and_stays_on_it(start: tuple[float, ...]) -> None:
    simulator = on_route(room(9, 30), start, (2.0, 4.0), (28.0, 4.0))
    r = drive(simulator, int(simulator.cruise_action), 100)
    for _ in range(60):
        drive(simulator, int(simulator.cruise_action), 1)
        assert abs(r["on_route"]["lateral"]) < 0.03
        assert abs(r["on_route"]["bearing"]) < 0.05
        assert r["motion"]["speed"] == pytest.approx(1.5, abs=0.05)
    assert simulator.robots["totals"]["hits_shelf"].sum() == 0


def test_a_line_that_folds_at_its_start_is_driven_like_any_other() -> None:
    simulator = on_route(room(9, 20), (3.0, 4.5, 0.0), (3.0, 4.5), (18.0, 4.5))
    line = np.array([[3.0, 4.5], [3.005, 4.5], *([x, 4.5] for x in np.arange(3.5, 18.1, 0.5))], np.float32)
    give_line(simulator, 0, line)
    assert simulator.robots["on_route"]["spacing"] == pytest.approx(0.5)
    r = drive(simulator, int(simulator.cruise_action), 80)
    assert r["motion"]["x"] > 12.0
    assert r["on_route"]["position"] == pytest.approx(
        r["motion"]["x"] - 2.5, abs=0.1
    )  # half a metre of which is the fold


@pytest.mark.parametrize(("index", "offset"), list(enumerate((0.0, 0.6, -0.6, 1.2, -1.2))))
def test_offsets_are_kept_left_of_the_route(index: int, offset: float) -> None:
    simulator = on_route(room(9, 30), (2.0, 4.0, 0.0), (2.0, 4.0), (28.0, 4.0))
    r = drive(simulator, 3 * OFFSETS + index, 120)
    assert r["motion"]["y"] - 4.0 == pytest.approx(offset, abs=0.04)
    assert r["on_route"]["lateral"] == pytest.approx(offset, abs=0.04)
    assert abs(r["motion"]["heading"]) < 0.04
    # and fade out towards the goal
    while r["totals"]["goals"] == 0 and r["clocks"]["stalled_time"] < 5.0:
        before = abs(float(r["on_route"]["lateral"]))
        drive(simulator, 3 * OFFSETS + index, 1)
    assert r["totals"]["goals"] == 1
    assert before < 0.55


@pytest.mark.parametrize("index", range(OFFSETS))
def test_offsets_that_lead_to_a_shelf_are_cut_short(index: int) -> None:
    grid = drawn(["#" * 30, "." * 30, "." * 30, "#" * 30])
    simulator = on_route(grid, (2.0, 2.0, 0.0), (2.0, 2.0), (27.0, 2.0))
    r = drive(simulator, 3 * OFFSETS + index, 120)
    assert simulator.robots["totals"]["hits_shelf"].sum() == 0
    assert 1.45 - 0.03 <= r["motion"]["y"] <= 2.55 + 0.03  # a way-point keeps 0.45 m from the shelves
    assert r["clocks"]["stalled_time"] < 2.0


def test_a_slow_level_is_kept_and_stop_stops_in_half_v_squared_over_a() -> None:
    simulator = on_route(room(9, 30), (2.0, 4.0, 0.0), (2.0, 4.0), (28.0, 4.0))
    assert drive(simulator, 2 * OFFSETS, 40)["motion"]["speed"] == pytest.approx(0.5, abs=1e-6)
    simulator = on_route(room(9, 30), (2.0, 4.0, 0.0, 1.3), (2.0, 4.0), (28.0, 4.0))
    r = drive(simulator, STOP, 14)
    assert r["motion"]["speed"] == pytest.approx(0.0, abs=1e-6)
    assert r["motion"]["x"] - 2.0 == pytest.approx(1.3**2 / 2, abs=1e-4)
    assert r["motion"]["y"] == 4.0


@pytest.mark.parametrize("heading", [0.0, 0.3, -0.4])
def test_backing_brings_the_nose_along_the_route(heading: float) -> None:
    simulator = on_route(room(9, 20), (15.0, 4.5, heading), (4.0, 4.5), (18.0, 4.5))
    simulator.robots["on_route"]["position"] = 11.0
    r = drive(simulator, BACK, 80)
    assert r["motion"]["speed"] == pytest.approx(-0.4, abs=1e-5)
    assert abs(r["motion"]["heading"]) < 0.05
    # 0.4 s to get up to speed, over 0.08 m
    assert math.hypot(r["motion"]["x"] - 15.0, r["motion"]["y"] - 4.5) == pytest.approx(7.6 * 0.4 + 0.08, abs=0.06)
    assert simulator.robots["totals"]["hits_shelf"].sum() == 0


def test_backing_stops_at_the_end_of_a_one_cell_aisle() -> None:
    simulator = on_route(drawn(["#" * 20, "." * 20, "#" * 20]), (3.0, 1.5, 0.0), (1.5, 1.5), (18.0, 1.5))
    simulator.robots["on_route"]["position"] = 1.5
    r = drive(simulator, BACK, 120)
    assert simulator.robots["totals"]["hits_shelf"].sum() == 0
    assert 0.0 <= r["motion"]["x"] - 0.75 < 0.2


@pytest.mark.parametrize("bearing", [-1.0, -0.5, 0.0, 0.5])
def test_it_backs_off_a_wall_whatever_its_route_does(bearing: float) -> None:
    # The tail is 5 cm above the wall: to turn the nose down, or back straight, would push it in.
    x, y, heading = 10.0, 0.05 + 0.75 * math.sin(2.7) + 0.3 * abs(math.cos(2.7)), 2.7
    along = heading + bearing
    corner = x + 4.0 * math.cos(along), y + 4.0 * math.sin(along)
    simulator = on_route(room(9, 20), (x, y, heading), (x, y), corner)
    r = drive(simulator, BACK, 60)
    assert math.hypot(r["motion"]["x"] - x, r["motion"]["y"] - y) > 0.5
    assert simulator.robots["totals"]["hits_shelf"].sum() == 0


def test_it_slows_down_in_a_sharp_turn() -> None:
    simulator = on_route(room(20, 20), (2.0, 4.0, 0.0), (2.0, 4.0), (12.0, 4.0), (12.0, 16.0))
    slowest, outside = 9.0, 0.0
    for _ in range(250):
        r = drive(simulator, int(simulator.cruise_action), 1)
        if 8.0 < r["on_route"]["position"] < 13.0:
            slowest = min(slowest, float(r["motion"]["speed"]))
            outside = max(outside, abs(float(r["on_route"]["lateral"])))
        if r["on_route"]["position"] > 16.0:
            break
    assert r["on_route"]["position"] > 16.0
    assert slowest < 1.2  # of 1.5
    assert outside < 0.5  # cuts the corner, but stays near


@pytest.mark.parametrize("told", [STOP, BACK])
def test_in_a_manoeuvre_it_stops_or_backs_when_told_and_goes_on(told: int) -> None:
    simulator = facing_back()
    cruise = int(simulator.cruise_action)
    r = drive(simulator, cruise, 8)
    manoeuvre, left = simulator.arcs[0, 0].copy(), int(r["manoeuvre"]["arcs"])
    assert r["motion"]["speed"] != 0.0
    drive(simulator, told, 12 if told == STOP else 10)
    if told == STOP:
        pose = simulator.state.pose[0, 0].copy()
        drive(simulator, STOP, 20)
        assert (simulator.state.pose[0, 0] == pose).all()
        assert r["manoeuvre"]["arcs"] > 0
    else:
        assert r["motion"]["speed"] <= 0.0
        assert r["manoeuvre"]["arcs"] == left > 0
        assert (simulator.arcs[0, 0] == manoeuvre).all()
    for _ in range(150):  # with what is left of its manoeuvre, or with a new one where it has backed too far off
        drive(simulator, cruise, 1)
        if r["manoeuvre"]["arcs"] == 0 and abs(r["on_route"]["bearing"]) < 0.3 and r["on_route"]["position"] > 0.5:
            break
    assert r["manoeuvre"]["arcs"] == 0
    assert abs(r["on_route"]["bearing"]) < 0.3
    assert r["on_route"]["position"] > 0.5
    assert simulator.robots["totals"]["hits_shelf"].sum() == 0


@pytest.mark.parametrize("past", [0.6, 0.65, 0.7])
def test_it_does_not_leave_its_arcs_while_its_tail_would_swing_into_a_shelf(past: float) -> None:
    """Its tail is still beside a corner, .1 mm off, when its route turns away."""
    grid = drawn(["." * 24] * 3 + ["#" * 12 + "." * 12] + ["." * 24] * 4)  # a shelf at y from 4 to 5, up to x = 12
    simulator = on_route(grid, (12 + past, 3.6999, 0.0, 0.3), (11.0, 3.45), (20.0, 3.45))
    simulator.arcs[0, 0, :2] = (0.6, 0.0), (0.3, 0.0)
    r = simulator.robots[0, 0]
    write(r, arcs=2, arc=0, arc_x=12 + past, arc_y=3.6999, arc_heading=0.0, arc_left=0.6)
    write(r, arc_margin=5e-5, arc_planned=5e-5)
    drive(simulator, int(simulator.cruise_action), 5)
    assert r["totals"]["hits_shelf"] == 0
    assert r["motion"]["x"] > 12 + past + 0.2


def test_it_comes_back_to_its_arcs_from_where_it_was_pushed() -> None:
    grid = room(12, 24)
    simulator = on_route(grid, (12.0, 6.0, math.pi), (12.0, 6.0), (22.0, 6.0))
    r = drive(simulator, int(simulator.cruise_action), 8)
    arcs = int(r["manoeuvre"]["arcs"])
    assert arcs > 0
    r["motion"]["x"] += 0.05
    r["motion"]["heading"] += 0.1
    r["motion"]["cos"], r["motion"]["sin"] = math.cos(r["motion"]["heading"]), math.sin(r["motion"]["heading"])
    for _ in range(60):
        drive(simulator, int(simulator.cruise_action), 1)
        if r["manoeuvre"]["arcs"] == 0:
            break
        assert r["manoeuvre"]["arcs"] == arcs  # the same manoeuvre, not a new one
        assert math.hypot(r["motion"]["x"] - r["manoeuvre"]["arc_x"], r["motion"]["y"] - r["manoeuvre"]["arc_y"]) < 0.15
    assert r["manoeuvre"]["arcs"] == 0
    r["motion"]["x"] += 0.5  # further off than feedback should mend: the next search begins there
    drive(simulator, int(simulator.cruise_action), 100)
    assert r["totals"]["goals"] >= 1  # the next one is drawn by chance, and may be near


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, math.pi, -math.pi / 2])
def test_it_leaves_a_blind_aisle_of_one_cell(heading: float) -> None:
    lines = ["#" * 16, "#......#########", "######..........", "######..........", "#" * 16]
    simulator = on_route(drawn(lines), (6.5, 2.0, heading), (6.5, 2.0), (14.0, 2.0))
    simulator.robots["motion"]["x"], simulator.robots["motion"]["y"] = 2.2, 3.5
    if heading in (math.pi / 2, -math.pi / 2):  # crosswise the body fits at its mouth alone
        simulator.robots["motion"]["x"], simulator.robots["motion"]["y"] = 6.5, 2.5
    r = drive(simulator, int(simulator.cruise_action), 300)
    assert r["totals"]["goals"] >= 1
    assert simulator.robots["totals"]["hits_shelf"].sum() == 0


def test_in_a_gap_between_shelves_it_does_not_wedge_itself() -> None:
    """As it happened: it came down into the gap, and the next goal lay behind it."""
    lines = ["#" * 9 + "...####", "." * 16, "#######.#####..#", "." * 16]
    pose = (7.41993, 1.95737, -1.87666, 0.54109, -0.87258)
    simulator = on_route(drawn(lines), pose, (7.42, 1.96), (7.28, 2.41), (6.8, 2.51), (1.5, 2.5))
    r = drive(simulator, int(simulator.cruise_action), 600)
    assert r["totals"]["goals"] >= 1


@cache
def drive_alone(grid: GridMap, seconds: float) -> Simulator:
    """Drive one robot along its routes in each of 16 worlds; none may stay within half a cell for 20 s."""
    config = EnvConfig(num_agents=1, planner="astar_turns", action_repeat=2)
    simulator = Simulator(config, 16, grid=grid)
    simulator.reset(7)
    cruise = np.full((16, 1), simulator.cruise_action)
    left, since = simulator.state.pose[:, 0, :2].copy(), np.zeros(16)
    for step in range(round(seconds / (config.action_repeat * config.time_step))):
        simulator.step(cruise)
        now = (step + 1) * config.action_repeat * config.time_step
        at = simulator.state.pose[:, 0, :2]
        moved = np.hypot(*(at - left).T) > 0.5 * grid.cell_size
        left[moved], since[moved] = at[moved], now
        assert (now - since).max() < 20.0
    assert simulator.robots["totals"]["hits_shelf"].sum() == 0
    return simulator


@pytest.mark.parametrize("name", [*LAYOUTS, "example"])
def test_alone_it_always_arrives(name: str) -> None:
    grid = read_map(EXAMPLE_MAP) if name == "example" else make_layout(name)
    robots = drive_alone(grid, 300.0).robots[:, 0]
    assert robots["totals"]["goals"].min() >= 2
    assert (robots["totals"]["driven_to_goals"] < 1.3 * np.maximum(robots["totals"]["planned"], grid.cell_size)).all()


@pytest.mark.parametrize("seed", range(100, 106))
def test_alone_it_always_arrives_on_generated_floors(seed: int) -> None:
    simulator = drive_alone(make_layout("aisles", seed=seed), 120.0)
    assert 3600 * simulator.robots["totals"]["goals"].mean() / 120.0 > 60.0


@pytest.mark.parametrize("name", ["paper46", "random"])
def test_no_decision_of_a_policy_drives_it_into_a_shelf(name: str) -> None:
    simulator = Simulator(EnvConfig(layout=name, num_agents=1, planner="astar", action_repeat=2), 24)
    simulator.reset(seed=7)
    rng = np.random.default_rng(1)
    odds = np.repeat([0.01, 0.01, 0.05, 0.13], OFFSETS)
    actions = rng.choice(20, (24, 1), p=odds)
    for _ in range(1500):
        fresh = rng.choice(20, (24, 1), p=odds)
        actions = np.where(rng.random((24, 1)) < 1 / 8, fresh, actions)
        simulator.step(actions)
    assert simulator.robots["totals"]["hits_shelf"].sum() == 0


def test_it_searches_once_in_a_while_whatever_came_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its line begins behind it, and nothing is ever found."""
    simulator = facing_back()
    steps: list[int] = []

    def seek(*_: object) -> None:
        steps.append(int(simulator.steps[0]))
        simulator.robots["manoeuvre"]["seeks"] = 0

    monkeypatch.setattr(recovery, "seek", seek)
    drive(simulator, int(simulator.cruise_action), 100)
    assert len(steps) == 5  # in 10 s
    assert set(np.diff(steps)) == {round(float(tracking.AGAIN) / simulator.config.time_step)}


def test_round_others_it_searches_the_more_rarely_the_longer_it_gets_nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    simulator = on_route(drawn(["." * 9] * 5), (2.0, 2.5, 0.0), (2.0, 2.5), (8.0, 2.5))
    seconds: list[float] = []

    def seek(*_: object) -> None:
        assert simulator.robots["manoeuvre"]["seeks"][0, 0] == AROUND_OTHERS
        seconds.append(simulator.seconds(0))
        simulator.robots["manoeuvre"]["seeks"] = 0

    monkeypatch.setattr(recovery, "seek", seek)
    for _ in range(1000):  # another holds it where it is
        simulator.robots["clocks"]["contact_time"] = tracking.HELD + 1
        simulator.robots["motion"]["speed"] = 0.0
        simulator.robots["motion"]["x"] = 2.0
        drive(simulator, int(simulator.cruise_action), 1)
    gaps = np.diff(seconds)
    assert len(gaps) >= 2
    np.testing.assert_allclose(gaps, float(tracking.AGAIN_HELD) + np.array(seconds[:-1]), atol=0.35)


@pytest.mark.parametrize("clear", [True, False])
def test_without_a_shield_it_goes_around_a_robot_that_its_manoeuvre_does_not_heed(clear: bool) -> None:
    """It turns round in a wide room; after HELD seconds of standing in its manoeuvre, another counts that is near."""
    grid = room(12, 24)
    simulator = stage(grid, (12.0, 6.0, math.pi), (3.0 if clear else 11.0, 4.9, 0.0), action_type="discrete")
    lay(simulator, (12.0, 6.0), (22.0, 6.0))
    go, stop = np.array([[int(simulator.cruise_action), STOP]]), np.full((1, 2), STOP)
    for actions, steps in ((go, 2), (stop, 30), (go, 1)):
        before = simulator.arcs[0, 0].copy()
        for _ in range(steps):
            simulator.step(actions)
    around, r = simulator.arcs[0, 0], simulator.robots[0, 0]
    assert r["manoeuvre"]["arcs"] > 0
    assert (around == before).all() == clear
    assert (r["manoeuvre"]["search_wait"] == tracking.AGAIN) == clear


@pytest.mark.parametrize("field", ["alive", "arrived"])
def test_parked_and_rerouted_robots_do_not_search(field: str) -> None:
    simulator = facing_back()
    for asks, found in ((False, False), (True, True)):
        simulator.robots["manoeuvre"]["seeks"] = ALONE
        field_of(simulator.robots, field)[...] = asks if field == "alive" else not asks
        scratch = simulator._scratch.search
        recovery.seek(0, 1, simulator.worlds, simulator.search_setup, scratch, None)
        assert bool(simulator.robots["manoeuvre"]["arcs"][0, 0] > 0) == found
        assert simulator.robots["manoeuvre"]["seeks"][0, 0] == 0


def test_quick_searches_come_in_rounds_and_end_early() -> None:
    """Where it must turn round; on a GPU all worlds wait for the longest search."""
    for quick in (False, True):
        simulator = facing_back(quick_searches=quick)
        for steps in (9, 10):
            simulator.robots["manoeuvre"]["seeks"] = ALONE
            simulator.worlds.steps[0] = steps
            recovery.seek(0, 1, simulator.worlds, simulator.search_setup, simulator._scratch.search, None)
            manoeuvre = simulator.robots["manoeuvre"][0, 0]
            assert (manoeuvre["seeks"] == 0, manoeuvre["arcs"] > 0) == (steps == 10 or not quick, not quick)
