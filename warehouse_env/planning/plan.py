"""Plan, the Planner protocol, measures of a path, and validators of paths and lines."""

import itertools
import math
from functools import lru_cache
from typing import ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warehouse_env.errors import ConfigError, MapError, PlanError, shown
from warehouse_env.kernel import kernel
from warehouse_env.maps.clearance import crosses, segment_gap
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.moves import beyond

CostMap = NDArray[np.float64] | None
"""Cells of length that each move costs on top of its own, [H, W, 8], or that entering a cell costs, [H, W]."""

DEAREST = 1e6  # [cells] that a move may cost
_COUNTED = 2.0**61  # largest sum of tolls along a path; int64 holds more
MICRO = 1e6  # tolls and heights are counted in whole millionths, so that sums of them are exact

_NONE = np.empty(0)
_NONE.flags.writeable = False
_GRAZE = 1e-9  # [cells] of rounding by which a line may enter a shelf


class Plan(NamedTuple):
    """A planner's result.

    cells: int64[L, 2], (row, col) from start to goal, both included; (0, 2) where no path was found.
    best_by_iteration: float64[I], length [cells] of the best path known after each iteration, inf before the
        first one; empty for planners that do not iterate.
    seconds: wall time of the search.
    line: float64[K, 2], (row, col) in cells, from start to goal: the polyline to drive, if a planner leaves the lattice
        (any-angle search, smoothing); None if the cells are the path.
    """

    cells: NDArray[np.int64]
    best_by_iteration: NDArray[np.float64] = _NONE
    seconds: float = 0.0
    line: NDArray[np.float64] | None = None

    @property
    def found(self) -> bool:
        """True where a path was found."""
        return len(self.cells) > 0

    @property
    def converged_at(self) -> int:
        """First iteration (from 1) whose best equals the final best; 0 without a path or without iterations."""
        if not self.found or not len(self.best_by_iteration):
            return 0
        return int(np.argmax(self.best_by_iteration == self.best_by_iteration[-1])) + 1

    @property
    def line_length(self) -> float:
        """Length [cells] of the line, of the path of cells where there is none; inf where no path was found."""
        if self.line is None or not self.found:
            return path_length(self.cells)
        return float(np.hypot(*np.diff(self.line, axis=0).T).sum())


class Planner(Protocol):
    """Finds a path of cells on a map; sees shelves, floor heights and a cost map, never robots."""

    takes_cost: ClassVar[bool]  # False: plan() raises ConfigError where a cost map is given

    @property
    def name(self) -> str:
        """Its name in PLANNERS."""

    @property
    def key(self) -> str:
        """Name and parameters as stable text: equal keys mean equal plans for equal random numbers."""

    def plan(self, grid: GridMap, start: Cell, goal: Cell, rng: np.random.Generator, cost: CostMap = None) -> Plan:
        """Search from start to goal; an unreachable goal gives an empty Plan, an unusable cell a PlanError.

        cost: cells of length that each move costs on top of its own, float64[H, W, 8]; or that entering a cell
            costs, float64[H, W]. Finite and not negative (ConfigError).
        """


def edge_cost(grid: GridMap, cost: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a cost map, float64[H, W] a cell or float64[H, W, 8] a move, as float64[H, W, 8] a move; ConfigError."""
    try:
        cost = np.asarray(cost, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ConfigError(f"a cost map must be an array of numbers, not {shown(cost)}") from None
    if cost.shape not in (grid.shape, (*grid.shape, 8)):
        raise ConfigError(f"a cost map must have the shape {grid.shape} or {(*grid.shape, 8)}, not {cost.shape}")
    if not (cost.min() >= 0 and cost.max() <= DEAREST):  # nan is neither
        raise ConfigError(f"a cost map must hold finite numbers of at least 0 and at most {DEAREST:g}")
    edges: NDArray[np.float64] = cost if cost.ndim == 3 else beyond(cost)
    return edges


def tolls(grid: GridMap, gentleness: float = 0.0, cost: NDArray[np.float64] | None = None) -> NDArray[np.int64] | None:
    """Return what each legal move costs on top of its length [millionths of a cell], int64[H, W, 8]; None: nothing.

    The floor's own tolls (GridMap.surplus) are part of it. gentleness: cells of length that a metre of
    climbing, up or down, is worth; cost: a cost map (Planner.plan).
    """
    climbing = bool(gentleness) and bool(_climbs(grid).any())
    if not climbing and cost is None and grid.surplus is None:
        return None
    toll = np.zeros((*grid.shape, 8), np.int64)
    if climbing and gentleness * float(_climbs(grid).max()) * len(grid.free_cells) > _COUNTED:
        raise ConfigError(f"gentleness={gentleness:g} is too much for the uneven floor of map {grid.name!r}")
    if climbing:
        toll += np.rint(gentleness * _climbs(grid)).astype(np.int64)
    if grid.surplus is not None:
        _add_cost(toll, grid.legal_moves, grid.surplus)
    if cost is not None:
        _add_cost(toll, grid.legal_moves, edge_cost(grid, cost))
    return toll


@kernel
def _add_cost(toll, legal, cost):
    """Add a cost map to the tolls of the legal moves [millionths of a cell]. All [H, W, 8]."""
    for row in range(legal.shape[0]):
        for column in range(legal.shape[1]):
            for move in range(8):
                if legal[row, column, move]:
                    toll[row, column, move] += np.int64(np.rint(MICRO * cost[row, column, move]))


@lru_cache(maxsize=8)
def _climbs(grid: GridMap) -> NDArray[np.int64]:
    """Micrometres gone up or down by each legal move, int64[H, W, 8]; 0 where a move is not legal."""
    height = np.rint(grid.height.astype(np.float64) * MICRO).astype(np.int64)
    climbs: NDArray[np.int64] = np.abs(beyond(height) - height[..., None])
    climbs[~grid.legal_moves] = 0
    climbs.flags.writeable = False
    return climbs


def path_length(cells: ArrayLike) -> float:
    """Length [cells] of a path int[L, 2]: straight steps + sqrt(2) * diagonal steps; inf for an empty path."""
    path = np.asarray(cells, dtype=np.int64).reshape(-1, 2)
    if len(path) == 0:
        return math.inf
    steps = np.abs(np.diff(path, axis=0)).sum(axis=1)
    diagonal = int((steps == 2).sum())
    return (len(path) - 1 - diagonal) + diagonal * math.sqrt(2.0)


def turns(cells: ArrayLike) -> int:
    """Number of direction changes along a path int[L, 2]."""
    steps = np.diff(np.asarray(cells, dtype=np.int64).reshape(-1, 2), axis=0)
    return int((steps[1:] != steps[:-1]).any(axis=1).sum())


def climb(grid: GridMap, cells: ArrayLike) -> float:
    """Metres of floor height gone up or down along a path int[L, 2]."""
    path = np.asarray(cells, dtype=np.int64).reshape(-1, 2)
    heights = grid.height[path[:, 0], path[:, 1]].astype(np.float64)
    return float(np.abs(np.diff(heights)).sum())


def validate(grid: GridMap, cells: ArrayLike, start: Cell, goal: Cell) -> None:
    """Raise PlanError unless int[L, 2] `cells` is a drivable path from start to goal under eq. 26 (paper 000)."""
    path = np.asarray(cells)
    if path.ndim != 2 or path.shape[1] != 2 or not np.issubdtype(path.dtype, np.integer):
        raise PlanError(f"a path must be whole numbers of shape (cells, 2), not {path.dtype} {path.shape}")
    if len(path) == 0:
        raise PlanError(f"the path from {tuple(start)} to {tuple(goal)} is empty")
    for what, cell, wanted in (("starts", path[0], start), ("ends", path[-1], goal)):
        if tuple(cell.tolist()) != tuple(wanted):
            raise PlanError(f"the path {what} at {tuple(cell.tolist())}, not at {tuple(wanted)}")
    rows, cols = grid.occupied.shape
    previous: Cell | None = None
    for row, col in path.tolist():
        if not (0 <= row < rows and 0 <= col < cols):
            raise PlanError(f"the path leaves the map at {(row, col)}")
        if grid.occupied[row, col]:
            raise PlanError(f"the path enters the shelf at {(row, col)}")
        if previous is not None:
            if max(abs(row - previous[0]), abs(col - previous[1])) != 1:
                raise PlanError(f"the path jumps from {previous} to {(row, col)}")
            if grid.occupied[row, previous[1]] or grid.occupied[previous[0], col]:
                raise PlanError(f"the path cuts a shelf corner from {previous} to {(row, col)}")
            for cell in (previous, (row, col)):
                if _opposes(grid.one_way[cell], row - previous[0], col - previous[1]):
                    raise PlanError(f"the path drives against the direction of {cell} from {previous} to {(row, col)}")
        previous = (row, col)


def _opposes(one_way: int, d_row: float, d_col: float) -> bool:
    """Whether a step over so many rows (south) and columns (east) has a part against a direction of one_way.ARROWS."""
    return bool((d_col < 0, d_row > 0, d_col > 0, d_row < 0)[one_way - 1]) if one_way else False


def validate_line(grid: GridMap, line: NDArray[np.float64], start: Cell, goal: Cell, clearance: float = 0.0) -> None:
    """Raise PlanError unless a polyline float64[K, 2] of (row, col) leads from start to goal off the shelves.

    The line must not run against the direction of a one-way cell that it passes through.

    clearance: least distance [cells] of every segment from shelf cells (unit squares) and from the map's edge.
    """
    points = np.asarray(line, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) == 0 or not np.isfinite(points).all():
        raise PlanError(f"a line must be finite numbers of shape (points, 2), not {points.shape}")
    for what, point, wanted in (("starts", points[0], start), ("ends", points[-1], goal)):
        if tuple(point.tolist()) != tuple(wanted):
            raise PlanError(f"the line {what} at {tuple(point.tolist())}, not at {tuple(wanted)}")
    solid = np.pad(grid.occupied, 1, constant_values=True).astype(np.uint8)
    side = 1.0 - 2.0 * _GRAZE
    for a, b in itertools.pairwise(points):
        ends = (*(a[::-1] + 0.5), *(b[::-1] + 0.5))  # x and y, with cell corners on whole numbers
        low, high = (np.clip(np.floor(end + 0.5), -1, grid.shape).astype(int) for end in np.sort([a, b], axis=0))
        where = f"the line from {tuple(a.round(3).tolist())} to {tuple(b.round(3).tolist())}"
        for row, column in itertools.product(*map(range, low.tolist(), (high + 1).tolist())):
            if not crosses(*ends, column + _GRAZE, row + _GRAZE, side):  # type: ignore[call-arg]
                continue
            if solid[row + 1, column + 1]:
                raise PlanError(f"{where} passes through the shelf or edge at {(row, column)}")
            if _opposes(grid.one_way[row, column], *(b - a)):
                raise PlanError(f"{where} drives against the direction of {(row, column)}")
        gap = segment_gap(solid, *ends, 1.0, clearance)  # type: ignore[call-arg]
        if gap < clearance - _GRAZE:
            raise PlanError(f"{where} comes {gap:.3f} cells near to a shelf or the edge; {clearance} are wanted")


def check_endpoints(grid: GridMap, start: Cell, goal: Cell) -> tuple[Cell, Cell]:
    """Return start and goal as plain ints; PlanError where one is outside the map or on a shelf."""
    try:
        return grid.check_cell(start, "start"), grid.check_cell(goal, "goal")
    except MapError as error:
        raise PlanError(str(error)) from None
