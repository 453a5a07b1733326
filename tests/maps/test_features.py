"""Test discs and one-way cells: the cells they close, their files, lanes, and errors."""

from __future__ import annotations

import dataclasses
import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from warehouse_env.errors import ConfigError, MapError
from warehouse_env.maps.discs import read_discs, write_beside
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls.hall import read_hall
from warehouse_env.maps.halls.saved import write_hall
from warehouse_env.maps.layouts import make_layout
from warehouse_env.maps.movingai import read_map, write_map
from warehouse_env.maps.one_way import against, parse, text
from warehouse_env.routes.lanes import drivable_line

FREE = np.zeros((5, 6), dtype=bool)
PILLARS = [(2.5, 2.5, 0.4), (4.0, 1.0, 0.2)]


def floor(**more: object) -> GridMap:
    """Return a floor with a shelf in its north-west corner and two pillars, one on a corner of four cells."""
    occupied = FREE.copy()
    occupied[0, 0] = True
    return GridMap(occupied, discs=PILLARS, **more)  # type: ignore[arg-type]


@given(st.lists(st.tuples(st.floats(0, 6), st.floats(0, 5), st.floats(0.01, 1.2)), max_size=4), st.integers(0, 10**6))
def test_disc_closes_cells_whose_nearest_point_it_covers(discs: list[tuple[float, float, float]], seed: int) -> None:
    occupied = np.random.default_rng(seed).random(FREE.shape) < 0.1
    expected = occupied.copy()
    for row in range(5):
        for column in range(6):
            for x, y, radius in np.float32(discs).reshape(-1, 3).astype(float):
                dx = max(column - x, x - column - 1, 0.0)
                dy = max(4 - row - y, y - (5 - row), 0.0)
                expected[row, column] |= dx * dx + dy * dy < radius * radius
    if expected.all():
        with pytest.raises(MapError, match="no free cell"):
            GridMap(occupied, discs=discs)
        return
    grid = GridMap(occupied, discs=discs)
    assert (grid.occupied == expected).all()
    assert (grid.walls == occupied).all()


def test_copies_keep_shelves_and_discs_apart() -> None:
    grid = floor()
    for copy in (pickle.loads(pickle.dumps(grid)), dataclasses.replace(grid, name="again")):
        assert (copy.walls == grid.walls).all()
        assert (copy.occupied == grid.occupied).all()
        assert copy.key == grid.key
    assert floor().key != GridMap(grid.occupied).key
    more = grid.occupied.copy()
    more[1, 1], more[0, 0] = True, False
    changed = dataclasses.replace(grid, occupied=more)  # one shelf moves; discs stay discs
    assert np.argwhere(changed.walls).tolist() == [[1, 1]]
    on_disc = FREE.copy()
    on_disc[2, 2] = True  # a shelf at a disc stays a shelf
    assert GridMap(on_disc, discs=PILLARS).walls[2, 2]


def test_robots_off_free_cells_plan_from_the_nearest_free_cell() -> None:
    points = [(2.05, 2.5), (2.95, 2.4), (0.5, 4.4), (5.5, 0.5), (-3.0, 9.0), (6.0, -0.1)]
    assert floor().standing(points).tolist() == [[2, 1], [2, 3], [1, 0], [4, 5], [0, 1], [4, 5]]


def test_discs_are_stored_beside_a_map_file(tmp_path: Path) -> None:
    grid = make_layout("pillars:rows=20,columns=20,count=9")
    write_map(grid, tmp_path / "hall.map")
    read = read_map(tmp_path / "hall.map")
    assert read.discs.tobytes() == grid.discs.tobytes()
    assert read.key == grid.key
    write_map(GridMap(FREE), tmp_path / "hall.map")  # another floor without discs
    assert not len(read_map(tmp_path / "hall.map").discs)
    with pytest.raises(MapError, match=r"write a \.yaml"):
        write_map(GridMap(FREE, cell_size=0.5, discs=[(1, 1, 0.2)]), tmp_path / "hall.map")


def test_hall_discs_own_the_pixels_they_cover(tmp_path: Path) -> None:
    grid = floor(origin=(-3.0, 7.0))
    name = write_hall(grid, tmp_path / "hall.yaml", 0.05)
    hall = read_hall(name)
    assert (hall.grid.walls == grid.walls).all()
    assert (hall.grid.occupied == grid.occupied).all()
    np.testing.assert_allclose(hall.grid.discs, grid.discs, atol=1e-6)
    # a scanner also drew the pillar: with its disc it is round, without it a cell of shelf
    picture = (tmp_path / "hall.pgm").read_bytes()
    head, body = picture[: -100 * 120], np.frombuffer(picture[-100 * 120 :], np.uint8).reshape(100, 120).copy()
    body[47:53, 47:53] = 0
    (tmp_path / "hall.pgm").write_bytes(head + body.tobytes())
    assert not read_hall(name).grid.walls[2, 2]
    write_beside(tmp_path / "hall.yaml", np.array([(-2.5, 8, 0.2), (50, 50, 1)]))
    far = read_hall(name)
    assert far.grid.walls[2, 2]
    assert len(far.grid.discs) == 1
    assert any("1 disc with a centre off the floor" in note for note in far.notes)


def test_disc_files_round_trip_and_name_errors(tmp_path: Path) -> None:
    discs = np.float32([(0.1, 2.7, 0.3), (1e-3, 33.3333, 1.0)])
    write_beside(tmp_path / "a.map", discs)
    assert (read_discs(tmp_path / "a.discs.json").astype(np.float32) == discs).all()
    for content, message in (
        ("[", "line 1: not valid"), ('{"disc": []}', 'must hold "discs"'), ('{"discs": [{"x": 1, "y": 2}]}', "disc 1"),
        ('{"discs": [{"x": 1, "y": 2, "radius": -1}]}', "radius from 0.001"), ('{"discs": [3]}', "disc 1"),
    ):  # fmt: skip
        (tmp_path / "b.json").write_text(content)
        with pytest.raises(MapError, match=message):
            read_discs(tmp_path / "b.json")
    with pytest.raises(ConfigError, match="radius"):
        make_layout("pillars:radius=0")


AISLE = [".........", ".>>>>>>>.", ".>>>>>>>.", "........."]


def aisle() -> GridMap:
    occupied = np.zeros((4, 9), bool)
    occupied[[0, 3], 1:8] = True
    return GridMap(occupied, one_way=parse(AISLE), name="aisle")


def test_one_way_text_round_trips() -> None:
    assert text(parse(AISLE)) == AISLE
    assert parse([".>^<v"]).tolist() == [[0, 1, 2, 3, 4]]
    for wrong in ([".>", "."], [".x"]):
        with pytest.raises(MapError, match="line"):
            parse(wrong)


def test_an_arrow_bars_three_of_eight_moves() -> None:
    # moves counter-clockwise from east: 0 E, 1 NE, 2 N, 3 NW, 4 W, 5 SW, 6 S, 7 SE
    moves = [np.flatnonzero(row).tolist() for row in against(parse([".>^<v"]))[0]]
    assert moves == [[], [3, 4, 5], [5, 6, 7], [0, 1, 7], [1, 2, 3]]


def test_directions_are_stored_beside_a_map_file(tmp_path: Path) -> None:
    grid, path = aisle(), tmp_path / "aisle.map"
    write_map(grid, path)
    assert (tmp_path / "aisle.oneway").read_text().splitlines() == AISLE
    assert read_map(path).key == grid.key
    for lines, wrong in (("..\n>?\n", "line 2"), ("..\n..\n", r"\(2, 2\) rows and columns, the floor \(4, 9\)")):
        (tmp_path / "aisle.oneway").write_text(lines)
        with pytest.raises(MapError, match=rf"aisle\.oneway: .*{wrong}"):
            read_map(path)
    (tmp_path / "AISLE.MAP").write_text(path.read_text())
    (tmp_path / "AISLE.ONEWAY").write_text("\n".join(AISLE).lower() + " \n")
    assert make_layout(str(tmp_path / "AISLE.MAP")).one_way.tolist() == grid.one_way.tolist()
    write_map(GridMap(grid.occupied), path)
    assert not read_map(path).one_way.any()


def test_lane_is_in_the_middle_of_a_one_way_aisle() -> None:
    grid = aisle()
    solid = np.pad(grid.occupied[::-1], 1, constant_values=True).astype(np.uint8)
    arrows = np.pad(grid.one_way[::-1], 1)
    points = grid.centre([(1, column) for column in range(9)])
    how = 1.0, 0.5, 1.0, np.inf  # all by position, as the book of routes calls it: compiled once
    one_way = drivable_line(points, solid, arrows, *how)
    two_way = drivable_line(points, solid, np.zeros_like(arrows), *how)
    inner, other = ((line[:, 0] > 3.0) & (line[:, 0] < 6.0) for line in (one_way, two_way))
    np.testing.assert_allclose(one_way[inner, 1], 2.0, atol=0.02)  # two cells wide, from y = 1 to 3
    assert two_way[other, 1].max() < 1.7  # to the right, which is south
