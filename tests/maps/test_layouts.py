"""Test layouts and MovingAI files: the catalogue's contract, path lengths of paper 000, file errors."""

from __future__ import annotations

import itertools
import math
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from warehouse_env.errors import ConfigError, MapError
from warehouse_env.maps import movingai
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import LAYOUTS, NAMED_TASKS, make_layout


@pytest.fixture(scope="module", params=sorted(LAYOUTS))
def layout(request: pytest.FixtureRequest) -> GridMap:
    return make_layout(request.param)


def near(cells: np.ndarray, others: np.ndarray, distance: int) -> bool:
    """Return whether any cell is closer than `distance` king's moves to another cell of `others`."""
    apart = np.abs(cells[:, None] - others[None]).max(axis=2)
    return bool(((apart < distance) & (apart > 0)).any())


# ---- the contract of every layout


def test_layout_is_connected_with_endpoints_for_64_robots(layout: GridMap) -> None:
    assert len(layout.free_cells) == (~layout.occupied).sum()
    endpoints = np.concatenate([layout.picks, layout.stations])
    assert len(np.unique(endpoints, axis=0)) == len(endpoints)
    assert len(layout.picks) >= 64
    assert len(layout.stations) >= 20
    assert np.isfinite(layout.distance_to(tuple(layout.stations[0]))[tuple(endpoints.T)]).all()
    assert not near(layout.stations, layout.stations, 3)
    assert layout.name == "random" or not near(layout.picks, layout.stations, 2)


@pytest.mark.parametrize("name", sorted(LAYOUTS))
def test_layouts_keep_their_name_and_are_reproducible(name: str) -> None:
    first, second = make_layout(name), make_layout(name)
    assert first.name == name
    assert (first.key, first.endpoints) == (second.key, second.endpoints)


# ---- named tasks


LENGTHS = {  # steps along straight and diagonal moves; of paper46 those of paper 000
    "paper46": {
        "in_zone_1": (8, 13), "in_zone_2": (10, 12), "in_zone_3": (12, 11), "cross_zone_1": (17, 30),
        "cross_zone_2": (23, 28),
    },
    "paper46_rough": {"broken_corridor": (33, 0), "ramp": (18, 0)},
}  # fmt: skip


@pytest.mark.parametrize(("name", "task"), [(n, t) for n, tasks in NAMED_TASKS.items() for t in tasks])
def test_named_tasks_have_the_stated_length(name: str, task: str) -> None:
    (start, goal), (straight, diagonal) = NAMED_TASKS[name][task], LENGTHS[name][task]
    grid, length = make_layout(name), straight + diagonal * math.sqrt(2)
    assert grid.distance_to(goal)[start] == pytest.approx(length, abs=1e-12)
    assert grid.distance_to(start)[goal] == pytest.approx(length, abs=1e-12)


# ---- single layouts


def test_paper46_has_four_zones_wide_corridors_and_aisles_of_at_least_two() -> None:
    grid = make_layout("paper46")
    assert grid.shape == (46, 46)
    assert not grid.height.any()
    assert not grid.occupied[20:26].any()
    assert not grid.occupied[:, 20:26].any()
    for rows, columns in itertools.product((slice(0, 20), slice(26, 46)), repeat=2):
        assert grid.occupied[rows, columns].sum() == 4 * 3 * 6
    assert not (set(free_gaps(grid.occupied)) | set(free_gaps(grid.occupied.T))) & {1}


def free_gaps(occupied: np.ndarray) -> list[int]:
    """Return the lengths of all runs of free cells in the rows."""
    return [len(run) for row in occupied for run in "".join("#" if o else "." for o in row).split("#") if run]


# ---- bad input


@pytest.mark.parametrize(
    ("name", "parameters", "message"),
    [
        ("papr46", {}, "unknown layout 'papr46'; did you mean paper46"),
        ("", {}, "known: aisles, blocks"),
        ("blocks", {"rowz": 3}, "did you mean rows"),
        ("blocks", {"rows": 2}, "rows=2 must be a whole number of at least 3"),
        ("blocks", {"rows": 20, "columns": 10}, "no room"),
        ("single_lane", {"rim": 2}, "rim=2"),
        ("random", {"share": 0.61}, "share"),
        ("random", {"seed": -1}, "seed=-1"),
    ],
)
def test_wrong_parameters_are_named(name: str, parameters: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        make_layout(name, **parameters)


BENCHMARKS = Path(__file__).parents[2].parent / "shared" / "maps"
GOOD = "type octile\nheight 2\nwidth 3\nmap\n.@.\n...\n"


def longest_error(grid: GridMap, scenarios: list[movingai.Scenario]) -> float:
    return max(abs(grid.distance_to(s.goal)[s.start] - s.length) for s in scenarios)


# ---- maps


def test_movingai_map_is_read(tmp_path: Path) -> None:
    path = tmp_path / "tiny.map"
    path.write_text("type octile\nheight 2\nwidth 8\nmap\n.GSE@OTW\n........\n")
    grid = movingai.read_map(path)
    assert grid.occupied.tolist() == [[False] * 4 + [True] * 4, [False] * 8]
    assert grid.name == "tiny"
    assert grid.cell_size == 1.0
    assert np.array_equal(movingai.read_map(str(path)).occupied, grid.occupied)


@given(hnp.arrays(np.bool_, st.tuples(st.integers(1, 12), st.integers(1, 12))))
def test_maps_round_trip(occupied: np.ndarray) -> None:
    occupied[0, 0] = False
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "any.map")
        movingai.write_map(GridMap(occupied), path)
        assert np.array_equal(movingai.read_map(path).occupied, occupied)
        assert os.listdir(folder) == ["any.map"]


LINE = "3\tm.map\t32\t31\t11\t6\t7\t18\t13.65"


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        (GOOD.replace("...\n", "....\n"), 6, "4 cells.*width of 3"),
        (GOOD.replace(".@.", ".x."), 5, "unknown cell 'x' in column 2"),
        (GOOD.removesuffix("...\n"), 5, "2 rows but the file holds 1"),
        (GOOD.replace("width 3", "width 1_0"), 3, "width '1_0'"),
        (GOOD.replace("height 2\n", ""), 3, "no line 'height N'"),
        ("height 999999999\nwidth 999999999\nmap\n.\n", 4, "999999999 rows"),
        ("", 1, "begins with"),
        (LINE, 1, "version 1"),
        ("version 1\n" + LINE + "\n3\tm.map\t32", 3, "3 fields instead of 9"),
        ("version 1\n" + LINE.replace("\t11\t", "\t32\t"), 2, "start x 32 is outside"),
        ("version 1\n" + LINE.replace("\t6\t", "\t-6\t"), 2, "start y '-6'"),
        ("version 1\n" + LINE.replace("13.65", "nan"), 2, "length 'nan'"),
        ("version 1\n" + LINE.replace("3\tm", "x\tm"), 2, "bucket 'x'"),
    ],
)
def test_errors_name_file_and_line(tmp_path: Path, text: str, line: int, message: str) -> None:
    path = tmp_path / "broken"
    path.write_text(text)
    with pytest.raises(MapError, match=message) as raised:
        (movingai.read_scen if "m.map" in text else movingai.read_map)(path)
    assert str(raised.value).startswith(f"{path}, line {line}: ")
    assert "\n" not in str(raised.value)


# ---- scenarios


def test_scenario_x_and_y_become_column_and_row(tmp_path: Path) -> None:
    path = tmp_path / "s.scen"
    path.write_text("version 1\n3\tmy map.map\t32\t31\t11\t6\t7\t18\t13.65685425\n\n")
    read = [movingai.Scenario(3, "my map.map", 32, 31, (6, 11), (18, 7), 13.65685425)]
    assert movingai.read_scen(path) == read
    path.write_text("version 1\n3 map.map 32 31 11 6 7 18 13.65685425\n")
    assert movingai.read_scen(path) == [read[0]._replace(map_name="map.map")]


# ---- our shortest path against printed lengths


def test_shipped_example_has_exact_lengths() -> None:
    grid, listed = movingai.read_map(movingai.EXAMPLE_MAP), movingai.read_scen(movingai.EXAMPLE_SCEN)
    assert grid.shape == (40, 64)
    assert len(grid.free_cells) == (~grid.occupied).sum()
    assert len(grid.picks) >= 64
    assert len(grid.stations) >= 16
    assert len(listed) == 200
    assert {(s.map_name, s.height, s.width) for s in listed} == {(movingai.EXAMPLE_MAP.name, *grid.shape)}
    assert longest_error(grid, listed) < 1e-7  # files have 8 decimals


@pytest.mark.skipif(not (BENCHMARKS / "random-32-32-10-random-1.scen").exists(), reason="the benchmark is not here")
def test_lengths_of_the_public_benchmark_are_reproduced() -> None:
    listed = movingai.read_scen(BENCHMARKS / "random-32-32-10-random-1.scen")
    assert len(listed) == 461
    assert longest_error(movingai.read_map(BENCHMARKS / "random-32-32-10.map"), listed) < 1e-7
