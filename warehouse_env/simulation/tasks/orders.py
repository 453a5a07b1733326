"""Orders: what to fetch, from where, to where, and until when; read from and written to CSV files.

The first line names FIELDS, each further line is one order:

    release_s,picks,drop,due_s,weight_kg
    0,12:7 15:7,1:9,900,120

Cells are row:column; an order with several pick faces visits them in this order. ALLOCATORS assign orders to robots, by
the distance from each robot to each order's first pick face.
"""

import csv
import io
import multiprocessing
import re
import warnings
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError, MapWarning, check_known, shown
from warehouse_env.files import as_number, complete_file, read_text
from warehouse_env.maps.grid_map import Cell, GridMap

FIELDS = ("release_s", "picks", "drop", "due_s", "weight_kg")
_LARGEST_FILE = 256_000_000  # [bytes]
_LATEST = 1e9  # [s]
_CELL = re.compile(r"(-?\d{1,9}):(-?\d{1,9})", re.ASCII)


class Order(NamedTuple):
    """One robot visits the pick faces in turn and drops the goods at a station."""

    release: float  # [s] after the reset at which it becomes known
    picks: tuple[Cell, ...]
    drop: Cell
    due: float  # [s] after the reset
    weight: float  # [kg], an equal part from each pick face


def read_orders(path: str | Path) -> tuple[Order, ...]:
    """Return the orders of a file, sorted by release; ConfigError names the line that is wrong."""
    text, what = read_text(path, "orders", _LARGEST_FILE, ConfigError), f"orders {path}"
    (first, names), *lines = _rows(text, what) or [(1, [])]
    if sorted(map(str.lower, names)) != sorted(FIELDS):
        raise ConfigError(f"{what}, line {first} must name the columns {', '.join(FIELDS)}")
    if not lines:
        raise ConfigError(f"{what} hold none; give one a line: {', '.join(FIELDS)}")
    orders = [_order([name.lower() for name in names], cells, f"{what}, line {line}") for line, cells in lines]
    return tuple(sorted(orders, key=lambda order: order.release))


def _rows(text: str, what: str) -> list[tuple[int, list[str]]]:
    """Return (line number, cells) of a CSV text as spreadsheets write it.

    The separator is whichever of comma, semicolon and tab occurs most in the first line; with the other two, 0,5 is
    read as 0.5. Blanks around cells, empty lines and empty cells at the right are dropped.
    """
    head = text.lstrip("\n").partition("\n")[0]
    delimiter = max(",;\t", key=head.count)
    reader = csv.reader(io.StringIO(text), delimiter=delimiter, skipinitialspace=True, strict=True)
    rows = []
    try:
        for cells in reader:
            line = [cell.strip() if delimiter == "," else cell.strip().replace(",", ".") for cell in cells]
            while line and not line[-1]:
                line.pop()
            if line:
                rows.append((reader.line_num, line))
    except csv.Error as failed:
        raise ConfigError(f"{what}, line {reader.line_num}: {failed}") from None
    return rows


def write_orders(path: str | Path, orders: Iterable[Order]) -> None:
    """Write orders to a CSV file, which `read_orders` reads."""
    with complete_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(FIELDS)
        for release, picks, drop, due, weight in orders:
            table.writerow([f"{release:g}", " ".join(map(_named, picks)), _named(drop), f"{due:g}", f"{weight:g}"])


def check_orders(orders: Sequence[Order], grid: GridMap, payload: float) -> None:
    """Raise ConfigError or MapError for an order that no robot of `payload` [kg] can carry out on this floor.

    Warn of cells that are neither pick faces nor stations (MapWarning).
    """
    there = grid.return_region(grid.endpoints[2][0])
    for number, order in enumerate(orders, 1):
        for cell, what in [*((pick, "pick") for pick in order.picks), (order.drop, "drop")]:
            grid.check_cell(cell, f"{what} of order {number}")
            if not there[cell]:
                raise ConfigError(f"{what} {cell} of order {number} cannot be reached on map {grid.name!r}; move it")
        if order.weight > payload:
            raise ConfigError(
                f"order {number} weighs {order.weight:g} kg, more than a robot's payload of {payload:g}; split it"
            )
    note_strays(orders, grid)


def note_strays(orders: Sequence[Order], grid: GridMap) -> None:
    """Warn of orders to cells that are neither pick faces nor stations (MapWarning), but not again in workers."""
    places = {tuple(cell) for cell in (*grid.picks.tolist(), *grid.stations.tolist())}
    visits = ((cell, k) for k, order in enumerate(orders, 1) for cell in (*order.picks, order.drop))
    strays = [(cell, k) for cell, k in visits if cell not in places]
    if strays and multiprocessing.parent_process() is None:
        (cell, number), many = strays[0], len({cell for cell, _ in strays})
        text = f"orders lead to {many} cell{'s' * (many > 1)} that are neither pick faces nor stations"
        warnings.warn(f"{grid.name}: {text}, the first is {cell} of order {number}", MapWarning, stacklevel=3)


def _named(cell: Cell) -> str:
    return f"{cell[0]}:{cell[1]}"


def _order(names: Sequence[str], cells: Sequence[str], where: str) -> Order:
    """Return the order of a line's cells."""
    if len(cells) != len(names):
        raise ConfigError(f"{where} must have exactly the fields {', '.join(FIELDS)}, and no empty ones")
    row = dict(zip(names, cells, strict=True))
    release, due, weight = (_number(row[name], name, where) for name in ("release_s", "due_s", "weight_kg"))
    picks = row["picks"].split()
    if not picks:
        raise ConfigError(f"{where}: picks={shown(picks)} must be one or more cells, row:column")
    if due < release:
        raise ConfigError(f"{where}: due_s={due:g} must not be before release_s={release:g}")
    return Order(release, tuple(_cell(pick, where) for pick in picks), _cell(row["drop"], where), due, weight)


def _number(value: str, name: str, where: str) -> float:
    found = as_number(value)
    if not 0.0 <= found <= _LATEST:
        raise ConfigError(f"{where}: {name}={shown(value)} must be a number from 0 to {_LATEST:g}")
    return found


def _cell(value: str, where: str) -> Cell:
    found = _CELL.fullmatch(value.strip())
    if found is None:
        raise ConfigError(f"{where}: the cell {shown(value)} must be two whole numbers, such as 12:7")
    return int(found[1]), int(found[2])


Allocator = Callable[[NDArray[np.float64]], list[tuple[int, int]]]
"""A rule: from costs float[F, K] [cells] of each free robot to each open order, oldest first, to pairs (robot, order).

It pairs each robot and order at most once, and as many as possible. Ties go to the lower number.
"""


def fifo(cost: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Give the oldest order to the robot nearest to it, then the next."""
    left, pairs = cost.copy(), []
    for order in range(min(cost.shape)):
        robot = int(left[:, order].argmin())
        left[robot] = np.inf
        pairs.append((robot, order))
    return pairs


def nearest(cost: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Pair the robot and the order that are nearest to each other, then the next of those left."""
    left, pairs = cost.copy(), []
    for _ in range(min(cost.shape)):
        robot, order = divmod(int(left.argmin()), cost.shape[1])
        left[robot], left[:, order] = np.inf, np.inf
        pairs.append((robot, order))
    return pairs


def optimal(cost: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Pair robots and orders so that the sum of all costs is least (the Hungarian method)."""
    from scipy.optimize import linear_sum_assignment

    return [(int(robot), int(order)) for robot, order in zip(*linear_sum_assignment(cost), strict=True)]


ALLOCATORS: dict[str, Allocator] = {"nearest": nearest, "fifo": fifo, "optimal": optimal}


def make_allocator(name: str) -> Allocator:
    """Return a rule by its name; ConfigError, with near matches, for an unknown one."""
    check_known("allocation", [name], ALLOCATORS)
    return ALLOCATORS[name]
