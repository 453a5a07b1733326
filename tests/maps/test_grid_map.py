"""Test GridMap: moves of eq. 26, exact distances, gaps, frames, endpoints and errors."""

from __future__ import annotations

import itertools
import math
import pickle
import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from warehouse_env.errors import MapError, WarehouseError
from warehouse_env.maps import distance
from warehouse_env.maps.clearance import segment_gap
from warehouse_env.maps.grid_map import MOVES, GridMap
from warehouse_env.maps.moves import label_regions


def floor(*rows: str) -> GridMap:
    """Return a map drawn with # and ."""
    return GridMap(np.array([[letter == "#" for letter in row] for row in rows]))


@st.composite
def floors(draw: st.DrawFn) -> GridMap:
    """Draw a small map with at least one free cell."""
    shape = (draw(st.integers(1, 7)), draw(st.integers(1, 7)))
    occupied = draw(hnp.arrays(np.bool_, shape))
    occupied[draw(st.integers(0, shape[0] - 1)), draw(st.integers(0, shape[1] - 1))] = False
    return GridMap(occupied)


def may_move(grid: GridMap, row: int, column: int, d_row: int, d_column: int) -> bool:
    """Return whether eq. 26 of the paper allows a move, independently of the code under test."""
    rows, columns = grid.shape

    def free(r: int, c: int) -> bool:
        return 0 <= r < rows and 0 <= c < columns and not grid.occupied[r, c]

    ends = free(row, column) and free(row + d_row, column + d_column)
    return ends and free(row + d_row, column) and free(row, column + d_column)


def relaxed_distances(grid: GridMap, goal: tuple[int, int]) -> np.ndarray:
    """Return distances by the slow relaxation of Bellman and Ford."""
    steps = [step for step in itertools.product((-1, 0, 1), repeat=2) if step != (0, 0)]
    result = np.full(grid.shape, np.inf)
    result[goal] = 0.0
    changed = True
    while changed:
        changed = False
        for row, column in np.ndindex(grid.shape):
            for d_row, d_column in steps:
                if may_move(grid, row, column, d_row, d_column):
                    new = result[row + d_row, column + d_column] + math.hypot(d_row, d_column)
                    if new < result[row, column] - 1e-9:
                        result[row, column] = new
                        changed = True
    return result


@given(floors())
def test_legal_moves_equal_eq_26(grid: GridMap) -> None:
    expected = [
        [[may_move(grid, row, column, *move) for move in MOVES.tolist()] for column in range(grid.shape[1])]
        for row in range(grid.shape[0])
    ]
    assert grid.legal_moves.tolist() == expected


@given(floors(), st.data())
def test_distances_equal_slow_relaxation(grid: GridMap, data: st.DataObject) -> None:
    goal = tuple(data.draw(st.sampled_from(np.argwhere(~grid.occupied).tolist())))
    assert np.allclose(grid.distance_to(goal), relaxed_distances(grid, goal), rtol=0, atol=1e-9, equal_nan=True)


@given(floors())
def test_free_cells_are_one_connected_region(grid: GridMap) -> None:
    reached = np.isfinite(grid.distance_to(tuple(grid.free_cells[0])))
    assert np.array_equal(np.argwhere(reached), grid.free_cells)
    assert all(
        np.isfinite(grid.distance_to(tuple(cell))).sum() <= len(grid.free_cells) for cell in np.argwhere(~grid.occupied)
    )


def test_frame_is_x_east_y_north_in_metres() -> None:
    grid = GridMap(np.zeros((3, 5)), cell_size=2.0)
    assert grid.centre((2, 0)).tolist() == [1.0, 1.0]  # the south-west cell
    assert grid.centre([(0, 4), (1, 1)]).tolist() == [[9.0, 5.0], [3.0, 3.0]]
    assert grid.cell([(0.0, 5.99), (9.99, 0.0)]).tolist() == [[0, 0], [2, 4]]
    assert grid.cell((-0.1, 6.1)).tolist() == [-1, -1]  # off the floor, not clipped


def test_key_follows_the_content() -> None:
    shelves = np.zeros((4, 6))
    base = GridMap(shelves)
    assert base.key == GridMap(shelves.astype(bool), name="other", picks=[(0, 0)]).key
    assert re.fullmatch(r"[0-9a-f]{32}", base.key)
    bump = np.zeros((4, 6))
    bump[1, 1] = 0.1
    others = [GridMap(bump * 10), GridMap(shelves, bump), GridMap(shelves, cell_size=0.5), GridMap(np.zeros((6, 4)))]
    assert len({base.key, *(other.key for other in others)}) == 5


def test_pickle_keeps_content_and_read_only_arrays() -> None:
    grid = GridMap(np.zeros((4, 4)), height=np.ones((4, 4)), picks=[(1, 1)], stations=[(0, 0)], name="small")
    grid.distance_to((0, 0))
    copy = pickle.loads(pickle.dumps(grid))
    assert copy.key == grid.key
    assert (copy.name, copy.picks.tolist(), copy.stations.tolist()) == ("small", [[1, 1]], [[0, 0]])
    assert not copy.occupied.flags.writeable


def test_text_shows_cells_and_places() -> None:
    height = np.zeros((2, 4))
    height[1] = 0.1
    grid = GridMap([[0, 1, 0, 0], [0, 0, 0, 0]], height, picks=[(0, 2)], stations=[(1, 0), (1, 3)])
    assert grid.text() == [".#p.", "s~~s"]


@given(floors())
def test_default_endpoints_are_usable_on_any_map(grid: GridMap) -> None:
    reachable = {tuple(cell) for cell in grid.free_cells.tolist()}
    picks = [tuple(cell) for cell in grid.picks.tolist()]
    stations = [tuple(cell) for cell in grid.stations.tolist()]
    assert picks
    assert stations
    assert set(picks + stations) <= reachable
    assert len(set(picks)) == len(picks)
    assert len(set(stations)) == len(stations)
    if len(reachable) > 1:
        assert not set(picks) & set(stations)
    if len(reachable) > 2:
        assert len(stations) >= 2


def test_default_picks_are_beside_shelves_not_the_outer_wall() -> None:
    grid = floor("########", "#......#", "#......#", "#..##..#", "#......#", "#......#", "########")
    assert grid.picks.tolist() == [[2, 3], [2, 4], [3, 2], [3, 5], [4, 3], [4, 4]]


NAN_HEIGHT = np.zeros((3, 3))
NAN_HEIGHT[1, 2] = np.nan


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"occupied": np.zeros(3)}, "2 dimensions"),
        ({"occupied": np.zeros((0, 4))}, "empty"),
        ({"occupied": [[0], [0, 1]]}, "different lengths"),
        ({"occupied": [[0.5]]}, "True"),
        ({"occupied": np.ones((3, 3))}, "no free cell"),
        ({"height": np.zeros((3, 4))}, r"height.*\(3, 3\)"),
        ({"height": NAN_HEIGHT}, r"height at \(1, 2\) is nan"),
        ({"height": np.full((3, 3), 1e300)}, "height at"),
        ({"height": "high"}, "height"),
        ({"cell_size": 0}, "cell_size=0 must"),
        ({"cell_size": math.nan}, "cell_size"),
        ({"cell_size": "1"}, "cell_size"),
        ({"picks": [(0, 3)]}, r"picks cell \(0, 3\) is outside"),
        ({"stations": [(0, 0), (1, 1)]}, r"stations cell \(1, 1\) is on a shelf"),
        ({"stations": [(2, 2), (2, 2)]}, r"stations names cell \(2, 2\) more than once"),
        ({"picks": []}, "one or more"),
        ({"picks": [(0.0, 1.0)]}, "whole numbers"),
        ({"picks": [(0, 1), (2,)]}, "picks must be"),
        ({"occupied": [[0, 1, 0, 0]], "picks": [(0, 0)]}, r"picks cell \(0, 0\) cannot be reached"),
        ({"tight": np.zeros((3, 3))}, "tight must hold True or False for each cell"),
        ({"price": np.zeros((3, 3, 8))}, r"price at \(0, 0, 0\) is 0; it must be from 1 to 1000"),
        ({"speed": "fast"}, r"speed must hold a number .* of shape \(3, 3\)"),
        ({"speed": np.zeros((3, 3))}, "speed"),
        ({"speed": np.full((3, 3), np.nan)}, "speed"),
        ({"one_way": np.full((3, 3), 5)}, "one_way"),
        ({"one_way": np.zeros((3, 4), int)}, "one_way"),
        ({"one_way": [[0.5, 0, 0], [0, 0, 0], [0, 0, 0]]}, r"one_way at cell \(0, 0\) is 0.5"),
        ({"one_way": [[1], [1, 2]]}, "one_way"),
        ({"one_way": np.ones((3, 3), int)}, r"one_way at cell \(1, 1\)"),  # on a shelf
        ({"discs": [(1.0, 2.0)]}, "each three numbers"),
        ({"discs": "pillars"}, "each three numbers"),
        ({"discs": [(1.0, 2.0, 0.0)]}, "radius from 0.001"),
        ({"discs": [(1.0, 1.0, 0.1), (3.5, 1.0, 0.1)]}, r"disc 1 \(3.5, 1.0, 0.1\) .* on the floor of 3 x 3 m"),
        ({"discs": [(1.5, 1.5, 5.0)]}, "no free cell"),
        ({"name": 3}, "name=3 must be a text"),
    ],
)
def test_wrong_fields_are_named(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(MapError, match=message) as raised:
        GridMap(**{"occupied": [[0, 0, 0], [0, 1, 0], [0, 0, 0]], **fields})
    assert isinstance(raised.value, WarehouseError)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("cell", "message"), [((0, 9), r"goal \(0, 9\) is outside"), ((-1, 0), "outside"), ((1, 1), "on a shelf"),
                        ((0.5, 1), "whole numbers"), ((0, 1, 2), "whole numbers")],
)  # fmt: skip
def test_cells_are_checked(cell: Any, message: str) -> None:
    with pytest.raises(MapError, match=message):
        floor("....", ".#..", "....").check_cell(cell, "goal")


def test_origin_places_the_floor_in_the_files_frame() -> None:
    grid = GridMap(np.zeros((2, 3)), cell_size=0.5, origin=[-15.1, 2])
    assert grid.world(grid.centre((1, 0))).tolist() == pytest.approx([-14.85, 2.25])
    assert pickle.loads(pickle.dumps(grid)).origin == grid.origin == (-15.1, 2.0)
    assert grid.key == GridMap(np.zeros((2, 3)), cell_size=0.5).key  # the origin does not change routes
    for origin in (3, (1, 2, 3), (np.nan, 0), ("x", 0), None, (10**400, 0)):
        with pytest.raises(MapError, match="origin"):
            GridMap(np.zeros((2, 3)), origin=origin)  # type: ignore[arg-type]


@given(floors())
def test_cut_cells_are_those_that_split_a_region(grid: GridMap) -> None:
    free = ~grid.occupied
    regions, expected = label_regions(free).max(), np.zeros_like(free)
    for row, column in np.argwhere(free):
        rest = free.copy()
        rest[row, column] = False
        expected[row, column] = label_regions(rest).max() > regions
    np.testing.assert_array_equal(distance.cut_cells(free), expected)


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 10_000))
def test_segment_gap_equals_the_gap_of_its_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    occupied = rng.random((5, 6)) < 0.3
    solid = np.pad(occupied, 1, constant_values=True).astype(np.uint8)
    cell = float(rng.uniform(0.5, 2.0))
    a, b = rng.uniform(0, [6 * cell, 5 * cell], (2, 2))
    points = a + np.linspace(0, 1, 4001)[:, None] * (b - a)
    rows, columns = np.nonzero(solid)
    low = np.stack([columns - 1, rows - 1], -1) * cell
    away = np.maximum(np.maximum(low - points[:, None], points[:, None] - low - cell), 0.0)
    true = float(np.hypot(away[..., 0], away[..., 1]).min())
    step = float(np.hypot(*(b - a))) / 4000
    assert true - step <= segment_gap(solid, *a, *b, cell, 9.0) <= true + 1e-9
    assert segment_gap(solid, *a, *b, cell, 0.1) == pytest.approx(min(true, 0.1), abs=step)
