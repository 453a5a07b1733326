"""Paths ahead: poses at half metres of the odometer, and where paths meet, each pose held against every other."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.simulation.reference import OFFSET, separation
from tests.simulation.rights import World, rectangles
from tests.simulation.worlds import give_line, write
from warehouse_env.simulation.driver.driving import begin
from warehouse_env.simulation.state import field_of
from warehouse_env.simulation.traffic import reservations
from warehouse_env.simulation.traffic.path_ahead import CENTRE_X, CENTRE_Y, COLUMNS, COS, DRIVEN, POSES, SIN, write_path


def ahead(world: World, side: float = 0.0) -> tuple[NDArray[np.float32], bool]:
    """The path of the first robot, and whether it ends at the goal."""
    sim, path = world.simulator, np.zeros((POSES, COLUMNS), np.float32)
    own = (world.robots[0], sim.routes[0, 0], sim.arcs[0, 0])
    count, at_end = write_path(*own, np.float32(side), POSES, sim._params[0], sim._floor, path)
    return path[:count], bool(at_end)


@given(distance=st.floats(0.0, 50.0))
def test_the_first_pose_is_the_next_half_metre_of_the_odometer(distance: float) -> None:
    world = World((2.0, 12.0, 0.0), length=20.0)
    world.robots["totals"]["distance"] = distance
    path, at_end = ahead(world)
    assert len(path) == POSES
    assert not at_end
    first = (math.floor(distance / 0.5) + 1) * 0.5 - distance
    np.testing.assert_allclose(path[1:, DRIVEN], first + 0.5 * np.arange(POSES - 1), atol=1e-4)
    np.testing.assert_allclose(path[:, CENTRE_X], 2.0 - OFFSET + path[:, DRIVEN], atol=1e-4)
    np.testing.assert_allclose(path[:, [CENTRE_Y, COS, SIN]], [[12.0, 1.0, 0.0]] * POSES, atol=1e-4)


@pytest.mark.parametrize("driven", [0.03, 0.12, 0.2, 0.37, 0.49, 0.5, 0.9])
def test_poses_do_not_move_while_the_robot_drives(driven: float) -> None:
    world = World((2.0, 12.0, 0.0), length=20.0)
    world.robots["totals"]["distance"] = 0.03
    before, _ = ahead(world)
    world.robots["motion"]["x"] += np.float32(driven)
    world.robots["on_route"]["position"] = driven
    world.robots["totals"]["distance"] += driven
    after, _ = ahead(world)
    passed = int((0.03 + driven) / 0.5)
    np.testing.assert_allclose(after[1 : POSES - passed, :4], before[1 + passed :, :4], atol=1e-4)


def decided(world: World) -> NDArray[np.float32]:
    """The path of the first robot that the decision goes by, which may have been kept."""
    return world.decide().path(0)


def drive(world: World, metres: float) -> None:
    """Move the first robot along the x axis, which its route follows."""
    world.robots["motion"]["x"][0] += np.float32(metres)
    world.robots["totals"]["distance"][0] += metres
    world.robots["on_route"]["position"][0] += np.float32(metres)


def test_a_path_is_kept_for_two_metres_and_then_written_anew() -> None:
    world = World((2.0, 12.0, 0.0), length=20.0)
    before, numbers = decided(world), []
    for k in range(1, 9):
        drive(world, 0.3)
        kept, fresh = decided(world), ahead(world)[0]
        np.testing.assert_allclose(kept[:, :], fresh[: len(kept)], atol=1e-4)
        numbers.append(len(kept))
        passed = int(0.3 * k / 0.5 + 1e-6)
        assert len(kept) in (len(before) - passed, POSES)
    assert numbers == [32, 31, 31, 30, 29, 29, 32, 32]


@pytest.mark.parametrize(("field", "value"), [("y", 12.3), ("heading", 0.6), ("x", 5.0)])
def test_a_robot_off_its_path_gets_another(field: str, value: float) -> None:
    world = World((2.0, 12.0, 0.0), length=20.0)
    decided(world)
    drive(world, 0.6)
    field_of(world.robots, field)[0] = value
    heading = world.robots["motion"]["heading"]
    world.robots["motion"]["cos"], world.robots["motion"]["sin"] = np.cos(heading), np.sin(heading)
    np.testing.assert_array_equal(decided(world), ahead(world)[0])


def test_another_route_or_manoeuvre_is_another_path() -> None:
    world = World((2.0, 12.0, 0.0), length=20.0)
    decided(world)
    points = np.array([2.0, 12.0]) + np.arange(0.0, 8.0, 0.25)[:, None] * [0.0, 1.0]
    give_line(world.simulator, 0, points)
    np.testing.assert_array_equal(decided(world), ahead(world)[0])
    assert world.path(0)[-1, CENTRE_Y] > 15.0
    arcs = world.simulator.arcs[0, 0]
    arcs[0] = -1.0, 0.0
    begin(world.robots[0], 1, arcs, np.float32(0.03))
    np.testing.assert_array_equal(decided(world), ahead(world)[0])
    assert world.path(0)[1, CENTRE_X] < 2.0


def test_a_path_ends_at_the_goal() -> None:
    path, at_end = ahead(World((2.0, 12.0, 0.0), length=3.0))
    assert at_end
    assert path[:, DRIVEN].tolist() == [0.0, 0.5, 1.0, 1.5, 2.0, 2.5]  # 0.3 m before its end it is over


@pytest.mark.parametrize("side", [0.6, -1.2])
def test_a_path_beside_the_route_comes_to_its_offset(side: float) -> None:
    path, _ = ahead(World((2.0, 12.0, 0.0), length=20.0), side)
    assert path[0, CENTRE_Y] == 12.0
    np.testing.assert_allclose(path[-6:, CENTRE_Y], 12.0 + side, atol=0.02)


def test_the_end_of_each_arc_of_a_manoeuvre_is_a_pose_of_its_own() -> None:
    world = World((2.0, 12.0, 0.0), length=20.0)
    r = world.robots[0]
    world.simulator.arcs[0, 0, :2] = [(0.7, 0.0), (-0.45, 0.0)]
    write(r, arcs=2, retreating=1, distance=0.125, arc_x=2.0, arc_y=12.0, arc_left=0.7)
    path, at_end = ahead(world)
    assert not at_end
    # 0.5 and 1.0 on the odometer, the first end after 0.7 m, the second after 1.15 m
    np.testing.assert_allclose(path[:, DRIVEN], [0.0, 0.375, 0.7, 0.875, 1.15], atol=1e-5)
    np.testing.assert_allclose(path[:, CENTRE_X] + OFFSET, [2.0, 2.375, 2.7, 2.525, 2.25], atol=1e-5)

    r["traffic"]["retreating"] = 0  # back to the route: from there on half metres of the odometer again
    path, _ = ahead(world)
    np.testing.assert_allclose(path[:7, DRIVEN], [0.0, 0.375, 0.7, 0.875, 1.15, 1.375, 1.875], atol=1e-5)


def test_a_parked_robot_and_one_without_a_route_stay() -> None:
    world = World((2.0, 12.0, 0.0))
    world.robots["task"]["alive"] = 0
    assert len(ahead(world)[0]) == 1
    world.robots["task"]["alive"], world.robots["on_route"]["points"] = 1, 1
    assert len(ahead(world)[0]) == 1


PARAMETERS = World((5.0, 5.0, 0.0)).simulator._params[0]
CLOSE = 1e-4  # [m] within which rounding may decide
poses = st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-3.1, 3.1))
paths = st.lists(st.lists(poses, min_size=1, max_size=POSES), min_size=2, max_size=5)


def near(k: int, m: int) -> bool:
    """Whether two poses are so near in time that they are held against each other with TIGHT room alone."""
    return k == 0 or m == 0 or (k <= reservations.NEARBY and m <= reservations.NEARBY)


@settings(max_examples=60)
@given(drawn=paths, data=st.data())
def test_all_poses_that_touch_are_found_and_no_others(
    drawn: list[list[tuple[float, float, float]]], data: st.DataObject
) -> None:
    kept = np.zeros((len(drawn) + 1, POSES, 5), np.float32)
    for path, given_poses in zip(kept, drawn, strict=False):
        for pose, (x, y, heading) in zip(path, given_poses, strict=False):
            pose[:4] = x, y, np.cos(heading), np.sin(heading)
    table = reservations.ReservationTable(kept, *reservations.scratch(len(kept) - 1))
    table.numbers[reservations.COUNT, :-1] = [len(path) for path in drawn]
    reservations.enlist(table, PARAMETERS)
    mine = data.draw(st.integers(0, len(drawn) - 1))
    last = data.draw(st.integers(0, len(drawn[mine]) - 1))
    count = reservations.meet(mine, mine, last, table, PARAMETERS, None)
    masks, met = table.masks, table.numbers[reservations.WHO, :count].tolist()
    assert len(set(met)) == count
    for other in range(len(drawn)):
        if other == mine:
            assert other not in met
            continue
        own, theirs = kept[mine, : last + 1], kept[other, : len(drawn[other])]
        wide = separation(rectangles(own, reservations.WIDE)[:, None], rectangles(theirs, reservations.WIDE)[None])
        tight = separation(rectangles(own, reservations.TIGHT)[:, None], rectangles(theirs, reservations.TIGHT)[None])
        across = own[:, [COS, SIN]] @ theirs[:, [COS, SIN]].T
        for k in range(last + 1):
            for m in range(len(theirs)):
                touch = (tight if near(k, m) else wide)[k, m]
                if abs(touch) < CLOSE or abs(tight[k, m]) < CLOSE or abs(across[k, m] - 0.5) < CLOSE:
                    continue
                if other not in met:
                    assert touch > 0
                    continue
                bits = [
                    bool(masks[which, met.index(other), k] >> m & 1)
                    for which in (reservations.TOUCH_WIDE, reservations.TOUCH_TIGHT, reservations.CROSS)
                ]
                assert bits == [touch < 0, tight[k, m] < 0, bool(touch < 0 and across[k, m] < 0.5)], (other, k, m)


def test_floors_larger_than_the_squares_go_on_from_the_first() -> None:
    kept = np.zeros((3, POSES, 5), np.float32)
    kept[:, :, COS] = 1.0
    kept[0, 0, :2], kept[1, 0, :2] = (200.0, 300.0), (200.5, 300.0)
    table = reservations.ReservationTable(kept, *reservations.scratch(len(kept) - 1))
    table.numbers[reservations.COUNT, :-1] = 1
    reservations.enlist(table, PARAMETERS)
    assert reservations.meet(0, 0, 0, table, PARAMETERS, None) == 1
    kept[1, 0, :2] = 200.0 + 64 * 2.0, 300.0
    reservations.enlist(table, PARAMETERS)
    assert reservations.meet(0, 0, 0, table, PARAMETERS, None) == 0
