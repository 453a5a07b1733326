"""Maps that several papers' tables share: random clutter of a given share, rectangles, drawings."""

from __future__ import annotations

import itertools
import math

import numpy as np

from train.tables.study import TableSetting, TableTask
from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import Cell, GridMap

_TRIES = 10_000  # draws for one setting


def clutter_task(size: int, share: float, seed: int, start: Cell | None = None, goal: Cell | None = None) -> TableTask:
    """Return a square floor with shelves on a share of its cells, drawn at random, and a path from start to goal.

    size: cells of a side; share: of all cells, 0 to below 1; start and goal: the upper left and lower right corners if
    left out. Equal arguments give equal maps. ConfigError where no draw leaves a path.
    """
    start = start if start is not None else (0, 0)
    goal = goal if goal is not None else (size - 1, size - 1)
    cells = size * size
    others = np.setdiff1d(np.arange(cells), [start[0] * size + start[1], goal[0] * size + goal[1]])
    count = round(share * cells)
    if not 0 <= count <= len(others):
        raise ConfigError(f"share={share} of {size} x {size} cells leaves no room for start and goal; lower it")
    for draw in range(_TRIES):
        occupied = np.zeros(cells, dtype=np.bool_)
        occupied[np.random.default_rng([size, count, seed, draw]).permutation(others)[:count]] = True
        grid = GridMap(occupied.reshape(size, size), name=f"clutter {size}x{size} {100 * share:g}% no. {seed + 1}")
        if math.isfinite(float(grid.distance_to(goal)[start])):
            return TableTask(grid, start, goal)
    raise ConfigError(f"share={share} of {size} x {size} cells left no way in {_TRIES} draws; lower it")


def clutter(size: int, share: float, maps: int, start: Cell | None = None, goal: Cell | None = None) -> TableSetting:
    """Return a setting of several random floors of one kind, named "20x20 35%"; arguments as clutter_task."""
    tasks = tuple(clutter_task(size, share, seed, start, goal) for seed in range(maps))
    return TableSetting(f"{size}x{size} {100 * share:g}%", tasks)


def draw_rectangle(rng: np.random.Generator, size: int, least: int, most: int) -> tuple[slice, slice]:
    """Return rows and columns of a rectangle of `least` to `most` cells a side, anywhere on a square floor."""
    sides = rng.integers(least, most + 1, 2).tolist()
    row, column = (int(rng.integers(0, size - side + 1)) for side in sides)
    return slice(row, row + sides[0]), slice(column, column + sides[1])


def drawn_map(picture: str, name: str) -> GridMap:
    """Return the map of a drawing: a line a row, "#" a shelf, "." free; ConfigError for other signs or ragged lines."""
    lines = [line.strip() for line in picture.strip().splitlines()]
    signs = set(itertools.chain.from_iterable(lines))
    if not signs <= {"#", "."} or len({len(line) for line in lines}) != 1:
        raise ConfigError(f"map {name!r} must be lines of equal length, made of '#' and '.'")
    return GridMap(np.array([[sign == "#" for sign in line] for line in lines]), name=name)
