"""The body against shelf cells, the clearance field, swept arcs and the edges that lidar looks at, by brute force."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.simulation.reference import OFFSET, WHEELBASE, rectangle, separation, shelves
from tests.simulation.worlds import drawn, stage
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.physics.edges import Edges
from warehouse_env.simulation.physics.floor import Floor, floor_of
from warehouse_env.simulation.physics.footprint import body_touches_shelf, clearance_at, sweep_is_free
from warehouse_env.simulation.physics.geometry import Pose, Rectangle

F = np.float32
MAP = drawn(["........", ".##...#.", "......#.", ".#......", ".....##.", "..#....."])
ROWS, COLUMNS = MAP.shape
WALLS = shelves(MAP.occupied)
FLOOR = floor_of(MAP)
inside = st.tuples(st.floats(0.0, COLUMNS), st.floats(0.0, ROWS))


def touches(cx: float, cy: float, heading: float, half_length: float = 0.45, half_width: float = 0.3) -> bool:
    body = Rectangle(*map(F, (cx, cy, math.cos(heading), math.sin(heading), half_length, half_width)))
    return bool(body_touches_shelf(body, FLOOR))


@given(inside, st.floats(-math.pi, math.pi))
def test_body_against_shelves_agrees_with_polygons(centre: tuple[float, float], heading: float) -> None:
    apart = float(separation(rectangle(*centre, heading, 0.45, 0.3), WALLS).min())
    assume(abs(apart) > 5e-6)
    assert touches(*centre, heading) == (apart < 0)


@given(inside)
def test_clearance_is_a_lower_bound_and_not_far_below(point: tuple[float, float]) -> None:
    x, y = (float(F(v)) for v in point)
    if not (x < COLUMNS and y < ROWS):
        return
    # distance of a point to axis-aligned boxes
    low, high = WALLS.min(axis=1), WALLS.max(axis=1)
    outside = np.maximum(np.maximum(low - (x, y), (x, y) - high), 0.0)
    distance = float(np.hypot(outside[:, 0], outside[:, 1]).min())
    known = float(clearance_at(F(x), F(y), FLOOR))
    assert known <= distance + 1e-6
    # at most a sample's diagonal (1 m / 8), and a count of 1 cm, too low
    assert known >= min(distance, 2.55) - 0.125 * math.sqrt(2) - 0.01 - 1e-6


def test_there_is_no_clearance_outside_the_map() -> None:
    for x, y in ((-0.1, 1.0), (1.0, -0.1), (8.01, 1.0), (1.0, 6.01), (1e3, 1e3)):
        assert clearance_at(F(x), F(y), FLOOR) == 0.0


def is_free(axle: tuple[float, float], heading: float, steering: float, distance: float, floor: Floor = FLOOR) -> bool:
    """Whether the body keeps 3 cm from shelves as it drives `distance` with that steering."""
    p = stage(MAP, (4.5, 3.5, 0.0))._params[0]
    bend = -math.tan(steering) / WHEELBASE
    start = Pose(*(F(v) for v in (*axle, heading, math.cos(heading), math.sin(heading))))
    return bool(sweep_is_free(start, F(bend), F(distance), F(0.03), p, floor))


@given(inside, st.floats(-math.pi, math.pi), st.floats(-1.04, 1.04), st.floats(-1.5, 1.5))
def test_a_free_sweep_touches_nothing_on_its_way(
    axle: tuple[float, float], heading: float, steering: float, distance: float
) -> None:
    free = is_free(axle, heading, steering, distance)
    bend = -math.tan(steering) / WHEELBASE
    x, y = axle
    along = np.linspace(0.0, distance, 60)[1:]
    turned = heading + along * bend
    chord = along * np.sinc(along * bend / 2 / math.pi)
    xs, ys = x + chord * np.cos(heading + along * bend / 2), y + chord * np.sin(heading + along * bend / 2)
    poses = np.array(
        [
            rectangle(a - OFFSET * math.cos(t), b - OFFSET * math.sin(t), t, 0.45, 0.3)
            for a, b, t in zip(xs, ys, turned, strict=True)
        ]
    )
    # the start itself is not judged, so look from the first checked pose on (12 cm or 0.06 rad on at most)
    apart = separation(poses[:, None], WALLS[None]).min(axis=1)
    first = np.abs(along) >= min(0.12, 0.06 / max(abs(bend), 1e-9))
    if free and first.any():
        assert apart[first].min() > 0.0
    if not free:  # some pose on the way comes within the margin, and its corners' growth
        assert apart.min() < 0.03 * math.sqrt(2) + 0.03


@given(inside, st.floats(-math.pi, math.pi), st.floats(-1.04, 1.04), st.floats(-1.5, 1.5))
def test_poses_passed_over_would_have_been_free(
    axle: tuple[float, float], heading: float, steering: float, distance: float
) -> None:
    """A sweep that knows of no room, and so looks at every pose, gives the same answer."""
    unknown = FLOOR._replace(clearance=np.zeros_like(FLOOR.clearance))
    known, every = (is_free(axle, heading, steering, distance, floor) for floor in (FLOOR, unknown))
    assert known == every


def listed(grid: GridMap, row: int, column: int, lidar_range: float = 6.0) -> set[tuple[str, float, float, float]]:
    """(x or y, line, low, high) of the edges that a cell's lidar looks at; row 0 is the northernmost."""
    edges: Edges = floor_of(grid, lidar_range).edges
    first = edges.first[grid.shape[0] - row, column + 1]
    return {("x" if n < first[1] else "y", *map(float, edges.edges[edges.seen[n]])) for n in range(first[0], first[2])}


def test_a_row_of_shelves_is_one_edge_and_hides_what_is_behind_it() -> None:
    grid = drawn(["......", "......", ".####.", "......", "......"])
    seen = listed(grid, 0, 2)
    assert ("y", 3.0, 1.0, 5.0) in seen  # the row's north side, four cells in one
    assert ("y", 2.0, 1.0, 5.0) not in seen  # its south side faces away
    assert ("y", 0.0, 0.0, 6.0) not in seen  # all lines from here to the wall behind cross the row
    assert ("y", 0.0, 0.0, 6.0) in listed(grid, 0, 0)  # past the row's end it can be seen
    assert listed(grid, 2, 2) == set()  # nobody looks out of a shelf


def test_a_range_beyond_the_floor_sees_no_more_than_one_across_it() -> None:
    """Each edge is held against those in front of it, not against all: else this takes minutes."""
    occupied: NDArray[np.bool_] = np.random.default_rng(0).random((40, 40)) < 0.4
    grid = GridMap(occupied, name="scattered")
    across, beyond = floor_of(grid, 60.0).edges, floor_of(grid, 1e6).edges
    for one, other in zip(across, beyond, strict=True):
        np.testing.assert_array_equal(one, other)
