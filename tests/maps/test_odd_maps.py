"""Maps, scenarios and layouts: whatever comes in works, or a WarehouseError says in one sentence what is wrong."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given

from tests.odd import values, works_or_says
from warehouse_env.errors import ConfigError, MapError, WarehouseError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.maps.movingai import Scenario, read_map, read_scen, write_map, write_scen

GOOD = Scenario(1, "m.map", 7, 6, (0, 0), (1, 1), 2.0)


@given(values)
def test_any_path_and_anything_to_write(value: Any) -> None:
    """A path that could be written is left out: it would be."""
    grid = GridMap(np.zeros((4, 5)))
    for read in (read_map, read_scen):
        works_or_says(lambda read=read: read(value))
    if not isinstance(value, (str, Path)) or "\0" in str(value) or "\ud800" in str(value):
        for write in (lambda: write_map(grid, value), lambda: write_scen([GOOD], value)):
            with pytest.raises(WarehouseError):
                write()
    with tempfile.TemporaryDirectory() as folder:
        works_or_says(lambda: write_map(value, Path(folder, "m")))
        works_or_says(lambda: write_scen(value, Path(folder, "m")))


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: read_map("\0"), r"'\\x00' is no file name"),
        (lambda: read_map(3), "3 is no file name"),
        (lambda: GridMap(np.zeros((2, 2)), cell_size=10**400), "cell_size=10"),
        (lambda: GridMap(np.zeros((2, 2)), height=[[10**400] * 2] * 2), "height must be a table"),
        (lambda: GridMap(np.zeros((2, 2)), height=np.full((2, 2), 1e30)), r"height at cell \(0, 0\)"),
        (lambda: GridMap(np.zeros((2, 2)), picks=np.array([[0, 2**64 - 1]], np.uint64)), "picks cell"),
        (lambda: GridMap(np.zeros((2, 2)), name=3), "name=3 must be a text"),  # type: ignore[arg-type]
        (lambda: write_map(3, "m.map"), "3 is no GridMap"),  # type: ignore[arg-type]
        (lambda: make_layout({}), "unknown layout {}"),  # type: ignore[arg-type]
        (lambda: make_layout("open", rows=10**12), "rows=1000000000000 must be a whole number of at most 4096"),
        (lambda: make_layout("single_lane", lane=10**12), "lane=1000000000000"),
        (lambda: make_layout("random", rows=np.uint64(2**64 - 1)), "rows=18446744073709551615"),
        (lambda: make_layout("blocks", corridor_stations=2), "corridor_stations=2 must be True or False"),
    ],
)
def test_what_was_found(make: Callable[[], Any], sentence: str) -> None:
    """Each ended in another error, a warning or an endless allocation once."""
    with pytest.raises((ConfigError, MapError), match=sentence):
        make()


def test_numbers_of_numpy_are_good_sizes() -> None:
    grid = make_layout("blocks", rows=np.int8(100), columns=np.uint8(200))
    assert grid.shape == (100, 200)
