"""All plans between a floor's endpoints by one planner: made once, kept in a file, read once a process.

The table of `paper46` under the default planner ships with the package. Others lie in the user's cache.
"""

from __future__ import annotations

import hashlib
import os
import zipfile
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from platformdirs import user_cache_dir

from warehouse_env.files import complete_file
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning.plan import Planner

CACHE_FORMAT = 3  # raise it when a planner's result changes for the same key, or the files' form
SHIPPED = Path(__file__).parent / "tables"
_MOVE_OF = {(row, column): number for number, (row, column) in enumerate(MOVES.tolist())}


class PlanTable(NamedTuple):
    """The plans between E endpoints, ordered by goal, then by start."""

    number: dict[Cell, int]  # of each endpoint
    begins: NDArray[np.int64]  # [E * E + 1], of each plan's moves; a plan without moves is not known
    moves: NDArray[np.uint8]  # of all plans, as indices into MOVES

    def cells(self, start: Cell, goal: Cell) -> NDArray[np.int64] | None:
        """Return the plan int64[L, 2] from start to goal, or None."""
        first, last = self.number.get(start), self.number.get(goal)
        if first is None or last is None:
            return None
        plan = last * len(self.number) + first
        moves = self.moves[self.begins[plan] : self.begins[plan + 1]]
        if not len(moves):
            return None
        cells = np.empty((len(moves) + 1, 2), np.int64)
        cells[0] = start
        cells[1:] = start + np.cumsum(MOVES[moves], axis=0)
        return cells


def cache_directory() -> Path:
    """Return the folder of the user's plan tables: $WAREHOUSE_CACHE_DIR, or the user's cache folder."""
    return Path(os.environ.get("WAREHOUSE_CACHE_DIR") or user_cache_dir("warehouse_env"))


def _name(grid: GridMap, planner: Planner) -> str:
    """Return the name of the file that holds a floor's plans by a planner."""
    text = f"{CACHE_FORMAT} {grid.key} {planner.key} {grid.endpoints[2]}"
    return f"plans-{hashlib.blake2b(text.encode(), digest_size=8).hexdigest()}.npz"


def read_table(grid: GridMap, planner: Planner) -> PlanTable | None:
    """Return the table of a floor and a planner, the user's own before the shipped one; None without a whole one."""
    name, places = _name(grid, planner), tuple(grid.endpoints[2])
    files = (folder / name for folder in (cache_directory(), SHIPPED))
    return next((table for file in files if file.is_file() and (table := _read(file, places)) is not None), None)


@lru_cache(maxsize=16)
def _read(file: Path, places: tuple[Cell, ...]) -> PlanTable | None:
    try:
        with np.load(file) as table:
            begins = np.concatenate([[0], np.cumsum(table["lengths"], dtype=np.int64)])
            moves = table["moves"]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    whole = moves.dtype == np.uint8 and (len(begins), len(moves)) == (len(places) ** 2 + 1, begins[-1])
    return PlanTable({cell: number for number, cell in enumerate(places)}, begins, moves) if whole else None


def write_table(grid: GridMap, planner: Planner, plans: Iterable[NDArray[np.int64]]) -> None:
    """Write plans, cells int64[L, 2] in the order of PlanTable, into the user's cache."""
    moves = [_moves(cells) for cells in plans]
    lengths = np.array([len(one) for one in moves], np.uint32)
    with complete_file(cache_directory() / _name(grid, planner)) as part, part.open("wb") as file:
        np.savez_compressed(file, lengths=lengths, moves=np.concatenate(moves))
    _read.cache_clear()


def _moves(cells: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Return a plan's moves, none if one of them is not to a neighbouring cell."""
    steps = np.diff(cells, axis=0).tolist()
    known = [_MOVE_OF.get((row, column), -1) for row, column in steps]
    return np.array([] if -1 in known else known, np.uint8)
