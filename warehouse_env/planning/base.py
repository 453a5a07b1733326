"""BasePlanner: what all planners share, so that each is only its parameters and its search."""

import dataclasses
import time
import warnings
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError, MapWarning
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning.plan import CostMap, Plan, check_endpoints

_MOST, _LARGEST = 1_000_000, 1e6  # larger searches take days
# limits by parameter name: memory that grows with the square or the floor's size, and powers that leave float64
_MOST_OF = {
    "ants": 10_000, "particles": 10_000, "fish": 1000, "waypoints": 100,
    "exponent": 20, "trail_exponent": 20, "distance_exponent": 20, "repulsion_reach": 100,
    "field_weight": 100,
}  # fmt: skip


@dataclass(frozen=True)
class BasePlanner(Checked):
    """A Planner whose dataclass fields are its parameters, checked, and whose `find` is its search."""

    name: ClassVar[str]
    takes_cost: ClassVar[bool] = False
    version: ClassVar[str] = ""  # digest of a plugin's code, since plans are kept on disk under the key
    shares: ClassVar[tuple[str, ...]] = ()  # parameters that must lie between 0 and 1

    def __post_init__(self) -> None:
        """Raise ConfigError unless each field fits its type and range.

        Whole numbers are at least 1, other numbers at least 0; fields in `shares` are at most 1.
        """
        super().__post_init__()
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if field.name in self.shares:
                self._require(value <= 1, field.name, "a share between 0 and 1")
            if isinstance(value, float):
                self._between(0.0, float(_MOST_OF.get(field.name, _LARGEST)), field.name)
            elif isinstance(value, int) and not isinstance(value, bool):
                self._between(1, _MOST_OF.get(field.name, _MOST), field.name)

    def _called(self, name: str) -> str:
        """Return the name of a parameter in errors."""
        return f"{self.name} parameter {name}"

    @property
    def key(self) -> str:
        """Name, every parameter and the version as stable text."""
        parameters = (f"{field.name}={getattr(self, field.name)!r}" for field in dataclasses.fields(self))
        return f"{self.name}({', '.join(parameters)}){self.version and f' {self.version}'}"

    def plan(self, grid: GridMap, start: Cell, goal: Cell, rng: np.random.Generator, cost: CostMap = None) -> Plan:
        """Search; the same state of `rng` gives the same plan, to the bit. Arguments and errors: see Planner.plan."""
        begin = time.perf_counter()
        if grid.surplus is not None and not self.takes_cost:
            text = f"planner {self.name} keeps neither preferred lanes nor speed limits of {grid.name!r}; others do"
            warnings.warn(text, MapWarning, stacklevel=2)
        if cost is not None and not self.takes_cost:
            raise ConfigError(f"planner {self.name} takes no cost map; choose one with takes_cost, such as astar")
        plan = self.find(grid, *check_endpoints(grid, start, goal), rng, cost)
        return plan._replace(seconds=time.perf_counter() - begin)

    def find(self, grid: GridMap, start: Cell, goal: Cell, rng: np.random.Generator, cost: CostMap) -> Plan:
        """Search between two free cells; `plan` times it."""
        raise NotImplementedError
