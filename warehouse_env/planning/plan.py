"""Plan, the Planner protocol, measures of a path, and a validator that shares no code with any planner."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Literal, NamedTuple, Protocol, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warehouse_env.errors import ConfigError, PlanError
from warehouse_env.maps.grid_map import Cell, GridMap


class Plan(NamedTuple):
    """What a planner gives back.

    cells: int64[L, 2], (row, col) from start to goal, both included; (0, 2) where no path was found.
    best_by_iteration: float64[I], length [cells] of the best path known after each iteration, inf before the
        first one; empty for planners that do not iterate.
    seconds: wall time of the search.
    """

    cells: NDArray[np.int64]
    best_by_iteration: NDArray[np.float64]
    seconds: float

    @property
    def found(self) -> bool:
        """True where a path was found."""
        return len(self.cells) > 0

    @property
    def converged_at(self) -> int:
        """First iteration (from 1) whose best equals the final best; 0 without a path or without iterations."""
        if not self.found or not len(self.best_by_iteration):
            return 0
        changed = np.flatnonzero(self.best_by_iteration != self.best_by_iteration[-1])
        return int(changed[-1]) + 2 if len(changed) else 1


class Planner(Protocol):
    """Finds a path of cells on a map; sees shelves and floor heights, never robots."""

    @property
    def name(self) -> str:
        """Its name in PLANNERS."""
        ...

    @property
    def key(self) -> str:
        """Name and parameters as stable text: equal keys mean equal plans for equal random numbers."""
        ...

    def plan(self, grid: GridMap, start: Cell, goal: Cell, rng: np.random.Generator) -> Plan:
        """Search from start to goal; an unreachable goal gives an empty Plan, an unusable cell a PlanError."""
        ...


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
        previous = (row, col)


def check_endpoints(grid: GridMap, start: Cell, goal: Cell) -> tuple[Cell, Cell]:
    """Return start and goal as plain ints; PlanError where one is outside the map or on a shelf."""
    rows, cols = grid.occupied.shape
    checked: list[Cell] = []
    for what, given in (("start", start), ("goal", goal)):
        cell = (int(given[0]), int(given[1]))
        if not (0 <= cell[0] < rows and 0 <= cell[1] < cols):
            raise PlanError(f"{what} {cell} is outside the map of {rows} rows and {cols} columns; choose a free cell")
        if grid.occupied[cell]:
            raise PlanError(f"{what} {cell} stands on a shelf; choose a free cell")
        checked.append(cell)
    return checked[0], checked[1]


def planner_key(planner: Any) -> str:
    """Stable text of a planner dataclass: its name and every parameter."""
    parameters = (f"{f.name}={getattr(planner, f.name)!r}" for f in dataclasses.fields(planner))
    return f"{planner.name}({', '.join(parameters)})"


def check_parameters(planner: Any, shares: tuple[str, ...] = ()) -> None:
    """Raise ConfigError unless each field of a planner dataclass fits its type.

    bool: True or False; int: a whole number of at least 1; float: finite and not negative, and at most 1 for the
    fields named in `shares`; Literal: a choice.
    """
    hints = get_type_hints(type(planner))
    for field in dataclasses.fields(planner):
        value, kind = getattr(planner, field.name), hints[field.name]
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if get_origin(kind) is Literal:
            good, rule = value in get_args(kind), f"one of {', '.join(get_args(kind))}"
        elif kind is bool:
            good, rule = isinstance(value, bool), "True or False"
        elif kind is int:
            good, rule = number and isinstance(value, int) and value >= 1, "a whole number of at least 1"
        else:
            good, rule = number and math.isfinite(value) and value >= 0, "a finite number of at least 0"
        if good and field.name in shares:
            good, rule = value <= 1, "a share between 0 and 1"
        if not good:
            raise ConfigError(f"{planner.name} parameter {field.name}={value!r} must be {rule}")
