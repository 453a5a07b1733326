"""MovingAI files: what is written is read back, the shortest lengths agree, and errors name the file and line."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from warehouse_env.errors import MapError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.movingai import (
    EXAMPLE_MAP,
    EXAMPLE_SCEN,
    Scenario,
    read_map,
    read_scen,
    write_map,
)

BENCHMARKS = Path(__file__).parents[2].parent / "shared" / "maps"
GOOD = "type octile\nheight 2\nwidth 3\nmap\n.@.\n...\n"


def longest_error(grid: GridMap, scenarios: list[Scenario]) -> float:
    return max(abs(grid.distance_to(s.goal)[s.start] - s.length) for s in scenarios)


# ---- maps


def test_reading_a_map(tmp_path: Path) -> None:
    path = tmp_path / "tiny.map"
    path.write_text("type octile\nheight 2\nwidth 7\nmap\n.GS@OTW\n.......\n")
    grid = read_map(path)
    assert grid.occupied.tolist() == [[False] * 3 + [True] * 4, [False] * 7]
    assert grid.name == "tiny"
    assert grid.cell_size == 1.0
    assert np.array_equal(read_map(str(path)).occupied, grid.occupied)


@given(hnp.arrays(np.bool_, st.tuples(st.integers(1, 12), st.integers(1, 12))))
def test_maps_round_trip(occupied: np.ndarray) -> None:
    occupied[0, 0] = False
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "any.map")
        write_map(GridMap(occupied), path)
        assert np.array_equal(read_map(path).occupied, occupied)
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
        (read_scen if "m.map" in text else read_map)(path)
    assert str(raised.value).startswith(f"{path}, line {line}: ")
    assert "\n" not in str(raised.value)


# ---- scenarios


def test_reading_scenarios_turns_x_and_y_into_row_and_column(tmp_path: Path) -> None:
    path = tmp_path / "s.scen"
    path.write_text("version 1\n3\tmy map.map\t32\t31\t11\t6\t7\t18\t13.65685425\n\n")
    read = [Scenario(3, "my map.map", 32, 31, (6, 11), (18, 7), 13.65685425)]
    assert read_scen(path) == read
    path.write_text("version 1\n3 map.map 32 31 11 6 7 18 13.65685425\n")
    assert read_scen(path) == [read[0]._replace(map_name="map.map")]


# ---- our shortest path against printed lengths


def test_the_shipped_example_is_a_warehouse_with_true_lengths() -> None:
    grid, listed = read_map(EXAMPLE_MAP), read_scen(EXAMPLE_SCEN)
    assert grid.shape == (40, 64)
    assert len(grid.free_cells) == (~grid.occupied).sum()
    assert len(grid.picks) >= 64
    assert len(grid.stations) >= 16
    assert len(listed) == 200
    assert {(s.map_name, s.height, s.width) for s in listed} == {(EXAMPLE_MAP.name, *grid.shape)}
    assert longest_error(grid, listed) < 1e-7  # 8 decimals are printed


@pytest.mark.skipif(not (BENCHMARKS / "random-32-32-10-random-1.scen").exists(), reason="the benchmark is not here")
def test_every_length_of_a_public_benchmark_is_reproduced() -> None:
    listed = read_scen(BENCHMARKS / "random-32-32-10-random-1.scen")
    assert len(listed) == 461
    assert longest_error(read_map(BENCHMARKS / "random-32-32-10.map"), listed) < 1e-7
