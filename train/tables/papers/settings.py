"""Floors of the tables: the named warehouse, random floors as the papers describe theirs, and those of all planners.

Equal arguments give equal maps. A task without other ends leads from the upper left to the lower right corner.
"""

import dataclasses
import math
import zlib
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from train.tables.study import TableSetting, TableTask
from warehouse_env.errors import ConfigError
from warehouse_env.maps.generators import blocks, random_floor
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.layouts import NAMED_TASKS, make_layout
from warehouse_env.maps.moves import label_regions

Settings = tuple[TableSetting, ...]
Occupied = NDArray[np.bool_]
_TRIES = 20_000  # draws for one map or one setting


def _corners(size: int) -> tuple[Cell, Cell]:
    return (0, 0), (size - 1, size - 1)


def _first_with_a_path(draw: Callable[[int], Occupied], name: str, start: Cell, goal: Cell) -> TableTask:
    """Return the first drawn floor with a path from start to goal; ConfigError if no draw has one."""
    for number in range(_TRIES):
        grid = GridMap(draw(number), name=name)
        if math.isfinite(float(grid.distance_to(goal)[start])):
            return TableTask(grid, start, goal)
    raise ConfigError(f"floor {name!r} has no path from {start} to {goal} in {_TRIES} draws; lower its share")


def clutter_task(size: int, share: float, seed: int, ends: tuple[Cell, Cell] | None = None) -> TableTask:
    """Return a square floor with shelves on a share of its cells (0 to below 1), drawn at random, and a path."""
    start, goal = ends or _corners(size)
    others = np.setdiff1d(np.arange(size * size), [start[0] * size + start[1], goal[0] * size + goal[1]])
    count = round(share * size * size)

    def draw(number: int) -> Occupied:
        occupied = np.zeros(size * size, dtype=np.bool_)
        occupied[np.random.default_rng([size, count, seed, number]).permutation(others)[:count]] = True
        return occupied.reshape(size, size)

    return _first_with_a_path(draw, f"clutter {size}x{size} {100 * share:g}% no. {seed + 1}", start, goal)


def clutter(size: int, shares: Iterable[float], maps: int, ends: tuple[Cell, Cell] | None = None) -> Settings:
    """Return a setting of several random floors for each share, named "20x20 35%"."""
    return tuple(
        TableSetting(
            f"{size}x{size} {100 * share:g}%", tuple(clutter_task(size, share, seed, ends) for seed in range(maps))
        )
        for share in shares
    )


def _draw_rectangle(rng: np.random.Generator, size: int, least: int, most: int) -> tuple[slice, slice]:
    """Return rows and columns of a rectangle of `least` to `most` cells a side, anywhere on a square floor."""
    sides = rng.integers(least, most + 1, 2).tolist()
    row, column = (int(rng.integers(0, size - side + 1)) for side in sides)
    return slice(row, row + sides[0]), slice(column, column + sides[1])


def drawn_map(picture: str, name: str) -> GridMap:
    """Return the map of a drawing: one line per row, "#" is a shelf, all else is free."""
    return GridMap(np.array([[sign == "#" for sign in line] for line in picture.split()]), name=name)


# Paper 000: the four zones of paper46. No path on a grid has the printed length 26.6820 of path 4; these two cells have
# the next shorter length on our map, 11 + 11 sqrt 2.
PATH_4: tuple[Cell, Cell] = ((1, 0), (13, 21))


def on_paper46(*ends: str | tuple[Cell, Cell]) -> Settings:
    """Return "path 1", "path 2" and so on: named tasks of paper46, or a start and a goal there."""
    grid, named = make_layout("paper46"), NAMED_TASKS["paper46"]
    cells = [named[one] if isinstance(one, str) else one for one in ends]
    return tuple(TableSetting(f"path {k}", (TableTask(grid, *one),)) for k, one in enumerate(cells, start=1))


def clutter_and_blocks() -> Settings:
    """Return both readings of paper 001's "obstacles placed at random, free to occupied cells as 6 to 4"."""
    return *clutter(20, (0.4,), 24), TableSetting("20x20 40% in blocks", tuple(map(_block_task, range(24))))


def _block_task(seed: int) -> TableTask:
    """Return a 20 x 20 floor, 40% of it under rectangles of 1 to 4 cells a side; the corners stay free."""

    def draw(number: int) -> Occupied:
        rng, occupied = np.random.default_rng([20, seed, number]), np.zeros((20, 20), dtype=np.bool_)
        while (missing := 160 - int(occupied.sum())) > 0:
            block = np.zeros_like(occupied)
            block[_draw_rectangle(rng, 20, 1, 4)] = True
            block[0, 0] = block[-1, -1] = False
            if int((block & ~occupied).sum()) <= missing:
                occupied |= block
        return occupied

    return _first_with_a_path(draw, f"blocks 20x20 40% no. {seed + 1}", *_corners(20))


BESIDE, IN_FRONT = "goal before a shelf", "shelf in between"


def walker_floors() -> Settings:
    """Return maps for a walker along the force: shelves behind the goal, across its path, scattered, in rows."""
    beside, between = [], []
    for column in range(2, 18):
        behind, wall = np.zeros((2, 20, 20), dtype=np.bool_)
        behind[0, column] = True
        half = 1 + column % 6  # of the wall's width, so that the detours differ
        wall[10, max(0, column - half) : column + half + 1] = True
        ends = (18, column), (1, column)
        beside.append(TableTask(GridMap(behind, name=f"{BESIDE} {column}"), *ends))
        between.append(TableTask(GridMap(wall, name=f"{IN_FRONT} {column}"), *ends))
    grid = make_layout("narrow")
    pairs = np.random.default_rng(1).integers(0, len(grid.free_cells), (48, 2))
    cells = [(int(row), int(column)) for row, column in grid.free_cells]
    return (
        TableSetting(BESIDE, tuple(beside)),
        TableSetting(IN_FRONT, tuple(between)),
        *clutter(20, (0.1,), 48),
        TableSetting("narrow", tuple(TableTask(grid, cells[a], cells[b]) for a, b in pairs)),
    )


_OPEN, _BAR, _BACK = "." * 20, "......#########.....", ".............##....."
_E = "\n".join([_OPEN] * 4 + ([_BAR] * 2 + [_BACK] * 3) * 2 + [_BAR] * 2 + [_OPEN] * 4)
_U = "\n".join([_OPEN] * 5 + [_BAR] * 2 + [_BACK] * 6 + [_BAR] * 2 + [_OPEN] * 5)


def _scattered_task(size: int, share: float, largest: int, seed: int) -> TableTask:
    """Return a square floor with random rectangles of 1 to `largest` cells a side on at least a share of its cells.

    No rectangle closes the path between the corners or touches their 2 x 2 cells.
    """
    rng, (start, goal) = np.random.default_rng(seed), _corners(size)
    occupied = np.zeros((size, size), dtype=np.bool_)
    while occupied.sum() < share * size * size:
        more = occupied.copy()
        more[_draw_rectangle(rng, size, 1, largest)] = True
        if more[:2, :2].any() or more[-2:, -2:].any():
            continue
        region = label_regions(~more)
        if region[start] == region[goal]:
            occupied = more
    return TableTask(GridMap(occupied, name=f"scattered {size}x{size} no. {seed}"), start, goal)


def traps_and_clutter() -> Settings:
    """Return the four maps of paper 003: two obstacles that open towards the start, light clutter, heavy clutter."""
    return (
        TableSetting("E-shaped", (TableTask(drawn_map(_E, "E-shaped"), (12, 2), (8, 18)),)),
        TableSetting("concave", (TableTask(drawn_map(_U, "concave"), (10, 2), (9, 18)),)),
        TableSetting("simple 20x20", (_scattered_task(20, 0.2, 3, 0),)),
        TableSetting("complex 50x50", (_scattered_task(50, 0.3, 5, 0),)),
    )


def more_clutter() -> Settings:
    """Return more maps like the complex one, and as many with a fifth covered: open space misleads the network."""
    return tuple(
        TableSetting(name, tuple(_scattered_task(50, share, 5, 1 + seed) for seed in range(12)))
        for name, share in (("50x50 30%", 0.3), ("50x50 20%", 0.2))
    )


# Table 1 of paper 004: the kind of floor, its size, and the length of the reference's best path.
OPTIMA = {
    "20x20, blocks [12]": 6 + 16 * math.sqrt(2), "20x20, scattered [9]": 4 + 17 * math.sqrt(2),
    "30x30, scattered [7]": 10 + 24 * math.sqrt(2), "30x30, blocks [12]": 8 + 25 * math.sqrt(2),
}  # fmt: skip
_BLOCKS = {20: 20, 30: 36}  # rectangles tried on a floor
_SCATTERED = {20: 0.12, 30: 0.14}  # share of scattered cells


def _apart_blocks(size: int, draw: int) -> GridMap:
    """Return a floor with rectangles of 2 to 5 cells a side, each with free cells around it."""
    rng, occupied = np.random.default_rng([size, draw]), np.zeros((size, size), dtype=np.bool_)
    for _ in range(_BLOCKS[size]):
        block = _draw_rectangle(rng, size, 2, 5)
        if not occupied[tuple(slice(max(side.start - 1, 0), side.stop + 1) for side in block)].any():
            occupied[block] = True
    occupied[0, 0] = occupied[-1, -1] = False
    return GridMap(occupied, name=f"blocks {size}x{size}")


def _with_optimum(setting: str) -> TableSetting:
    """Return eight random maps of the kind of a line of table 1, whose shortest path has the length in OPTIMA."""
    size, found = int(setting[:2]), list[TableTask]()
    start, goal = _corners(size)
    for draw in range(_TRIES):
        if "blocks" in setting:
            task = TableTask(_apart_blocks(size, draw), start, goal)
        else:
            task = clutter_task(size, _SCATTERED[size], draw)
        if abs(float(task.grid.distance_to(goal)[start]) - OPTIMA[setting]) < 1e-6:
            found.append(task)
        if len(found) == 8:
            break
    return TableSetting(setting, tuple(found))


def floors_of_references() -> Settings:
    """Return the four settings of table 1 of paper 004."""
    return tuple(map(_with_optimum, OPTIMA))


PAIRS = 200


def movingai_warehouse() -> GridMap:
    """Return the MovingAI map warehouse-10-20-10-2-2 (Stern et al. 2019), cell for cell: 170 x 84.

    It has 20 rows of 10 shelves of 10 x 2 cells each, aisles and two rims of 2, two wide rims, and a wall around.
    """
    inner = blocks(
        82, 168, block_rows=2, block_columns=10, aisle=2, cross=2, zone_rows=20, zone_columns=10, rim_rows=2,
        rim_columns=25, corridor_stations=False,
    )  # fmt: skip
    return GridMap(np.pad(inner.occupied, 1, constant_values=True), name="warehouse-10-20-10-2-2")


def _clutter(share: float, name: str) -> GridMap:
    """Return 46 x 46 cells, a share of them shelves drawn at random; cells that these cut off are filled."""
    return dataclasses.replace(random_floor(46, 46, share=share, seed=0), name=name)


def pairs_on_floors() -> tuple[TableSetting, ...]:
    """Return the floors, each with pairs of distinct cells drawn evenly from its largest region."""
    floors = (make_layout("paper46"), make_layout("narrow"), _clutter(0.20, "clutter20"), _clutter(0.35, "clutter35"))
    made = []
    for grid in (*floors, movingai_warehouse()):
        rng = np.random.default_rng([0, zlib.crc32(grid.name.encode())])
        pairs = [grid.free_cells[rng.choice(len(grid.free_cells), 2, replace=False)].tolist() for _ in range(PAIRS)]
        tasks = (TableTask(grid, (start[0], start[1]), (goal[0], goal[1])) for start, goal in pairs)
        made.append(TableSetting(grid.name, tuple(tasks)))
    return tuple(made)
