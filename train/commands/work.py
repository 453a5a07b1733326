"""The options of robots' work: service, orders and batteries."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.tasks.allocation import make_allocator
from warehouse_env.simulation.tasks.orders import note_strays, read_orders
from warehouse_env.work import BatterySpec, OrderSpec, ServiceSpec


@dataclass(frozen=True)
class Work(Checked):
    """Options of robots' work; the other fields of EnvConfig's service, orders and battery have their defaults."""

    service: float | None = None
    """Service time at every pick face and station [s] (default: none)."""
    orders: Path | None = None
    """Orders to carry out: a CSV file."""
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
