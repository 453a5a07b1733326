"""Routes: plans turned into way-points, cached in memory.

A plan depends only on the map, the planner with its parameters, start and goal, so it is made once: an ant colony takes
milliseconds, a look-up microseconds. A plan table has all plans between a floor's endpoints by one planner. It is made
once, kept in a file, and read once a process. That of `paper46` under the default planner ships with the package;
others lie in the user's cache.
"""

import hashlib
import itertools
import math
import os
import weakref
import zipfile
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from platformdirs import user_cache_dir

from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.errors import MapError, PlanError
from warehouse_env.files import complete_file
from warehouse_env.maps.fitting import opened
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning.graph_search import AStarTurns, unflatten
from warehouse_env.planning.plan import Plan, Planner
from warehouse_env.portable import Portable
from warehouse_env.routes.goals import Pose, face, facing
from warehouse_env.routes.lanes import drivable_line
from warehouse_env.routes.many import Plans, drivable_lines, known_plan
from warehouse_env.routes.route_table import BEHIND, Route, RouteTable, behind_of, key_of
from warehouse_env.threads import get_num_threads

CACHE_FORMAT = 3  # raise it when a planner's result changes for the same key, or the files' form
SHIPPED = Path(__file__).parent / "tables"
_MOVE_OF = {(row, column): number for number, (row, column) in enumerate(MOVES.tolist())}


class PlanTable(NamedTuple):
    """The plans between the E endpoints of a floor (GridMap.endpoints), ordered by goal, then by start."""

    begins: NDArray[np.int64]  # [E * E + 1], of each plan's moves; a plan without moves is not known
    moves: NDArray[np.uint8]  # of all plans, as indices into MOVES


def cache_directory() -> Path:
    """Return the folder of the user's plan tables: $WAREHOUSE_CACHE_DIR, or the user's cache folder."""
    return Path(os.environ.get("WAREHOUSE_CACHE_DIR") or user_cache_dir("warehouse_env"))


def _name(grid: GridMap, planner: Planner) -> str:
    """Return the name of the file that holds a floor's plans by a planner."""
    text = f"{CACHE_FORMAT} {grid.key} {planner.key} {grid.endpoints[2]}"
    return f"plans-{hashlib.blake2b(text.encode(), digest_size=8).hexdigest()}.npz"


def read_table(grid: GridMap, planner: Planner) -> PlanTable | None:
    """Return the table of a floor and a planner, the user's own before the shipped one; None without a whole one."""
    name, count = _name(grid, planner), len(grid.endpoints[2])
    files = (folder / name for folder in (cache_directory(), SHIPPED))
    return next((table for file in files if file.is_file() and (table := _read(file, count)) is not None), None)


@lru_cache(maxsize=16)
def _read(file: Path, endpoints: int) -> PlanTable | None:
    try:
        with np.load(file) as table:
            begins = np.concatenate([[0], np.cumsum(table["lengths"], dtype=np.int64)])
            moves = table["moves"]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    whole = (len(begins), len(moves)) == (endpoints**2 + 1, begins[-1])
    return PlanTable(begins, moves) if whole and moves.dtype == np.uint8 and (moves < len(MOVES)).all() else None


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


MEMORY = 200_000  # routes kept in memory


class RouteBook(Portable):
    """Cache of the routes on one map by one planner. A copy starts with the plan table alone."""

    bound = ("_solid", "_one_way", "_routes", "_faces", "_tables", "_table", "_plans", "_lock")

    def __init__(
        self, grid: GridMap, planner: Planner, *, keep_right: float = EnvConfig.keep_right, wider: float = 1.0
    ) -> None:
        """wider: width of the bodies over the default width (RobotSpec.wider)."""
        self.grid, self.planner = grid, planner
        self._keep_right, self._wider = keep_right, wider
        self._bind()

    @property
    def floor(self) -> tuple[NDArray[np.uint8], NDArray[np.uint8], float, float, float]:
        """What lanes depend on: padded shelves and one-way cells, their size [m], keep_right, and the bodies' width."""
        return self._solid, self._one_way, float(self.grid.cell_size), float(self._keep_right), float(self._wider)

    def _bind(self) -> None:
        self._solid = np.pad(self.grid.occupied[::-1], 1, constant_values=True).astype(np.uint8)
        self._one_way = np.pad(self.grid.one_way[::-1], 1)
        self._routes: dict[tuple[Cell, Cell, Cell | None, tuple[Pose, ...]], Route] = {}
        self._table = read_table(self.grid, self.planner)
        self._plans = self._collect_plans()
        self._faces: dict[tuple[Cell, RobotSpec], tuple[Pose, ...]] = {}
        self._tables: dict[RobotSpec | None, RouteTable] = {}
        self._lock = Lock()  # threads of a training share a cache

    def cells(self, start: Cell, goal: Cell, behind: Cell | None = None) -> NDArray[np.int64]:
        """Return the planned cells int64[L, 2], not starting with a step to `behind`; PlanError if there is no path."""
        known = self._plan(start, goal, behind).cells if behind is not None else self._known_or_planned(start, goal)
        if not len(known):
            raise PlanError(
                f"planner {self.planner.name} found no path from {start} to {goal} on map {self.grid.name!r}; "
                "choose reachable cells or another planner"
            )
        return known

    def prepare(self, tasks: Sequence[tuple[Cell, Cell, tuple[Pose, ...]]]) -> None:
        """Make the unknown routes of tasks (start, goal, ends) in parallel, on as many threads as allowed.

        Each plan has its own generator, so order and threads do not matter. A failed plan is an error only when its
        route is needed.
        """
        new = [(s, goal, ends) for s, goal, ends in dict.fromkeys(tasks) if (s, goal, None, ends) not in self._routes]
        threads = min(get_num_threads(), len(new))
        if threads > 1:
            with ThreadPoolExecutor(threads) as pool:
                for start, goal, ends in new:  # errors of what nobody asked for are not raised
                    pool.submit(self.route, start, goal, ends=ends)

    @property
    def has_table(self) -> bool:
        """Whether the plans between the floor's endpoints are known."""
        return self._table is not None

    def plan_all(self, track: Callable[[list[Cell]], Iterable[Cell]] = iter) -> None:
        """Make or complete the plan table: plan between all endpoints on all allowed threads, and keep that on disk.

        track: yields the goals while they are planned to, for a progress bar.
        """
        places = self.grid.endpoints[2]
        with ThreadPoolExecutor(get_num_threads()) as pool:
            plans = (pool.map(self._known_or_planned, places, itertools.repeat(goal)) for goal in track(places))
            write_table(self.grid, self.planner, itertools.chain.from_iterable(plans))
        self._table = read_table(self.grid, self.planner)
        self._plans = self._collect_plans()

    def _known_or_planned(self, start: Cell, goal: Cell) -> NDArray[np.int64]:
        """Return the cells int64[L, 2] of the table's plan, else of a new one."""
        columns = self.grid.shape[1]
        known = known_plan(start[0] * columns + start[1], goal[0] * columns + goal[1], self._plans)
        return unflatten(known, columns) if len(known) else self._plan(start, goal).cells

    def _plan(self, start: Cell, goal: Cell, behind: Cell | None = None) -> Plan:
        rng = np.random.default_rng([0, *start, *goal])
        grid = opened(self.grid, goal)
        return self.planner.plan(grid if behind is None else grid.without(behind), start, goal, rng)

    def route(self, start: Cell, goal: Cell, heading: float | None = None, ends: tuple[Pose, ...] = ()) -> Route:
        """Return the route from start's centre to goal's centre, or to one of `ends` there; PlanError if there is none.

        heading [rad]: of the robot at start. In a single lane the route continues ahead if possible, because a robot
        cannot turn round there.
        """
        side = 0 if heading is None else behind_of(self.grid.closed, *start, *goal, heading)
        behind = (start[0] + BEHIND[side][0], start[1] + BEHIND[side][1]) if side else None
        known = self._routes.get((start, goal, behind, ends))
        if known is None:
            known = self._make(start, goal, behind, ends)
            with self._lock:
                if len(self._routes) >= MEMORY:
                    self._routes.pop(next(iter(self._routes)))
                self._routes[start, goal, behind, ends] = known
        return known

    def _make(self, start: Cell, goal: Cell, behind: Cell | None, ends: tuple[Pose, ...]) -> Route:
        try:
            cells = self.cells(start, goal, behind)
        except (MapError, PlanError):
            if behind is None:
                raise
            cells = self.cells(start, goal)  # a dead end: it must back out
        return self.along(cells.astype(np.int32), ends=ends)

    def make_all(self, track: Callable[[Sequence[int]], Iterable[int]] = iter) -> None:
        """Make the routes between all endpoints' centres, if there is a plan table; track: see RouteTable.fill."""
        if self.has_table:
            (_, columns), cells = self.grid.shape, self.grid.occupied.size
            places = np.array([row * columns + column for row, column in self.grid.endpoints[2]])
            starts, goals = np.meshgrid(places, places)
            keys = key_of(starts, goals, 0, cells)
            self.table(None).fill(keys[~np.eye(len(places), dtype=np.bool_)], track)

    def _collect_plans(self) -> Plans:
        """Return the plans that kernels can use: those of the table, and those of `astar_turns`."""
        grid, table, numbers = self.grid, self._table, np.full(self.grid.shape, -1, np.int64)
        searches = self.planner == AStarTurns() and grid.tight is None and grid.surplus is None
        plans = Plans(numbers, np.zeros(1, np.int64), np.empty(0, np.uint8), grid.legal_moves, searches)
        if table is None:
            return plans
        numbers[tuple(np.transpose(grid.endpoints[2]))] = np.arange(len(grid.endpoints[2]))
        return plans._replace(begins=table.begins, moves=table.moves)

    def _make_many(self, keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Make the routes of some keys, those that the plan table or `astar_turns` has plans for (see RouteTable)."""
        made: tuple[NDArray[np.int64], NDArray[np.float32]]
        made = drivable_lines(keys, self._plans, *self.floor)
        return made

    def ends(self, goal: Cell, robot: RobotSpec) -> tuple[Pose, ...]:
        """Return the poses at which a robot serves an endpoint (goals.face)."""
        if (goal, robot) not in self._faces:
            self._faces[goal, robot] = face(self.grid, goal, robot).poses
        return self._faces[goal, robot]

    def table(self, robot: RobotSpec | None) -> RouteTable:
        """Return the table of routes to the poses at which a robot serves endpoints; None: to the cells' centres."""
        with self._lock:
            if robot not in self._tables:
                me = weakref.proxy(self)  # no cycle, so a book that nobody uses is freed at once
                self._tables[robot] = RouteTable(
                    lambda start, goal, behind: me._make(
                        start, goal, behind, () if robot is None else me.ends(goal, robot)
                    ),
                    self.grid.shape,
                    None if robot is not None else (lambda keys: me._make_many(keys)),
                )
            return self._tables[robot]

    def along(
        self, cells: NDArray[np.int32], begin: NDArray[np.floating[Any]] | None = None, reach: float = math.inf,
        ends: tuple[Pose, ...] = (),
    ) -> Route:  # fmt: skip
        """Return the route along cells [L, 2], from the point `begin` [m] in the first to one of `ends` in the last.

        reach [m]: the length of it to make drivable.
        """
        end, points = facing(ends, cells) if ends else None, self.grid.centre(cells)
        if begin is not None:
            points[0] = begin
        if end is not None:
            points[-1] = end[:2]
        line = drivable_line(points, *self.floor, reach)
        return Route(cells, line, reach, end, len(ends) > 1)
