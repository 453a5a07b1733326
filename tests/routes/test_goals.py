"""Goals as poses: which way robots face at endpoints, worked out by hand, and routes that end there."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.simulation.worlds import drawn
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.maps.layouts import LAYOUTS, make_layout
from warehouse_env.planning import make_planner
from warehouse_env.routes.book import RouteBook
from warehouse_env.routes.goals import Goal, face, facing
from warehouse_env.simulation.physics.floor import floor_of
from warehouse_env.simulation.physics.footprint import body_touches_shelf
from warehouse_env.simulation.physics.geometry import body_of, grown
from warehouse_env.simulation.state import parameters_of

ROBOT = RobotSpec()
FLOOR = drawn(["......", ".###..", "......", "......", "......"])


def test_beside_a_shelf_robots_stand_in_parallel_either_way_round() -> None:
    goal = face(FLOOR, (2, 2), ROBOT)  # south of the shelf, whose row is y = 3 to 4
    # the axle is 0.3 m ahead of the body's middle, which is the cell's: (2.5, 2.5)
    assert goal.poses == (pytest.approx((2.8, 2.5, 0.0)), pytest.approx((2.2, 2.5, -math.pi)))
    goal = face(FLOOR, (1, 4), ROBOT)  # east of it
    assert goal.poses == (pytest.approx((4.5, 3.8, math.pi / 2)), pytest.approx((4.5, 3.2, -math.pi / 2)))


def test_on_open_floor_and_in_dead_ends_they_face_where_they_can() -> None:
    assert face(FLOOR, (3, 3), ROBOT) == Goal((3, 3))
    # in a dead end they stand along it, though its end is beside them, too
    heads = [heading for _, _, heading in face(drawn(["####", "#...", "####"]), (1, 1), ROBOT).poses]
    assert heads == pytest.approx([0.0, -math.pi])


def test_who_comes_along_faces_on() -> None:
    poses = face(FLOOR, (2, 2), ROBOT).poses
    assert facing(poses, np.array([(2, 5), (2, 4), (2, 3), (2, 2)]))[2] == pytest.approx(-math.pi)
    assert facing(poses, np.array([(2, 0), (2, 1), (2, 2)]))[2] == 0.0
    assert facing(poses, np.array([(4, 2), (3, 2), (2, 2)]))[2] == 0.0  # across: the first
    assert facing(poses, np.array([(2, 2)]))[2] == 0.0


def test_a_route_ends_at_the_pose_that_it_leads_to() -> None:
    book = RouteBook(FLOOR, make_planner("astar"))
    poses = face(FLOOR, (2, 2), ROBOT).poses
    there = book.route((2, 5), (2, 2), ends=poses)
    assert there.end == poses[1]
    np.testing.assert_allclose(there.line[-1], poses[1][:2], atol=1e-6)
    plain = book.route((2, 5), (2, 2))
    assert plain.end is None
    np.testing.assert_array_equal(plain.line[-1], np.array([2.5, 2.5], np.float32))
    assert book.route((2, 5), (2, 2), ends=poses) is there


@pytest.mark.parametrize("name", LAYOUTS)
def test_bodies_at_all_endpoints_are_off_the_shelves(name: str) -> None:
    grid, config = make_layout(name), EnvConfig()
    p, floor = parameters_of(config, grid.cell_size)[0], floor_of(grid, 1.0)
    many = 0
    for cell in grid.endpoints[2]:
        for x, y, heading in face(grid, cell, ROBOT).poses:
            many += 1
            c, s = np.float32(math.cos(heading)), np.float32(math.sin(heading))
            body = grown(body_of(np.float32(x), np.float32(y), c, s, p), np.float32(0.03))
            assert not body_touches_shelf(body, floor)
    assert many > 0 or name == "open"
