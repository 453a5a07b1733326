"""Test the pixels of shelves, footprints, headings, goals, routes and contacts."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.colours import CONTACT, DEADLOCK, ORANGE, WAITING, name_colours, robot_colour
from warehouse_env.render.floor import floor_image
from warehouse_env.render.frame import Scene, draw, scene_of

SCALE = 40


def at(frame: NDArray[np.uint8], x: float, y: float, scale: float = SCALE, top: float = 10.0) -> NDArray[np.int64]:
    """Return the pixel at a point [m]."""
    return frame[int((top - y) * scale), int(x * scale)].astype(np.int64)


def changed(frame: NDArray[np.uint8], scene: Scene, scale: float = SCALE) -> NDArray[np.bool_]:
    """Return where a frame differs clearly from the empty floor."""
    floor = floor_image(scene.grid, scale)
    difference = np.abs(frame[: len(floor)].astype(np.int64) - floor).sum(axis=-1)
    result: NDArray[np.bool_] = difference > 25
    return result


def without_goals(scene: Scene) -> Scene:
    """Move the goals into a far corner."""
    return scene._replace(goal=np.tile(np.array([[0, 13]]), (len(scene.pose), 1)))


def test_north_is_at_the_top(grid: GridMap) -> None:
    image = floor_image(grid, float(SCALE)).astype(np.int64)
    occupied = np.zeros(grid.shape, dtype=np.bool_)
    for row in range(10):
        for column in range(14):
            x, y = grid.centre(np.array([row, column]))
            occupied[row, column] = at(image, x + 0.2, y + 0.2).mean() < 210
    assert np.array_equal(occupied, grid.occupied)


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, 2.0, -2.6])
def test_footprint_covers_its_rectangle(make_scene: Callable[..., Scene], heading: float) -> None:
    x, y = 8.0, 4.0
    scene = without_goals(make_scene((x, y, heading)))
    mask = changed(draw(scene, SCALE), scene)
    rows, columns = np.mgrid[: mask.shape[0], : mask.shape[1]]
    east, north = (columns + 0.5) / SCALE - x, 10 - (rows + 0.5) / SCALE - y
    ahead = east * math.cos(heading) + north * math.sin(heading)
    left = -east * math.sin(heading) + north * math.cos(heading)
    # Signed distance to the rectangle's sides [m]: 0.15 ahead of the axle, 0.75 behind, 0.3 to either side.
    outside = np.maximum(np.maximum(ahead - 0.15, -0.75 - ahead), np.abs(left) - 0.3)
    near = np.hypot(east, north) < 1.5
    assert mask[(outside < -0.06) & near].mean() > 0.99  # the white mark's soft edge may look like the floor
    assert not mask[(outside > 0.12) & near].any()  # a soft shadow may remain


def test_contact_is_red(make_scene: Callable[..., Scene]) -> None:
    free = draw(make_scene((8.0, 4.0, 0.0)), SCALE)
    hit = draw(make_scene((8.0, 4.0, 0.0), touching=np.array([True])), SCALE)
    assert not (free == np.array(CONTACT)).all(axis=-1).any()
    assert (hit == np.array(CONTACT)).all(axis=-1).any()


def test_waiting_robots_have_a_rim_and_an_arrow(make_scene: Callable[..., Scene]) -> None:
    poses = ((5.0, 4.0, 0.0), (8.0, 4.0, 0.0))
    free = draw(make_scene(*poses), SCALE)
    queue = make_scene(*poses, waits_for=np.array([1, -1]), deadlocked=np.array([False, False]))
    waiting = draw(queue, SCALE)
    deadlock = draw(queue._replace(deadlocked=np.array([True, False])), SCALE)
    for frame, ink, other in ((waiting, WAITING, DEADLOCK), (deadlock, DEADLOCK, WAITING)):
        assert (frame == np.array(ink)).all(axis=-1).any()
        assert not (frame == np.array(other)).all(axis=-1).any()
        between = slice(int(5.4 * SCALE), int(7.1 * SCALE))  # from robot 0's nose to robot 1's tail
        rows = slice(int(5.6 * SCALE), int(6.4 * SCALE))
        assert (frame[rows, between] != free[rows, between]).any(axis=(0, 2)).all()
    assert np.array_equal(waiting[:, int(8.6 * SCALE) :], free[:, int(8.6 * SCALE) :])


def test_people_wear_a_vest_across_their_heading(make_scene: Callable[..., Scene]) -> None:
    scene = without_goals(make_scene((8.0, 4.0, 0.0)))
    for heading in (0.0, math.pi / 2):
        frame = draw(scene._replace(people=np.array([[4.0, 4.0, heading]], dtype=np.float32)), SCALE)
        mask = changed(frame, scene)
        east, north = math.cos(heading + math.pi / 2), math.sin(heading + math.pi / 2)
        for side in (-0.18, 0.18):
            assert np.abs(at(frame, 4.0 + side * east, 4.0 + side * north).astype(int) - ORANGE).max() < 40
        assert at(frame, 4.0, 4.0).min() > 240  # the helmet
        rows, columns = np.nonzero(mask[:, : 6 * SCALE])
        across, along = np.ptp(columns), np.ptp(rows)
        assert sorted((across, along)) == pytest.approx([0.38 * SCALE, 0.5 * SCALE], abs=2.5)
        assert (across > along) == (heading > 1)


def test_goal_and_route_have_the_robots_colour(make_scene: Callable[..., Scene]) -> None:
    routes = [np.array([(8.0, 4.0), (8.0, 8.0)], dtype=np.float32), np.zeros((0, 2), dtype=np.float32)]
    scene = make_scene((8.0, 4.0, 0.0), (4.0, 4.0, 0.0), goal=np.array([[9, 13], [7, 2]]), routes=routes)
    frame = draw(scene, SCALE)
    assert tuple(at(frame, 13.5, 0.5)) == robot_colour(0)
    assert tuple(at(frame, 2.5, 2.5)) == robot_colour(1)
    along = at(frame, 8.0, 6.5)
    assert along[2] > along[0] + 60  # robot 0 is blue
    assert changed(frame, scene)[int(3.5 * SCALE), int(7.7 * SCALE)] == 0


def test_floor_heights_are_tinted_and_flat_floors_are_not(grid: GridMap) -> None:
    height = np.zeros(grid.shape, dtype=np.float32)
    height[7, 9] = 0.1
    rough = floor_image(GridMap(occupied=grid.occupied, height=height), 16.0).astype(np.int64)
    raised_level = floor_image(GridMap(occupied=grid.occupied, height=np.full(grid.shape, 0.4)), 16.0)
    flat = floor_image(grid, 16.0).astype(np.int64)
    assert np.array_equal(raised_level, flat)
    bump = rough[7 * 16 + 6, 9 * 16 + 6]
    assert bump[0] - bump[2] > 30
    assert np.array_equal(rough[:, :100], flat[:, :100])


def test_scene_of_a_simulator_is_a_copy() -> None:
    from warehouse_env.config import EnvConfig
    from warehouse_env.simulation.simulator import Simulator

    simulator = Simulator(EnvConfig(layout="open", num_agents=3, planner="astar"), num_worlds=2)
    simulator.reset(5)
    scene = scene_of(simulator, world=1)
    pose = scene.pose.copy()
    assert np.array_equal(pose, simulator.state.pose[1])
    assert not np.array_equal(pose, simulator.state.pose[0])
    assert np.allclose([route[-1] for route in scene.routes], scene.grid.centre(scene.goal), atol=1e-3)
    for _ in range(10):
        simulator.step(np.full((2, 3), int(simulator.cruise_action)))
    assert np.array_equal(scene.pose, pose)
    later = scene_of(simulator, world=1)
    assert later.time == pytest.approx(1.0)
    assert "3 robots" in later.text
    assert (draw(later) != draw(scene)).any()


def test_colours_are_distinct_and_stay_with_their_names() -> None:
    assert len({robot_colour(i) for i in range(24)}) == 24
    assert robot_colour(24) == robot_colour(0)
    both = name_colours(["ppo", "follow", "mine"])
    assert name_colours(["mine", "ppo"]) == {"mine": both["mine"], "ppo": both["ppo"]}
    assert len(set(name_colours(["a", "b", "c", "d", "ppo"]).values())) == 5
