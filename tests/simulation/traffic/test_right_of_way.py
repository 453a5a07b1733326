"""Right of way: who is granted which stretch of its path, and that nobody then touches anybody."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.simulation.reference import separation
from tests.simulation.rights import World, rectangles
from tests.simulation.worlds import drawn, write
from warehouse_env.simulation.senses.preferences import GOING, SIDE, SPEED, speed_of
from warehouse_env.simulation.traffic.reservations import TIGHT, WIDE
from warehouse_env.simulation.traffic.right_of_way import AHEAD, NOBODY, limit, rank
from warehouse_env.simulation.traffic.waits import is_urged

ROUNDING = 1e-4  # [m]


def gap(world: World, robot: int, other: int, last: int | None = None, others_last: int | None = None) -> float:
    """Least distance [m] of two robots' paths as far as the given poses; below 0: they touch."""
    one, two = rectangles(world.path(robot, last)), rectangles(world.path(other, others_last))
    return float(separation(one[:, None], two[None]).min())


def crossing(first: int, **more: Any) -> World:
    """Two that drive at 1 m/s towards the same place, 2 m before it; robot `first` is longer on its way."""
    ages = [0, 0]
    ages[first] = 100
    return World((8.0, 10.0, 0.0, 1.0), (10.0, 8.0, math.pi / 2, 1.0), ages=ages, **more)


def test_alone_a_robot_is_granted_what_it_asks_for() -> None:
    world = World((5.0, 10.0, 0.0)).decide()
    assert world.granted(0) == AHEAD
    r = world.robots[0]
    assert (r["traffic"]["yields_to"], r["traffic"]["authority"], r["traffic"]["claim"]) == (NOBODY, 1.0, 1.0)
    write(r, speed=1.0, distance=0.1)  # it stops in 0.5 m, after 0.2 s at 1 m/s: the second pose, at 0.9 m
    assert world.decide().granted(0) == 2 + AHEAD
    assert r["traffic"]["authority"] == pytest.approx(1.9, abs=ROUNDING)


@pytest.mark.parametrize("first", [0, 1])
def test_of_two_that_cross_one_waits_off_the_others_path(first: int) -> None:
    world, other = crossing(first).decide(), 1 - first
    assert world.order.tolist() == [first, other]
    assert world.robots["traffic"]["yields_to"].tolist() == [NOBODY if k == first else first for k in range(2)]
    # 2 m to the crossing, and the body, half a width and its own rear beyond it
    assert world.robots["traffic"]["authority"][first] > 2.0 + 0.3 + 0.75
    assert 0.0 < world.robots["traffic"]["authority"][other] < 2.0
    assert gap(world, other, first, last=world.granted(other)) > 0.0  # off all of the other's path


def test_nobody_waits_on_a_crossing() -> None:
    # A metre of path ends on the other's line, so that more is asked for, or less is taken.
    for distance in np.arange(0.75, 3.0, 0.125):
        world = World((10.0 - distance, 10.0, 0.0), (10.0, 7.0, math.pi / 2), ages=[9, 0]).decide()
        end = rectangles(world.path(0))[world.granted(0)][None, None]
        line = rectangles(world.path(1))[None, 1:7]
        assert float(separation(end, line).min()) > 0.0, distance


def test_a_granted_crossing_is_kept() -> None:
    world = crossing(1)
    world.robots["task"]["alive"][0] = 0  # not there yet
    world.robots["motion"]["x"][0] = 1.0
    world.decide()
    claim = float(world.robots["traffic"]["claim"][1])
    world.robots["task"]["alive"][0], world.robots["motion"]["x"][0] = 1, 8.0
    world.robots["task"]["age"][0] = 1000  # it goes first, but what is granted stays
    world.decide()
    assert world.order.tolist() == [0, 1]
    assert world.robots["traffic"]["claim"][1] >= claim
    assert world.robots["traffic"]["yields_to"].tolist() == [1, NOBODY]


def test_what_is_granted_is_lost_to_one_that_cannot_stop() -> None:
    world = World((9.0, 10.0, 0.0), (10.0, 9.0, math.pi / 2), ages=[0, 100])
    world.robots["task"]["alive"][0] = 0
    world.robots["motion"]["x"][0] = 1.0
    world.decide()
    before = world.robots["traffic"]["authority"][1]
    assert before >= 1.0
    world.robots["task"]["alive"][0], world.robots["motion"]["x"][0], world.robots["motion"]["speed"][0] = 1, 9.0, 1.5
    world.robots["task"]["age"][0] = 1000
    world.decide()
    assert world.robots["traffic"]["authority"][0] >= 1.5**2 / 2 + 0.2 * 1.5
    assert world.robots["traffic"]["authority"][1] < before
    assert world.robots["traffic"]["yields_to"][1] == 0


def test_of_two_head_on_the_later_one_takes_another_side() -> None:
    world = World((5.0, 10.0, 0.0, 1.0), (11.6, 10.0, math.pi, 1.0), ages=[9, 0]).decide()
    assert world.robots["traffic"]["side"].tolist() == [0.0, np.float32(-1.2)]  # 0.6 m are too few for two bodies
    assert world.robots["traffic"]["yields_to"].tolist() == [NOBODY, NOBODY]
    assert gap(world, 1, 0, world.granted(1), world.granted(0)) > 2 * WIDE - ROUNDING


@pytest.mark.parametrize("liked", [1.2, -1.2])
def test_sides_are_tried_in_the_order_of_preference(liked: float) -> None:
    table = World((5.0, 10.0, 0.0)).simulator.actions.table
    preferences = np.zeros((1, 2, len(table)), np.float32)
    preferences[0, :, np.flatnonzero((table == (1.5, 0.0)).all(axis=1))] = 3.0
    preferences[0, :, np.flatnonzero((table == np.array((0.5, liked), np.float32)).all(axis=1))] = 2.0
    world = World((5.0, 10.0, 0.0, 1.0), (11.6, 10.0, math.pi, 1.0), ages=[9, 0]).decide(preferences)
    assert world.robots["traffic"]["side"][1] == np.float32(liked)
    assert world.simulator._commands[0, 0, :, 0].tolist() == [1.5, 0.5]  # the speed that it likes there


def test_the_liked_side_is_taken_back_when_it_is_free() -> None:
    world = World((5.0, 10.0, 0.0, 1.0), (11.6, 10.0, math.pi, 1.0), ages=[9, 0]).decide()
    world.robots["motion"]["x"][0], world.robots["on_route"]["points"][0] = 20.0, 1
    assert world.decide().robots["traffic"]["side"][1] == 0.0


def test_behind_one_that_drives_the_same_way_nobody_changes_sides() -> None:
    world = World((5.0, 10.0, 0.0, 1.0), (7.0, 10.0, 0.0, 1.0), ages=[0, 9]).decide()
    assert world.robots["traffic"]["side"].tolist() == [0.0, 0.0]
    assert gap(world, 0, 1, world.granted(0), 0) > 0


def test_a_blocking_robot_inherits_the_right() -> None:
    world = World(*((2.0 + 4 * k, 10.0, 0.0) for k in range(5)), ages=[9, 3, 1, 7, 5])
    world.robots["traffic"]["yields_to"] = [1, 2, NOBODY, NOBODY, 3]
    rank(world.robots, world.order)
    assert world.robots["traffic"]["right"].tolist() == [9, 9, 9, 7, 5]
    assert world.order.tolist() == [0, 1, 2, 3, 4]
    world.robots["traffic"]["yields_to"] = [1, 2, 0, NOBODY, NOBODY]  # a wait cycle: the inheritance ends
    rank(world.robots, world.order)
    assert world.robots["traffic"]["right"].tolist() == [9, 9, 9, 7, 5]


def test_a_vetoed_robot_waits_for_the_robot_that_vetoes_it() -> None:
    world = World((5.0, 10.0, 0.0), (5.0, 18.0, 0.0))
    world.robots["shield"]["vetoed_by"][0], world.robots["shield"]["vetoed_time"][0] = 1, 1.0
    assert world.decide().robots["traffic"]["yields_to"].tolist() == [1, NOBODY]
    # ... and the step asks before it forgets who held whom
    sim = world.simulator
    sim.step(np.zeros((1, 2, 20), np.float32))
    assert sim.robots["traffic"]["yields_to"][0, 0] == 1


places = st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=2, max_size=8, unique=True)


@settings(max_examples=40)
@given(places=places, data=st.data())
def test_no_two_are_granted_poses_that_touch(places: list[tuple[int, int]], data: st.DataObject) -> None:
    turns = [data.draw(st.integers(0, 15)) for _ in places]
    speeds = [data.draw(st.sampled_from([0.0, 0.0, 0.5, 1.5])) for _ in places]
    poses = [(8 + 1.6 * x, 8 + 1.6 * y, k * math.pi / 8, v) for (x, y), k, v in zip(places, turns, speeds, strict=True)]
    world = World(*poses, ages=[data.draw(st.integers(0, 50)) for _ in places])
    for _ in range(4):
        world.decide()
        for i in range(len(places)):
            for j in range(len(places)):
                mine, theirs = rectangles(world.path(i, world.granted(i)), TIGHT)[1:], world.path(j, world.granted(j))
                if i != j and len(mine):
                    assert float(separation(mine[:, None], rectangles(theirs, TIGHT)[None]).min()) > -ROUNDING
        for i in range(len(places)):
            world.drive(i, data.draw(st.integers(0, min(world.granted(i), 2))))


@settings(max_examples=50)
@given(speed=st.floats(0.0, 1.5), more=st.floats(0.0, 2.0), wanted=st.floats(0.0, 1.5))
def test_within_its_limit_a_robot_stops_before_its_authority_ends(speed: float, more: float, wanted: float) -> None:
    world = World((5.0, 10.0, 0.0))
    r, p = world.robots[0], world.simulator._params[0]
    left = speed * speed / 2 + 0.2 * speed + more  # whatever it is granted, it could stop before that
    for _ in range(40):  # decisions of two physics steps, nothing more being granted
        r["traffic"]["authority"] = left
        for _ in range(2):
            target = float(limit(r, np.float32(wanted), p))
            speed = max(min(target, speed + 0.1), speed - 0.1)
            left -= 0.1 * speed
    assert left > -0.005  # the last decision is rounded to physics steps; WIDE is sixteen times that


def test_a_robot_that_has_stood_for_long_is_urged_to_go() -> None:
    r = World((5.0, 10.0, 0.0)).robots[0]
    choices = np.array([(0.6, 0.0, 0.5), (0.0, -0.4, 1.5)], np.float32)
    assert [SIDE, SPEED, GOING] == [0, 1, 2]
    r["traffic"]["side"], r["traffic"]["authority"] = 0.0, 1.0
    assert speed_of(r, choices, np.float32(0.0), is_urged(r)) == np.float32(-0.4)
    r["clocks"]["standing_time"] = 2.0
    assert speed_of(r, choices, np.float32(0.0), is_urged(r)) == 1.5
    r["traffic"]["authority"] = 0.0
    assert speed_of(r, choices, np.float32(0.0), is_urged(r)) == np.float32(-0.4)
    r["traffic"]["side"] = -1.2  # from a decision before; not among what is offered now
    assert speed_of(r, choices, np.float32(0.7), is_urged(r)) == np.float32(0.7)


def test_the_first_of_two_robots_that_end_on_each_others_paths_reaches_its_goal() -> None:
    """Nobody need not wait at its goal: it goes on from there."""
    world = World((9.25, 10.0, 0.0), (10.0, 9.25, math.pi / 2), ages=[9, 0], length=1.0).decide()
    assert world.robots["traffic"]["yields_to"].tolist() == [NOBODY, 0]
    assert world.robots["traffic"]["authority"][0] == math.inf
    assert world.robots["traffic"]["side"][0] == 0.0  # straight there, not beside it


@pytest.mark.parametrize(("x", "walks", "ends"), [(11.6, 0.0, 11.6), (20.0, 0.0, 20.0), (12.8, -1.0, 11.6)])
def test_a_grant_ends_before_a_person_and_where_one_is_about_to_walk(x: float, walks: float, ends: float) -> None:
    """A person is .25 m wide to each side; .4 m stay free before it, and poses are at most .5 m apart."""
    world = World((10.0, 10.0, 0.0, 0.5), people=1)
    person = world.simulator.people.persons[0, 0]
    person["x"], person["y"], person["cos"], person["rest"] = x, 10.0, walks, 0.0 if walks else 5.0
    world.decide()
    front = float(world.path(0, world.granted(0))[-1, 0]) + 0.45  # of the body, whose centre the path has
    free = ends - 0.25 - 0.4
    assert front <= max(free, 10.15) + 1e-3
    assert front > min(free, 11.0) - 0.5


def test_a_robot_beside_a_person_may_drive_away() -> None:
    world = World((10.0, 10.0, 0.0, 0.0), people=1)
    person = world.simulator.people.persons[0, 0]
    person["x"], person["y"], person["rest"] = 9.1, 10.0, 5.0  # a hand behind the body, which ends at 9.25
    assert world.decide().granted(0) > 0


@pytest.mark.parametrize(
    ("kept", "other", "waits_for"),
    [(1.4, 12.0, [NOBODY, NOBODY]), (1.6, 12.0, [1, 0]), (3.1, 12.0, [0, 1]), (1.6, 20.0, [0, NOBODY])],
)
def test_a_robot_that_shuts_a_person_in_waits_for_the_other_then_for_itself(
    kept: float, other: float, waits_for: list[int]
) -> None:
    """Two face each other in an aisle with a person between, or one faces it alone; their own paths do not meet."""
    aisle = drawn(["#" * 24, "." * 24, "#" * 24])
    world = World((10.0, 1.5, 0.0), (other, 1.5, math.pi), grid=aisle, length=1.0, people=1)
    person = world.simulator.people.persons[0, 0]
    person["x"], person["y"], person["kept"], person["blocked"] = 11.0, 1.5, kept, 1.5
    assert world.decide().robots["traffic"]["yields_to"].tolist() == waits_for
