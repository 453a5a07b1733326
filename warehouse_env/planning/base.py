"""BasePlanner: what the planners here share, so that each is its parameters and its search."""

from __future__ import annotations

import dataclasses
import math
import time
from dataclasses import dataclass
from typing import ClassVar, Literal, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning.plan import Plan, check_endpoints


@dataclass(frozen=True)
class BasePlanner:
    """A Planner whose dataclass fields are its parameters, checked, and whose `find` is its search."""

    name: ClassVar[str]
    takes_cost: ClassVar[bool] = False
    shares: ClassVar[tuple[str, ...]] = ()  # parameters that must lie between 0 and 1

    def __post_init__(self) -> None:
        """Raise ConfigError unless each field fits its type.

        bool: True or False; int: a whole number of at least 1; float: finite and not negative, and at most 1 for the
        fields named in `shares`; Literal: a choice; str: any; None where the type allows it.
        """
        hints = get_type_hints(type(self))
        for field in dataclasses.fields(self):
            value, kind = getattr(self, field.name), hints[field.name]
            if value is None and type(None) in get_args(kind):
                continue
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if get_origin(kind) is Literal:
                good, rule = value in get_args(kind), f"one of {', '.join(get_args(kind))}"
            elif kind in (bool, str):
                good, rule = isinstance(value, kind), "True or False" if kind is bool else "a text"
            elif int in (kind, *get_args(kind)):
                good, rule = number and isinstance(value, int) and value >= 1, "a whole number of at least 1"
            else:
                good, rule = number and math.isfinite(value) and value >= 0, "a finite number of at least 0"
            if good and field.name in self.shares:
                good, rule = value <= 1, "a share between 0 and 1"
            if not good:
                raise ConfigError(f"{self.name} parameter {field.name}={value!r} must be {rule}")

    @property
    def key(self) -> str:
        """Name and every parameter as stable text."""
        parameters = (f"{field.name}={getattr(self, field.name)!r}" for field in dataclasses.fields(self))
        return f"{self.name}({', '.join(parameters)})"

    def plan(
        self,
        grid: GridMap,
        start: Cell,
        goal: Cell,
        rng: np.random.Generator,
        cost: NDArray[np.float64] | None = None,
    ) -> Plan:
        """Search; the same state of `rng` gives the same plan, to the bit. Arguments and errors: see Planner.plan."""
        begin = time.perf_counter()
        if cost is not None and not self.takes_cost:
            raise ConfigError(f"planner {self.name} takes no cost map; choose one with takes_cost, such as astar")
        plan = self.find(grid, *check_endpoints(grid, start, goal), rng, cost)
        return plan._replace(seconds=time.perf_counter() - begin)

    def find(
        self, grid: GridMap, start: Cell, goal: Cell, rng: np.random.Generator, cost: NDArray[np.float64] | None
    ) -> Plan:
        """Search between two free cells; `plan` times it."""
        raise NotImplementedError
