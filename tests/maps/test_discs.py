"""Discs of a floor: which cells they close, what stays a shelf, their files, and what a wrong one is told."""

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

FREE = np.zeros((5, 6), dtype=bool)
PILLARS = [(2.5, 2.5, 0.4), (4.0, 1.0, 0.2)]


def floor(**more: object) -> GridMap:
    """A floor with a shelf in its north-west corner and two pillars, one on a crossing of four cells."""
    occupied = FREE.copy()
    occupied[0, 0] = True
    return GridMap(occupied, discs=PILLARS, **more)  # type: ignore[arg-type]


@given(st.lists(st.tuples(st.floats(0, 6), st.floats(0, 5), st.floats(0.01, 1.2)), max_size=4), st.integers(0, 10**6))
def test_a_cell_is_closed_where_its_nearest_point_is_within_a_disc(
    discs: list[tuple[float, float, float]], seed: int
) -> None:
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


def test_copies_keep_what_is_a_shelf_and_what_a_disc() -> None:
    grid = floor()
    for copy in (pickle.loads(pickle.dumps(grid)), dataclasses.replace(grid, name="again")):
        assert (copy.walls == grid.walls).all()
        assert (copy.occupied == grid.occupied).all()
        assert copy.key == grid.key
    assert floor().key != GridMap(grid.occupied).key
    more = grid.occupied.copy()
    more[1, 1], more[0, 0] = True, False
    changed = dataclasses.replace(grid, occupied=more)  # a shelf goes, one comes, discs stay what they are
    assert np.argwhere(changed.walls).tolist() == [[1, 1]]
    on_disc = FREE.copy()
    on_disc[2, 2] = True  # a shelf given where a disc is stays one
    assert GridMap(on_disc, discs=PILLARS).walls[2, 2]


def test_robots_in_a_closed_cell_or_off_the_floor_plan_from_the_nearest_free_cell() -> None:
    points = [(2.05, 2.5), (2.95, 2.4), (0.5, 4.4), (5.5, 0.5), (-3.0, 9.0), (6.0, -0.1)]
    assert floor().standing(points).tolist() == [[2, 1], [2, 3], [1, 0], [4, 5], [0, 1], [4, 5]]


@pytest.mark.parametrize(
    ("discs", "says"),
    [
        ([(1.0, 2.0)], "each three numbers"),
        ("pillars", "each three numbers"),
        ([(1.0, 2.0, 0.0)], "radius from 0.001"),
        ([(1.0, float("nan"), 0.5)], "disc 0"),
        ([(1.0, 1.0, 0.1), (6.5, 1.0, 0.1)], r"disc 1 \(6.5, 1.0, 0.1\) must have its centre on the floor of 6 x 5 m"),
        ([(3.0, 2.5, 5.0)], "no free cell"),
    ],
)
def test_wrong_discs_are_told_so(discs: object, says: str) -> None:
    with pytest.raises(MapError, match=says):
        GridMap(FREE, discs=discs)  # type: ignore[arg-type]


def test_a_map_file_keeps_its_discs_beside_it(tmp_path: Path) -> None:
    grid = make_layout("pillars:rows=20,columns=20,count=9")
    write_map(grid, tmp_path / "hall.map")
    read = read_map(tmp_path / "hall.map")
    assert read.discs.tobytes() == grid.discs.tobytes()
    assert read.key == grid.key
    write_map(GridMap(FREE), tmp_path / "hall.map")  # another floor: they are gone
    assert not len(read_map(tmp_path / "hall.map").discs)
    with pytest.raises(MapError, match=r"write a \.yaml"):
        write_map(GridMap(FREE, cell_size=0.5, discs=[(1, 1, 0.2)]), tmp_path / "hall.map")


def test_a_hall_reads_its_discs_and_pixels_within_are_theirs(tmp_path: Path) -> None:
    grid = floor(origin=(-3.0, 7.0))
    name = write_hall(grid, tmp_path / "hall.yaml", 0.05)
    hall = read_hall(name)
    assert (hall.grid.walls == grid.walls).all()
    assert (hall.grid.occupied == grid.occupied).all()
    np.testing.assert_allclose(hall.grid.discs, grid.discs, atol=1e-6)
    # a scanner drew the pillar too: as discs it is round, without them a cell of shelf
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


def test_files_of_discs(tmp_path: Path) -> None:
    discs = np.float32([(0.1, 2.7, 0.3), (1e-3, 33.3333, 1.0)])
    write_beside(tmp_path / "a.map", discs)
    assert (read_discs(tmp_path / "a.discs.json").astype(np.float32) == discs).all()
    for text, says in (
        ("[", "line 1: not valid"), ('{"disc": []}', 'must hold "discs"'), ('{"discs": [{"x": 1, "y": 2}]}', "disc 1"),
        ('{"discs": [{"x": 1, "y": 2, "radius": -1}]}', "radius from 0.001"), ('{"discs": [3]}', "disc 1"),
    ):  # fmt: skip
        (tmp_path / "b.json").write_text(text)
        with pytest.raises(MapError, match=says):
            read_discs(tmp_path / "b.json")
    with pytest.raises(ConfigError, match="radius"):
        make_layout("pillars:radius=0")
