"""Proposed pick faces and stations, by hand: beside what stands free and is long enough, however the cells lie."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from warehouse_env.maps.halls.hall import Hall, read_hall
from warehouse_env.maps.halls.map_server import Occupancy, write_occupancy
from warehouse_env.maps.halls.proposed import propose


def drawn(folder: Path, *blocks: tuple[float, float, float, float]) -> Hall:
    """Read a hall of 9 x 12 m with pixels of 0.1 m: walls of 0.3 m, and blocks (top, left, down, right)."""
    (folder / "hall.oneway").write_text(("." * 12 + "\n") * 9)  # with it cells begin at the corner
    values = np.zeros((90, 120), np.int8)
    for top, left, down, right in ((0, 0, 9, 0.3), (0, 0, 0.3, 12), (8.7, 0, 9, 12), (0, 11.7, 9, 12), *blocks):
        values[round(10 * top) : round(10 * down), round(10 * left) : round(10 * right)] = 100
    write_occupancy(Occupancy(values, 0.1), folder / "hall.yaml")
    return read_hall(str(folder / "hall.yaml"))


def picks(found: Hall) -> list[tuple[int, ...]]:
    return sorted(map(tuple, found.grid.picks.tolist()))


def test_places_are_beside_straight_obstacles() -> None:
    occupied = np.zeros((9, 11), np.bool_)
    occupied[4, 3:8] = True  # a rack; the pillar is none
    occupied[1, 5] = True
    found, stations = propose(occupied, np.zeros_like(occupied), occupied, 1.0)
    assert sorted(map(tuple, found.tolist())) == [(row, column) for row in (3, 5) for column in range(3, 8)]
    assert {column for _, column in stations.tolist()} == {1, 9}


def test_racks_that_touch_a_wall_as_cells_only_have_faces(tmp_path: Path) -> None:
    """A gap of 0.4 m to the wall is floor in no cell: as cells the rack is a piece of the wall, as pixels it is not."""
    found = drawn(tmp_path, (1.3, 4, 2, 8), (6, 5, 6.9, 9))
    assert not found.grid.occupied[2, 4:8].any()
    assert found.grid.occupied[1, 4:8].all()
    above = [(2, column) for column in range(4, 8)]
    assert picks(found) == above + [(row, column) for row in (5, 7) for column in range(5, 9)]
    joined = drawn(tmp_path, (0, 4, 2, 8), (6, 5, 6.9, 9))  # its pixels touch the wall's: it is one
    assert picks(joined) == picks(found)[4:]


def test_no_pick_face_is_in_the_only_way_to_a_room() -> None:
    """Whoever stood in the gap below the rack would shut the room behind it; where that is all, it is taken."""
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
