"""MovingAI benchmark files: `.map` floors, read and written, and `.scen` scenarios, read.

Formats: Sturtevant, "Benchmarks for Grid-Based Pathfinding", 2012. A scenario's coordinates are x = column, y = row,
and its length is the shortest by octile moves without cutting corners, which are the moves of eq. 26 (paper 000).
"""

import math
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from warehouse_env.errors import MapError, shown
from warehouse_env.files import as_number, companion, path_of, read_text, write_text
from warehouse_env.maps import one_way
from warehouse_env.maps.discs import SUFFIX, read_discs, write_beside
from warehouse_env.maps.grid_map import Cell, GridMap

# S is swamp, which the benchmarks' shortest paths treat as floor, or a pick-up point of the League of Robot Runners;
# E is its delivery point.
FREE = ".GSE"
BLOCKED = "@OTW"
EXAMPLE_MAP = Path(__file__).parent / "data" / "warehouse-40-64.map"
EXAMPLE_SCEN = Path(__file__).parent / "data" / "warehouse-40-64.scen"
_LARGEST_FILE = 64_000_000  # [bytes]


class Scenario(NamedTuple):
    """One line of a `.scen` file; start and goal are (row, column), length [cells] is the shortest path's."""

    bucket: int
    map_name: str
    width: int
    height: int
    start: Cell
    goal: Cell
    length: float


def read_map(path: str | os.PathLike[str]) -> GridMap:
    """Return the floor of a `.map` file, named after the file, with default endpoints and cells of 1 m.

    One-way cells stand in a file NAME.oneway beside it (maps/one_way.py), discs in NAME.discs.json (maps/discs.py), if
    there are such files. MapError, naming the file and line, if it cannot be read or breaks the format.
    """
    path = path_of(path, MapError)
    lines = _read_lines(path, "map")
    height, width, first = _read_header(path, lines)
    body = lines[first:]
    if len(body) != height:
        at = len(lines) if len(body) < height else first + height + 1
        raise _bad(path, at, f"the header announces {height} rows but the file holds {len(body)}")
    for number, line in enumerate(body, start=first + 1):
        if len(line) != width:
            raise _bad(path, number, f"this row has {len(line)} cells; the header announces a width of {width}")
        for column, letter in enumerate(line, start=1):
            if letter not in FREE + BLOCKED:
                known = " ".join(FREE + BLOCKED)
                raise _bad(path, number, f"unknown cell {letter!r} in column {column}; known cells: {known}")
    try:
        occupied = np.array([[letter in BLOCKED for letter in line] for line in body])
        arrows, beside = companion(path, one_way.SUFFIX), companion(path, SUFFIX)
        directions = one_way.read(arrows, occupied.shape) if arrows.exists() else None
        discs = read_discs(beside) if beside.exists() else None
        return GridMap(occupied, name=path.stem, one_way=directions, discs=discs)  # type: ignore[arg-type]
    except MapError as error:
        raise MapError(f"{path}: {error}") from None


def _read_header(path: Path, lines: list[str]) -> tuple[int, int, int]:
    """Return (height, width, index of the first line after `map`)."""
    sizes: dict[str, int] = {}
    for number, line in enumerate(lines, start=1):
        words = line.lower().split()
        if words == ["map"]:
            for key in ("height", "width"):
                if key not in sizes:
                    raise _bad(path, number, f"the header has no line '{key} N' before 'map'")
            return sizes["height"], sizes["width"], number
        if len(words) == 2 and words[0] in ("height", "width"):
            sizes[words[0]] = _whole(path, number, words[1], words[0], least=1)
        elif words and words[0] != "type":
            break
    raise _bad(path, number, "a .map begins with the lines 'type octile', 'height N', 'width N', 'map'")


def write_map(grid: GridMap, path: str | os.PathLike[str]) -> None:
    """Write the shelves as a `.map` file (`@` shelf, `.` floor), whole or not at all; MapError if it cannot be written.

    One-way cells are written to NAME.oneway beside it, discs to NAME.discs.json. The format holds neither heights, cell
    size nor endpoints: these are lost. MapError for discs on cells of another size than 1 m.
    """
    if not isinstance(grid, GridMap):
        raise MapError(f"{shown(grid)} is no GridMap, so it cannot be written as a .map file")
    if len(grid.discs) and grid.cell_size != 1.0:
        raise MapError(
            f"map {shown(grid.name)} has discs and cells of {grid.cell_size:g} m; a .map holds no such, write a .yaml"
        )
    rows, columns = grid.shape
    floor = ["".join("@" if taken else "." for taken in row) for row in grid.walls.tolist()]
    path = path_of(path, MapError)
    header = ["type octile", f"height {rows}", f"width {columns}", "map"]
    write_text(path, "\n".join([*header, *floor]) + "\n")
    one_way.write_beside(path, grid.one_way)
    write_beside(path, grid.discs)


def read_scen(path: str | os.PathLike[str]) -> list[Scenario]:
    """Return the scenarios of a `.scen` file; MapError, naming the file and line, if it breaks the format."""
    path = path_of(path, MapError)
    lines = _read_lines(path, "scenario")
    if lines[0].lower().split() not in (["version", "1"], ["version", "1.0"]):
        raise _bad(path, 1, "a .scen begins with the line 'version 1'")
    numbered = enumerate(lines[1:], start=2)
    return [_scenario(path, number, line) for number, line in numbered if line.strip()]


def _scenario(path: Path, number: int, line: str) -> Scenario:
    """Return one line of a `.scen` file."""
    words = line.split("\t") if "\t" in line else line.split()  # as MovingAI's own reader
    if len(words) != 9:
        wanted = "bucket, map, width, height, start x, start y, goal x, goal y, length"
        raise _bad(path, number, f"{len(words)} fields instead of 9, parted by tabs ({wanted})")
    bucket = _whole(path, number, words[0], "bucket", least=0)
    width = _whole(path, number, words[2], "width", least=1)
    height = _whole(path, number, words[3], "height", least=1)
    names = ("start x", "start y", "goal x", "goal y")
    places = [_whole(path, number, word, name, least=0) for word, name in zip(words[4:8], names, strict=True)]
    for value, name, limit in zip(places, names, (width, height) * 2, strict=True):
        if value >= limit:
            raise _bad(path, number, f"{name} {value} is outside the map of {width} x {height} cells")
    length = as_number(words[8])
    if not 0 <= length < math.inf:
        raise _bad(path, number, f"length {shown(words[8])} must be a finite number of at least 0")
    return Scenario(bucket, words[1], width, height, (places[1], places[0]), (places[3], places[2]), length)


def _bad(path: Path, line: int, reason: str) -> MapError:
    return MapError(f"{path}, line {line}: {reason}")


def _whole(path: Path, line: int, text: str, what: str, least: int) -> int:
    # isascii and isdigit refuse what int() would let pass: signs, underscores, spaces, other scripts' digits
    text = text.strip()
    if not (text.isascii() and text.isdigit() and len(text) < 10 and int(text) >= least):
        raise _bad(path, line, f"{what} {shown(text)} must be a whole number of at least {least}")
    return int(text)


def _read_lines(path: Path, kind: str) -> list[str]:
    """Return the lines of a text file without blanks at their ends; at least one."""
    text = read_text(path, f"{kind} file", _LARGEST_FILE)
    return [line.strip() for line in text.rstrip().split("\n")]
