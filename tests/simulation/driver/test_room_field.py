"""How far it is off others' paths for a disc as wide as the body, by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.simulation.driver.test_manoeuvre import (
    NOBODY,
    PARAMETERS,
    SCRATCH,
    around,
    body,
    driven,
    plan,
    rectangles,
    sized,
)
from tests.simulation.worlds import drawn, room
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.driver.bodies import CENTRE_X, CENTRE_Y, COS
from warehouse_env.simulation.driver.manoeuvre import ARCS
from warehouse_env.simulation.driver.room_field import (
    BARRED,
    UNKNOWN,
    apart_of,
    room_at,
    write_room,
    write_way,
)
from warehouse_env.simulation.driver.scratch import BODY, POINTS
from warehouse_env.simulation.physics.geometry import pose_at

MIDDLE = POINTS // 2
APART = np.float32(apart_of(PARAMETERS[0]))
STEP = 0.2
ROUNDING = 1e-4
AISLE = drawn(["#" * 12, "." * 12, "#" * 12])
BENT = drawn(["#" * 12, "#......#####", "######.#####", "######.#####", "######.....#", "#" * 12])


def field(
    grid: GridMap,
    centre: tuple[float, float],
    avoid: NDArray[np.float32] = NOBODY,
    bodies: NDArray[np.float32] = NOBODY,
    parameters: NDArray[np.void] = PARAMETERS,
) -> NDArray[np.float32]:
    """The field around a body that heads east and has its centre there."""
    x, y = np.float32(centre[0] + parameters[0]["offset"]), np.float32(centre[1])
    write_room(pose_at(x, y, np.float32(0.0)), around(grid, avoid, bodies, parameters), SCRATCH)
    return SCRATCH.room.copy()


def centred(*poses: tuple[float, float, float]) -> NDArray[np.float32]:
    """Bodies of the default size with their centres there."""
    return np.array([sized((x, y, math.cos(turn), math.sin(turn))) for x, y, turn in poses], np.float32)


def along(x: float, y: float, count: int) -> NDArray[np.float32]:
    """A path east, from there on."""
    return centred(*((x + 0.25 * k, y, 0.0) for k in range(count)))


def at(found: NDArray[np.float32], dx: float, dy: float) -> float:
    """How far it is from so many metres east and north of the middle."""
    return float(found[MIDDLE + round(dy / STEP), MIDDLE + round(dx / STEP)])


def test_beside_a_path_it_is_as_far_as_two_half_widths_and_what_is_kept_off() -> None:
    """0.3 + 0.3 + 0.2 m from the middle of it; the disc on a point is smaller by 0.14."""
    found = field(room(20, 20), (10.0, 10.0), along(0.5, 10.0, 80))
    assert at(found, 0, 0) == pytest.approx(0.8, abs=ROUNDING)
    assert at(found, 0, 0.6) == at(found, 0, -0.6) == pytest.approx(0.2, abs=ROUNDING)
    assert at(found, 3, 0.8) == 0.0


def test_in_an_aisle_it_is_as_far_as_its_mouth_round_the_corner() -> None:
    path = np.concatenate([along(1.5, 4.5, 21), centred(*((6.5, 4.5 - 0.25 * k, 1.57) for k in range(13)))])
    found = field(BENT, (2.5, 4.5), path)
    # 4 m east and 3 m south along the path, then 0.8 m off it to the east; the corners may be cut by a metre
    assert 7.8 - 2.0 < at(found, 0, 0) < 7.8
    assert at(found, 2, 0) == pytest.approx(at(found, 0, 0) - 2.0, abs=ROUNDING)
    assert at(found, 0, 1) == BARRED  # a shelf


def test_bodies_bar_the_way() -> None:
    path, west, east = along(4.0, 1.5, 20), (4.5, 1.5, 0.0), (8.5, 1.5, 0.0)
    free = field(AISLE, (6.0, 1.5), path)
    # the first body of the path reaches west to 3.55, and the disc is off from 0.5 m less 0.14 before that on
    assert at(free, 0, 0) == pytest.approx(6.0 - 3.0, abs=ROUNDING)
    barred = field(AISLE, (6.0, 1.5), path, centred(west))
    assert at(barred, 0, 0) == pytest.approx(9.6 - 6.0, abs=ROUNDING)  # out by the other end
    assert at(barred, -1.6, 0) == BARRED
    assert at(field(AISLE, (6.0, 1.5), path, centred(west, east)), 0, 0) == UNKNOWN


def test_beyond_the_rim_there_may_be_room() -> None:
    grid, rim = drawn(["#" * 40, "." * 40, "#" * 40]), MIDDLE * STEP
    found = field(grid, (20.0, 1.5), along(0.5, 1.5, 160))
    assert at(found, 0, 0) == pytest.approx(rim, abs=ROUNDING)
    assert at(found, 3, 0) == pytest.approx(rim - 3.0, abs=ROUNDING)
    x0, y0 = np.float32(20.0), np.float32(1.5)
    assert room_at(np.float32(20.0 + rim + 0.1), y0, x0, y0, found, APART) == 0.0
    assert room_at(np.float32(22.9), np.float32(1.45), x0, y0, found, APART) == pytest.approx(rim - 3.0, abs=ROUNDING)


@pytest.mark.parametrize("seed", range(4))
def test_no_manoeuvre_off_a_path_is_shorter(seed: int) -> None:
    """What the exact body drives is no shorter than the field says, but for 8%, and ends where that is 0."""
    rng, planned = np.random.default_rng(seed), 0
    for _ in range(25):
        shelves = rng.random((14, 14)) < 0.12
        shelves[5:9, 5:9] = False
        grid, heading = GridMap(shelves), rng.uniform(-math.pi, math.pi)
        pose = (*rng.uniform(6.2, 7.8, 2), heading)
        ways = np.arange(-2.0, 2.0, 0.25)[:, None] * [math.cos(heading), math.sin(heading), 0.0]
        avoid = rectangles(*(np.array(pose) + ways))
        bodies = rectangles(*((x, y, turn) for x, y, turn in rng.uniform((4, 4, -3), (10, 10, 3), (2, 3))))
        bodies = bodies[np.hypot(bodies[:, CENTRE_X] - pose[0], bodies[:, CENTRE_Y] - pose[1]) > 1.5]
        arcs = plan(grid, pose, avoid=avoid, bodies=bodies)
        if arcs is None or len(arcs) in (0, ARCS):
            continue
        planned += 1
        values = [np.float32(value) for value in pose]
        write_room(pose_at(*values), around(grid, avoid, bodies), SCRATCH)
        found = SCRATCH.room
        centres = np.array([body(each)[:2] for each in driven(pose, arcs)], np.float32)
        says = np.array([room_at(x, y, *centres[0], found, APART) for x, y in centres])
        assert says[-1] == 0.0
        to_go = np.append(np.hypot(*np.diff(centres, axis=0).T)[::-1].cumsum()[::-1], 0.0)
        assert (says <= to_go / math.cos(math.pi / 8) + ROUNDING).all()
    assert planned > 10


def way_of(grid: GridMap, centre: tuple[float, float], avoid: NDArray[np.float32], most: int = 16) -> Any:
    way = np.zeros((most, BODY), np.float32)
    found = field(grid, centre, avoid)
    return way[: write_way(np.float32(centre[0]), np.float32(centre[1]), found, PARAMETERS[0], way)]


def test_the_way_out_follows_a_bend() -> None:
    path = np.concatenate([along(1.5, 4.5, 21), centred(*((6.5, 4.5 - 0.25 * k, 1.57) for k in range(13)))])
    way = way_of(BENT, (2.5, 4.5), path)
    assert way[0, :2] == pytest.approx((2.9, 4.5), abs=STEP + ROUNDING)  # at once towards the inner side of the bend
    assert way[0, COS] > 0.7
    x, y = way[:, CENTRE_X], way[:, CENTRE_Y]
    assert ((y > 4.0) | ((x > 6.0) & (x < 7.0)) | (y < 2.0)).all()  # within the passage
    assert (np.hypot(np.diff(x), np.diff(y)) < 2 * math.sqrt(2) * STEP + ROUNDING).all()
    assert y[-1] < 2.4
    assert way_of(BENT, (2.5, 4.5), path, 3) == pytest.approx(way[:3])
