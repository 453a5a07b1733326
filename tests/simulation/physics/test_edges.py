"""The shelves' edges that a cell's lidar looks at: by hand, and that leaving the others out changes nothing."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.simulation.worlds import drawn, put, stage
from warehouse_env.config import SensorSpec
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.physics.edges import Edges
from warehouse_env.simulation.physics.floor import floor_of


def listed(grid: GridMap, row: int, column: int, lidar_range: float = 6.0) -> set[tuple[str, float, float, float]]:
    """(x or y, line, low, high) of the edges that a cell's lidar looks at; row 0 is the northernmost."""
    edges: Edges = floor_of(grid, lidar_range).edges
    first = edges.first[grid.shape[0] - row, column + 1]
    return {("x" if n < first[1] else "y", *map(float, edges.edges[edges.seen[n]])) for n in range(first[0], first[2])}


def test_an_empty_room_has_four_walls() -> None:
    grid = drawn(["...."] * 3)
    everything = {("x", 0.0, 0.0, 3.0), ("x", 4.0, 0.0, 3.0), ("y", 0.0, 0.0, 4.0), ("y", 3.0, 0.0, 4.0)}
    assert listed(grid, 1, 1) == everything
    # from the cell in the north-west corner, the east wall is 3 m off and the south wall 2 m
    assert listed(grid, 0, 0, 2.5) == everything - {("x", 4.0, 0.0, 3.0)}


def test_a_row_of_shelves_is_one_edge_and_hides_what_is_behind_it() -> None:
    grid = drawn(["......", "......", ".####.", "......", "......"])
    seen = listed(grid, 0, 2)
    assert ("y", 3.0, 1.0, 5.0) in seen  # the row's north side, four cells in one
    assert ("y", 2.0, 1.0, 5.0) not in seen  # its south side faces away
    assert ("y", 0.0, 0.0, 6.0) not in seen  # all lines from here to the wall behind cross the row
    assert ("y", 0.0, 0.0, 6.0) in listed(grid, 0, 0)  # past the row's end it can be seen
    assert listed(grid, 2, 2) == set()  # nobody looks out of a shelf


def cast(grid: GridMap, x: float, y: float, angle: float) -> float:
    """Distance [m] to the first shelf or the rim, from cell to cell in float64."""
    rows, columns = grid.shape
    ux, uy = math.cos(angle), math.sin(angle)
    hits = [math.inf]
    for edge in range(columns + 1):
        if ux and (t := (edge * grid.cell_size - x) / ux) > 0:
            row, column = rows - 1 - math.floor((y + t * uy) / grid.cell_size), edge if ux > 0 else edge - 1
            if not (0 <= column < columns) or not (0 <= row < rows) or grid.occupied[row, column]:
                hits.append(t)
    for edge in range(rows + 1):
        if uy and (t := (edge * grid.cell_size - y) / uy) > 0:
            row, column = rows - 1 - (edge if uy > 0 else edge - 1), math.floor((x + t * ux) / grid.cell_size)
            if not (0 <= row < rows) or not (0 <= column < columns) or grid.occupied[row, column]:
                hits.append(t)
    return min(hits)


@settings(max_examples=60)
@given(st.integers(0, 10**6), st.sampled_from([0.1, 0.25, 0.45]), st.sampled_from([0.5, 1.0]))
def test_what_is_left_out_is_never_missed(seed: int, share: float, cell: float) -> None:
    """Rays from anywhere on a random floor, against all its cells."""
    rng = np.random.default_rng(seed)
    occupied: NDArray[np.bool_] = rng.random((14, 17)) < share
    occupied[0], occupied[:, 0] = False, False  # so that there is a floor to drive on
    free = np.argwhere(~occupied)
    grid = GridMap(occupied, cell_size=cell, name="scattered")
    sensor = SensorSpec(rays=16, lidar_range=5.0)
    simulator = stage(grid, (0.5, 0.5, 0.0), sensor=sensor)
    offset = float(simulator._params["offset"][0])
    for row, column in free[rng.integers(0, len(free), 12)].tolist():
        cx, cy = (column + rng.uniform(0.02, 0.98)) * cell, (grid.shape[0] - 1 - row + rng.uniform(0.02, 0.98)) * cell
        heading = rng.uniform(-math.pi, math.pi)
        put(simulator, 0, (cx + offset * math.cos(heading), cy + offset * math.sin(heading), heading))
        simulator._observe()
        got = 1.0 / simulator.observation[0, 0, :16].astype(np.float64) - 1.0
        for k in range(16):
            angle = heading + 2 * math.pi * k / 16
            # a ray that grazes a corner may go either way
            around = [min(cast(grid, cx, cy, angle + turn), 5.0) for turn in (-2e-5, 0.0, 2e-5)]
            assert min(around) - 2e-3 <= got[k] <= max(around) + 2e-3


def test_a_range_beyond_the_floor_sees_no_more_than_one_across_it() -> None:
    """Each edge is held against those in front of it, not against all: else this takes minutes."""
    occupied: NDArray[np.bool_] = np.random.default_rng(0).random((40, 40)) < 0.4
    grid = GridMap(occupied, name="scattered")
    across, beyond = floor_of(grid, 60.0).edges, floor_of(grid, 1e6).edges
    for one, other in zip(across, beyond, strict=True):
        np.testing.assert_array_equal(one, other)
