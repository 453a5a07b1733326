"""Test cells of halls and proposed places: by hand, for any picture origin, and on real halls."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tests.maps.halls.test_map_server import REAL, hall, room
from warehouse_env.maps.halls.cells import Raster, spread
from warehouse_env.maps.halls.hall import Hall, read_hall
from warehouse_env.maps.halls.map_server import Occupancy, read_occupancy, write_occupancy
from warehouse_env.maps.halls.places import propose
from warehouse_env.render.heat_maps import cell_kinds

RACKS = np.array([list(row) for row in (
    "#########",
    "#.......#",
    "#.#.#.#.#",
    "#.#.#.#.#",
    "#.#.#.#.#",
    "#.......#",
    "#########",
)]) == "#"  # fmt: skip


def shifted(folder: Path, occupied: np.ndarray, above: int = 0, left: int = 0) -> str:
    """Write cells of 1 m as pixels of .25 m with extra pixels above and to the left; return the hall's name."""
    pixels = np.pad(occupied.repeat(4, axis=0).repeat(4, axis=1), ((above, 0), (left, 0)), constant_values=True)
    origin = (-0.25 * left, 0.0)
    write_occupancy(Occupancy(np.where(pixels, 100, 0).astype(np.int8), 0.25, origin), folder / "hall.yaml")
    return str(folder / "hall.yaml")


def free_centres(found: Hall) -> set[tuple[float, ...]]:
    """Return the centres of all free cells in the map's frame [m]."""
    return set(map(tuple, found.grid.world(found.grid.centre(found.grid.free_cells)).round(6).tolist()))


def test_aisle_off_the_grid_stays_open(tmp_path: Path) -> None:
    """Aisles of 1 m lie half a cell off the corner. Cells from the corner would close them and two outer rows."""
    found = read_hall(shifted(tmp_path, RACKS, above=2, left=2))
    assert len(found.grid.free_cells) == (~RACKS).sum() == 26
    assert found.grid.origin == (0.0, 0.0)
    assert (cell_kinds(found)[tuple(found.grid.free_cells.T)] == 0).all()


def test_open_aisle_outweighs_a_strip_of_floor(tmp_path: Path) -> None:
    """Cells from the corner keep 52 without the aisle; cells half a cell to the right keep 50 with it."""
    grey = room(20, 20)
    grey[4:, 8:13], grey[4:, 15:] = 0, 0
    found = read_hall(hall(tmp_path, grey))
    assert len(found.grid.free_cells) == 50
    assert found.grid.origin == (-2.5, 2.0)


walled = hnp.arrays(np.bool_, st.tuples(st.integers(1, 6), st.integers(1, 6))).map(
    lambda inner: np.pad(inner, 1, constant_values=True)
)


@given(walled, st.integers(0, 9), st.integers(0, 9), st.sampled_from([0.0, 0.05, 0.2]))
@settings(max_examples=60, deadline=None)
def test_hall_does_not_depend_on_the_pictures_origin(tmp_path_factory, occupied, above, left, share) -> None:  # type: ignore[no-untyped-def]
    occupied[1, 1] = False
    folder = tmp_path_factory.mktemp("h")
    plain = free_centres(read_hall(f"{shifted(folder, occupied)}:share={share}"))
    assert free_centres(read_hall(f"{shifted(folder, occupied, above, left)}:share={share}")) == plain


def test_one_way_file_fixes_cells_at_the_corner(tmp_path: Path) -> None:
    occupied = np.zeros((4, 5), np.bool_)
    name = shifted(tmp_path, occupied, above=3, left=3)
    assert read_hall(name).grid.shape == (4, 5)
    (tmp_path / "hall.oneway").write_text("\n".join([".>>>."] * 4))
    assert read_hall(name).grid.origin == (-0.75, 0.75)


@given(
    hnp.arrays(np.int64, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.integers(0, 100)),
    st.sampled_from([(1.0, 1.0), (1.0, 0.25), (0.5, 0.2), (0.25, 1.0), (1.0, 0.03)]),
    st.tuples(st.integers(-12, 12), st.integers(-12, 12)),
)
@settings(deadline=None)
def test_cell_values_equal_the_means_of_their_pixels(
    weights: np.ndarray, sizes: tuple[float, float], shift: tuple[int, int]
) -> None:
    """Compare with single pixels: each counts for the cell of its centre; wide pixels are split."""
    cell, resolution = sizes
    raster = Raster(4, 3, cell, (shift[0] * 0.07 + 0.001, shift[1] * 0.07 + 0.001))
    parts = max(1, round(resolution / cell))
    size, (rows, columns) = resolution / parts, np.array(weights.shape) * parts
    found: dict[tuple[int, int], list[int]] = {}
    for row in range(rows):
        for column in range(columns):
            middle = np.array([(column + 0.5) * size, (rows - row - 0.5) * size])
            value = int(weights[row // parts, column // parts])
            found.setdefault(tuple(raster.cells(middle).tolist()), []).append(value)
    expected = [[float(np.mean(found.get((r, c), [0]))) for c in range(3)] for r in range(4)]
    occupancy = Occupancy(np.zeros(weights.shape, np.int8), resolution)
    assert spread(occupancy, weights, raster).tolist() == expected


@pytest.mark.skipif(not REAL.exists(), reason="the real halls are not here")
@pytest.mark.parametrize(
    ("name", "counts", "floor"),
    [
        ("depot", (5947, 179481, 0), (318, 373, 629, 663)),
        ("warehouse", (30951, 1422292, 230801), (1039, 1086, 2000, 2063)),
    ],
)
def test_real_halls_keep_their_counts_and_aisles(name: str, counts: tuple[int, ...], floor: tuple[int, ...]) -> None:
    """Aisles close only in the depot, with cells of 1 m and share 0."""
    path = REAL / f"{name}.yaml"
    assert read_occupancy(path).counts == counts
    found = [read_hall(f"{path}:cell={cell},share={share}") for cell in (1, 0.75) for share in (0, 0.05)]
    assert tuple(int((~one.grid.occupied).sum()) for one in found) == floor
    closes = [any("aisles close:" in line for line in one.report) for one in found]
    assert closes == [name == "depot", False, False, False]
    assert name != "depot" or len(found[1].grid.picks) > 25


def drawn(folder: Path, *blocks: tuple[float, float, float, float]) -> Hall:
    """Read a hall of 9 x 12 m with pixels of 0.1 m: walls of 0.3 m, and blocks (top, left, down, right)."""
    (folder / "hall.oneway").write_text(("." * 12 + "\n") * 9)  # makes cells start at the corner
    values = np.zeros((90, 120), np.int8)
    for top, left, down, right in ((0, 0, 9, 0.3), (0, 0, 0.3, 12), (8.7, 0, 9, 12), (0, 11.7, 9, 12), *blocks):
        values[round(10 * top) : round(10 * down), round(10 * left) : round(10 * right)] = 100
    write_occupancy(Occupancy(values, 0.1), folder / "hall.yaml")
    return read_hall(str(folder / "hall.yaml"))


def picks(found: Hall) -> list[tuple[int, ...]]:
    return sorted(map(tuple, found.grid.picks.tolist()))


def test_proposed_places_are_beside_straight_obstacles() -> None:
    occupied = np.zeros((9, 11), np.bool_)
    occupied[4, 3:8] = True  # a rack, unlike the pillar below
    occupied[1, 5] = True
    found, stations = propose(occupied, np.zeros_like(occupied), occupied, 1.0)
    assert sorted(map(tuple, found.tolist())) == [(row, column) for row in (3, 5) for column in range(3, 8)]
    assert {column for _, column in stations.tolist()} == {1, 9}


def test_racks_that_touch_a_wall_only_as_cells_have_faces(tmp_path: Path) -> None:
    """A gap of 0.4 m joins the rack to the wall in cells but not in pixels."""
    found = drawn(tmp_path, (1.3, 4, 2, 8), (6, 5, 6.9, 9))
    assert not found.grid.occupied[2, 4:8].any()
    assert found.grid.occupied[1, 4:8].all()
    above = [(2, column) for column in range(4, 8)]
    assert picks(found) == above + [(row, column) for row in (5, 7) for column in range(5, 9)]
    joined = drawn(tmp_path, (0, 4, 2, 8), (6, 5, 6.9, 9))  # its pixels touch the wall, so it is a wall
    assert picks(joined) == picks(found)[4:]


def test_no_pick_face_blocks_the_only_way_to_a_room() -> None:
    """A robot in the gap below the rack would block the room behind it. Such a face is used only if no other exists."""
    occupied = np.array([list(row) for row in ("#....##....#", "#....##....#", "#..........#", "############")]) == "#"
    rack = np.zeros_like(occupied)
    rack[:2, 5:7] = True
    found, _ = propose(occupied, rack, occupied, 1.0)
    assert sorted(map(tuple, found.tolist())) == [(0, 4), (0, 7), (1, 4), (1, 7)]
    rack[0] = False
    found, _ = propose(occupied, rack, occupied, 1.0)
    assert found.tolist() == [[2, 5], [2, 6]]


def test_no_pick_face_is_in_a_blind_alley() -> None:
    rows = ("........", "..##.##.", "..##.##.", "..#####.", "........")
    occupied = np.array([list(row) for row in rows]) == "#"
    found, _ = propose(occupied, occupied, occupied, 1.0)
    assert len(found) > 12
    assert not {(1, 4), (2, 4)} & set(map(tuple, found.tolist()))
