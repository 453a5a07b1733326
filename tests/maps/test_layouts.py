"""Floors by name and file: promises of the catalogue, the lengths of paper 000, MovingAI files and their errors."""

from __future__ import annotations

import itertools
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
    """Is any cell closer than `distance` (king's moves) to any of the others, itself left out?"""
    apart = np.abs(cells[:, None] - others[None]).max(axis=2)
    return bool(((apart < distance) & (apart > 0)).any())


# ---- the contract of every layout


def test_the_floor_is_connected_and_its_endpoints_are_distinct_and_enough_for_64_robots(layout: GridMap) -> None:
    assert len(layout.free_cells) == (~layout.occupied).sum()
    endpoints = np.concatenate([layout.picks, layout.stations])
    assert len(np.unique(endpoints, axis=0)) == len(endpoints)
    assert len(layout.picks) >= 64
    assert len(layout.stations) >= 20
    assert np.isfinite(layout.distance_to(tuple(layout.stations[0]))[tuple(endpoints.T)]).all()
    assert not near(layout.stations, layout.stations, 3)
    assert layout.name == "random" or not near(layout.picks, layout.stations, 2)


@pytest.mark.parametrize("name", sorted(LAYOUTS))
def test_names_agree_and_floors_are_reproducible(name: str) -> None:
    first, second = make_layout(name), make_layout(name)
    assert first.name == name
    assert (first.key, first.endpoints) == (second.key, second.endpoints)


# ---- named tasks


@pytest.mark.parametrize(("name", "task"), [(n, t) for n, tasks in NAMED_TASKS.items() for t in tasks])
def test_named_tasks_have_their_length(name: str, task: str) -> None:
    start, goal, length = NAMED_TASKS[name][task]
    grid = make_layout(name)
    assert grid.distance_to(goal)[start] == pytest.approx(length, abs=1e-12)
    assert grid.distance_to(start)[goal] == pytest.approx(length, abs=1e-12)


# ---- what each layout is


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
    """The lengths of all runs of free cells along the rows."""
    return [len(run) for row in occupied for run in "".join("#" if o else "." for o in row).split("#") if run]


# ---- bad input


@pytest.mark.parametrize(
    ("name", "parameters", "words"),
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
def test_bad_parameters_are_named(name: str, parameters: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        make_layout(name, **parameters)


BENCHMARKS = Path(__file__).parents[2].parent / "shared" / "maps"
GOOD = "type octile\nheight 2\nwidth 3\nmap\n.@.\n...\n"


def longest_error(grid: GridMap, scenarios: list[movingai.Scenario]) -> float:
    return max(abs(grid.distance_to(s.goal)[s.start] - s.length) for s in scenarios)


# ---- maps


def test_reading_a_map(tmp_path: Path) -> None:
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
    ("text", "line", "words"),
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
def test_broken_files_name_file_and_line(tmp_path: Path, text: str, line: int, words: str) -> None:
    path = tmp_path / "broken"
    path.write_text(text)
    with pytest.raises(MapError, match=words) as raised:
        (movingai.read_scen if "m.map" in text else movingai.read_map)(path)
    assert str(raised.value).startswith(f"{path}, line {line}: ")
    assert "\n" not in str(raised.value)


# ---- scenarios


def test_reading_scenarios_turns_x_and_y_into_row_and_column(tmp_path: Path) -> None:
    path = tmp_path / "s.scen"
    path.write_text("version 1\n3\tmy map.map\t32\t31\t11\t6\t7\t18\t13.65685425\n\n")
    read = [movingai.Scenario(3, "my map.map", 32, 31, (6, 11), (18, 7), 13.65685425)]
    assert movingai.read_scen(path) == read
    path.write_text("version 1\n3 map.map 32 31 11 6 7 18 13.65685425\n")
    assert movingai.read_scen(path) == [read[0]._replace(map_name="map.map")]


# ---- our shortest path against printed lengths


def test_the_shipped_example_is_a_warehouse_with_true_lengths() -> None:
    grid, listed = movingai.read_map(movingai.EXAMPLE_MAP), movingai.read_scen(movingai.EXAMPLE_SCEN)
    assert grid.shape == (40, 64)
    assert len(grid.free_cells) == (~grid.occupied).sum()
    assert len(grid.picks) >= 64
    assert len(grid.stations) >= 16
    assert len(listed) == 200
    assert {(s.map_name, s.height, s.width) for s in listed} == {(movingai.EXAMPLE_MAP.name, *grid.shape)}
    assert longest_error(grid, listed) < 1e-7  # 8 decimals are printed


@pytest.mark.skipif(not (BENCHMARKS / "random-32-32-10-random-1.scen").exists(), reason="the benchmark is not here")
def test_every_length_of_a_public_benchmark_is_reproduced() -> None:
    listed = movingai.read_scen(BENCHMARKS / "random-32-32-10-random-1.scen")
    assert len(listed) == 461
    assert longest_error(movingai.read_map(BENCHMARKS / "random-32-32-10.map"), listed) < 1e-7
