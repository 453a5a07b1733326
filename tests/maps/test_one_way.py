"""One-way cells as data: their text, their file, what is drawn and checked, episodes, and lanes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from warehouse_env.errors import MapError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.maps.movingai import read_map, write_map
from warehouse_env.maps.one_way import against, parse, text
from warehouse_env.routes.lanes import drivable_line

AISLE = [".........", ".>>>>>>>.", ".>>>>>>>.", "........."]


def aisle() -> GridMap:
    occupied = np.zeros((4, 9), bool)
    occupied[[0, 3], 1:8] = True
    return GridMap(occupied, one_way=parse(AISLE), name="aisle")


def test_text_is_read_back() -> None:
    assert text(parse(AISLE)) == AISLE
    assert parse([".>^<v"]).tolist() == [[0, 1, 2, 3, 4]]
    for wrong in ([".>", "."], [".x"]):
        with pytest.raises(MapError, match="line"):
            parse(wrong)


def test_three_of_eight_moves_are_against_an_arrow() -> None:
    # moves counter-clockwise from east: 0 E, 1 NE, 2 N, 3 NW, 4 W, 5 SW, 6 S, 7 SE
    moves = [np.flatnonzero(row).tolist() for row in against(parse([".>^<v"]))[0]]
    assert moves == [[], [3, 4, 5], [5, 6, 7], [0, 1, 7], [1, 2, 3]]


@pytest.mark.parametrize("wrong", [np.full((4, 9), 5), np.zeros((4, 8), int), np.full((4, 9), 0.5), [[1], [1, 2]]])
def test_wrong_directions_are_refused(wrong: object) -> None:
    with pytest.raises(MapError, match="one_way"):
        GridMap(np.zeros((4, 9), bool), one_way=wrong)  # type: ignore[arg-type]
    with pytest.raises(MapError, match="one_way"):
        GridMap(aisle().occupied, one_way=np.ones((4, 9), int))  # on shelves


def test_directions_stand_beside_a_map_file(tmp_path: Path) -> None:
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


def test_a_lane_runs_in_the_middle_of_a_one_way_aisle() -> None:
    grid = aisle()
    solid = np.pad(grid.occupied[::-1], 1, constant_values=True).astype(np.uint8)
    arrows = np.pad(grid.one_way[::-1], 1)
    points = grid.centre([(1, column) for column in range(9)])
    one_way = drivable_line(points, solid, arrows, 1.0, 0.5)
    two_way = drivable_line(points, solid, np.zeros_like(arrows), 1.0, 0.5)
    inner, other = ((line[:, 0] > 3.0) & (line[:, 0] < 6.0) for line in (one_way, two_way))
    np.testing.assert_allclose(one_way[inner, 1], 2.0, atol=0.02)  # two cells wide, from y = 1 to 3
    assert two_way[other, 1].max() < 1.7  # to the right, which is south
