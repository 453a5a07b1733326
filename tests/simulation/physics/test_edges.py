"""The shelves' edges that a cell's lidar looks at, by hand; test_sensing.py shows that no other is missed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tests.simulation.worlds import drawn
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.physics.edges import Edges
from warehouse_env.simulation.physics.floor import floor_of


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
