"""`warehouse orders`, which draws a file of orders, and the options of robots' work."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from train.reporting.report import number
from warehouse_env.checked import Checked
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, counted
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.simulation.tasks.allocation import make_allocator
from warehouse_env.simulation.tasks.demand import draw_orders
from warehouse_env.simulation.tasks.orders import note_strays, read_orders, write_orders
from warehouse_env.work import BatterySpec, OrderSpec, ServiceSpec


@dataclass(frozen=True)
class Work(Checked):
    """Options of robots' work; the other fields of EnvConfig's service, orders and battery have their defaults."""

    service: float | None = None
    """Service time at every pick face and station [s] (default: none)."""
    orders: Path | None = None
    """Orders to carry out: a CSV file of `warehouse orders`."""
    orders_per_hour: float | None = None
    """Draw this many random orders per hour instead."""
    allocation: str = OrderSpec.allocation
    """Assignment of orders to robots: nearest, fifo or optimal."""
    battery: bool = False
    """Simulate batteries and charging."""

    def work(self) -> dict[str, Any]:
        """Return the fields of EnvConfig that the options set; ConfigError for a bad file of orders."""
        make_allocator(self.allocation)
        given: dict[str, Any] = {}
        if self.orders is not None and self.orders_per_hour is not None:
            raise ConfigError("--orders-per-hour must be left out with --orders, which says when they come")
        if self.orders is not None:
            read_orders(self.orders)
            given["orders"] = OrderSpec(file=str(self.orders), allocation=self.allocation)
        if self.orders_per_hour is not None:
            given["orders"] = OrderSpec(per_hour=self.orders_per_hour, allocation=self.allocation)
        if self.service is not None:
            given["service"] = ServiceSpec(pick=self.service, station=self.service)
        if self.battery:
            given["battery"] = BatterySpec()
        return given | {"arrival": "stop"} if given else given

    def note_orders(self, grid: GridMap) -> None:
        """Warn of orders to cells of a floor that are neither pick faces nor stations."""
        if self.orders is not None:
            note_strays(read_orders(self.orders), grid)


@dataclass(frozen=True)
class Orders(Checked):
    """Draw random orders for a floor, with OrderSpec's classes, weights and due times, for `evaluate --orders`."""

    layout: str = EnvConfig.layout
    """Floor: a name of `warehouse layouts`, a MovingAI file NAME.map, or your own, FILE.py:FUNCTION."""
    hours: float = 8.0
    """Hours in which orders arrive."""
    per_hour: float = OrderSpec.per_hour
    """Mean number of orders per hour, at random times."""
    picks: int = OrderSpec.picks
    """Most pick faces of an order, at least 1."""
    seed: int = 0
    """Seed of the orders."""
    out: Path = Path("orders.csv")
    """CSV file for the orders."""
    ranges: ClassVar = {"hours": (0.001, 10_000.0), "seed": (0, 2**62)}

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require(self.hours * self.per_hour <= 1e6, "per_hour", "so few that all make a million at most")

    def run(self) -> None:
        """Draw the orders and write them."""
        spec = OrderSpec(per_hour=self.per_hour, picks=self.picks)
        grid = make_layout(self.layout)
        orders = draw_orders(EnvConfig(arrival="stop", orders=spec), grid, 3600.0 * self.hours, self.seed)
        write_orders(self.out, orders)
        weight = sum(order.weight for order in orders) / max(len(orders), 1)
        print(f"wrote {counted(len(orders), 'order')} of {number(weight)} kg on average to {self.out}")
