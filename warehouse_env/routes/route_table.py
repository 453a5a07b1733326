"""The routes of a floor as kernels see them: a hash table that grows with the routes that robots ask for.

A route depends on its start, its goal, and the cell behind a robot in a single lane, so worlds and simulators share it.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.kernel import inline, kernel, part
from warehouse_env.maps.grid_map import Cell
from warehouse_env.routes.goals import Pose
from warehouse_env.threads import get_num_threads

MOST = 1_000_000  # routes that `trim` leaves, 600 MB on a floor like paper46
BULK, PART = 1000, 50  # routes at a time that get new arrays, and that a thread makes before it tells so
_SLOTS, _POINTS = 2**12, 2**16  # of an empty table
# (row, column) from a robot to the cell behind it: 0: unknown, or of no matter; else by its heading
BEHIND = ((0, 0), (0, -1), (1, 0), (0, 1), (-1, 0))
_BITS, _LOW, _FACTOR = np.int64(20), np.int64(2**30 - 1), np.int64(2654435769)  # of the hash
_QUARTER, _STRAIGHT = np.pi / 2, np.pi / 6  # [rad]: off an axis by less, a heading is along a lane


class Route(NamedTuple):
    """A path of cells, and the line that a body drives along it."""

    cells: NDArray[np.int32]  # [L, 2] (row, column)
    line: NDArray[np.float32]  # [R, 2] [m], way-points
    reach: float = math.inf  # [m] of the line that are drivable
    end: Pose | None = None  # its last pose, if not the centre of the last cell
    either: bool = False  # the body may also stand there with the opposite heading


class Lines(NamedTuple):
    """The table's arrays: S slots, of which at most half are used, and P way-points. Entries never change."""

    keys: NDArray[np.int64]  # [S], see key_of; 0: unused
    begins: NDArray[np.int64]  # [S], a line's first way-point
    counts: NDArray[np.int64]  # [S], its way-points
    ends: NDArray[np.float32]  # [S, 3], the pose at which it ends (Route.end); x nan: the last cell's centre
    either: NDArray[np.bool_]  # [S], see Route
    points: NDArray[np.float32]  # [P, 2] [m]


@inline
def key_of(start, goal, behind, cells):
    """Return the key of a route between cells, numbered along the rows of a map of `cells`; behind: of BEHIND."""
    return ((start * cells + goal) * len(BEHIND) + behind) + 1


@part
def slot_of(key, keys):
    """Return the slot of a key, or the unused one in which to put it."""
    slot = ((key ^ key >> _BITS) & _LOW) * _FACTOR >> _BITS & len(keys) - 1
    while keys[slot] != 0 and keys[slot] != key:
        slot = slot + 1 & len(keys) - 1
    return slot


@kernel
def behind_of(closed, row, column, goal_row, goal_column, heading):
    """Return which cell of BEHIND a robot in a single lane must not turn to, since it cannot turn round; else 0.

    closed: bool[H, W]; heading [rad].
    """
    quarter = np.floor(heading / _QUARTER + 0.5)
    if abs(heading - quarter * _QUARTER) >= _STRAIGHT:
        return 0
    behind = 1 + (np.int64(quarter) & 3)
    back_row, back_column = BEHIND[behind]
    rows, columns = closed.shape
    for side in (1, -1):
        beside_row, beside_column = row + side * back_column, column + side * back_row
        if 0 <= beside_row < rows and 0 <= beside_column < columns and not closed[beside_row, beside_column]:
            return 0
    back_row, back_column = row + back_row, column + back_column
    inside = 0 <= back_row < rows and 0 <= back_column < columns
    if not inside or closed[back_row, back_column] or (back_row == goal_row and back_column == goal_column):
        return 0
    return behind


@kernel
def _note_unknown(wanted, keys, unknown):
    """Write which keys int64[K] are in no slot."""
    for k in range(len(wanted)):
        unknown[k] = keys[slot_of(wanted[k], keys)] == 0


@kernel
def _enter(lines, key, begin, points, end, either):
    """Write a route into the table, and return its slot; it is not found there before its key is written, too."""
    slot = slot_of(key, lines.keys)
    lines.begins[slot], lines.counts[slot], lines.either[slot] = begin, len(points), either
    for k in range(3):
        lines.ends[slot, k] = end[k]
    for k in range(len(points)):  # an assignment to a slice takes seconds to compile
        lines.points[begin + k, 0], lines.points[begin + k, 1] = points[k, 0], points[k, 1]
    return slot


@kernel
def _enter_many(lines, keys, counts, points, begin, slots):
    """Write routes whose way-points `points` follow each other into the table from `begin` on, and their slots."""
    first, end = 0, np.full(3, np.nan, np.float32)
    for k in range(len(keys)):
        line = points[first : first + counts[k]]
        slots[k] = _enter(lines, keys[k], begin + first, line, end, False)
        lines.keys[slots[k]] = keys[k]
        first += counts[k]


@kernel
def _move(slots, old, new):
    """Put the entries in some slots into larger arrays, and write their new slots."""
    for k in range(len(slots)):
        before = slots[k]
        begin = old.begins[before]
        points = old.points[begin : begin + old.counts[before]]
        slots[k] = _enter(new, old.keys[before], begin, points, old.ends[before], old.either[before])
        new.keys[slots[k]] = old.keys[before]


class RouteTable:
    """Makes the routes that kernels look for. Threads and simulators share it.

    `lines`: the arrays; larger ones take their place. `count`: the routes; `slots` int64: theirs, the oldest first;
    `used`: way-points; `longest`: way-points of the longest route.
    """

    def __init__(
        self, make: Callable[[Cell, Cell, Cell | None], Route], shape: tuple[int, int],
        make_many: Callable[[NDArray[np.int64]], tuple[NDArray[np.int64], NDArray[np.float32]]] | None = None,
    ) -> None:  # fmt: skip
        """make: makes a route from its start, its goal and the cell behind; shape: of the map.

        make_many: makes the routes of some keys, as the number of way-points of each, 0 where it can make none, and all
        way-points one after another.
        """
        self._make, self._make_many, self._shape, self._lock = make, make_many, shape, Lock()
        self._clear()

    def _clear(self) -> None:
        self.lines, self.slots = _empty(_SLOTS, _POINTS), np.empty(_SLOTS // 2, np.int64)
        self.count = self.used = self.longest = 0

    def trim(self) -> None:
        """Begin anew if there are too many routes; call it before a step or reset, which look for theirs again."""
        with self._lock:
            if self.count > MOST:
                self._clear()

    def since(self, count: int) -> tuple[Lines, NDArray[np.int64], int]:
        """Return the arrays, the slots of the routes after the first `count`, and the number of way-points."""
        with self._lock:
            return self.lines, self.slots[count : self.count].copy(), self.used

    def fill(self, keys: NDArray[np.int64], track: Callable[[Sequence[int]], Iterable[int]] = iter) -> None:
        """Make the routes of some keys on all allowed threads; PlanError where there is none. 0 is no key.

        track: yields the keys while their routes are made, for a progress bar.
        """
        with self._lock:
            wanted = np.unique(np.abs(keys[keys != 0]))
            unknown = np.empty(len(wanted), np.bool_)
            _note_unknown(wanted, self.lines.keys, unknown)
            new = wanted[unknown]
            if not len(new):
                return
            told = iter(track(new.tolist()))
            with ThreadPoolExecutor(min(get_num_threads(), len(new))) as pool:
                if self._make_many is not None:
                    new = self._fill_in_parts(new, self._make_many, pool, told)
                for key, route in zip(new.tolist(), pool.map(self._route, new.tolist()), strict=True):
                    next(told)
                    self._put(key, route)
                next(told, None)  # so that a progress bar ends

    def _fill_in_parts(
        self, keys: NDArray[np.int64], make: Callable[..., Any], pool: ThreadPoolExecutor, told: Iterator[int]
    ) -> NDArray[np.int64]:
        """Make routes in parts; return the keys of those that cannot be made so."""
        made, parts = [], np.array_split(keys, -(-len(keys) // PART))
        for routes in pool.map(make, parts):
            made.append(routes)
            for _ in range(np.count_nonzero(routes[0])):
                next(told)
        counts, points = (np.concatenate(arrays) for arrays in zip(*made, strict=True))
        if len(keys) < BULK:
            for key, line in zip(keys.tolist(), np.split(points, np.cumsum(counts)[:-1]), strict=True):
                if len(line):
                    self._put(key, Route(np.empty((0, 2), np.int32), line))
            return np.extract(counts == 0, keys)
        more = int(np.count_nonzero(counts))
        many, (lines, slots) = slice(self.count, self.count + more), self._copy(more, len(points))
        _enter_many(lines, keys[counts > 0], counts[counts > 0], points, self.used, slots[many])
        self.lines, self.slots, self.count, self.used = lines, slots, many.stop, self.used + len(points)
        self.longest = max(self.longest, int(counts.max()))
        return np.extract(counts == 0, keys)

    def _copy(self, routes: int, points: int) -> tuple[Lines, NDArray[np.int64]]:
        """Return copies of the arrays and slots, twice as large or more if there is no room for so many further."""
        size = max(len(self.lines.keys), 1 << (2 * (self.count + routes) - 1).bit_length())
        room, needed = len(self.lines.points), self.used + points
        lines = _empty(size, room if needed <= room else max(2 * room, needed))
        slots = np.empty(size // 2, np.int64)
        slots[: self.count] = self.slots[: self.count]
        _move(slots[: self.count], self.lines, lines)
        return lines, slots

    def _route(self, key: int) -> Route:
        """Make the route of a key (key_of)."""
        (rows, columns), (path, behind) = self._shape, divmod(key - 1, len(BEHIND))
        start, goal = (divmod(cell, columns) for cell in divmod(path, rows * columns))
        back = (start[0] + BEHIND[behind][0], start[1] + BEHIND[behind][1]) if behind else None
        return self._make(start, goal, back)

    def _put(self, key: int, route: Route) -> None:
        count = len(route.line)
        if self.count == len(self.slots) or self.used + count > len(self.lines.points):
            self.lines, self.slots = self._copy(1, count)
        end = np.full(3, np.nan, np.float32) if route.end is None else np.array(route.end, np.float32)
        self.slots[self.count] = slot = _enter(self.lines, key, self.used, route.line, end, route.either)
        self.lines.keys[slot] = key  # in a call of its own, for other threads look routes up meanwhile
        self.count, self.used, self.longest = self.count + 1, self.used + count, max(self.longest, count)


def _empty(slots: int, points: int) -> Lines:
    counts = np.zeros(slots, np.int64)
    ends = np.empty((slots, 3), np.float32)
    return Lines(
        counts, counts.copy(), counts.copy(), ends, np.zeros(slots, np.bool_), np.empty((points, 2), np.float32)
    )
