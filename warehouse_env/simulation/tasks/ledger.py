"""The orders of one world: which are known, which are open, which are done, and how well that went."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from warehouse_env.simulation.tasks.demand import Demand
from warehouse_env.simulation.tasks.orders import Order


class Ledger:
    """Orders as they are released, given to a robot, and done."""

    def __init__(self, given: Sequence[Order] | Demand) -> None:
        """given: all of them, by their release; or where they are drawn from."""
        self._demand = given if isinstance(given, Demand) else None
        self._coming = [given.draw()] if isinstance(given, Demand) else list(reversed(given))
        self.open: dict[int, Order] = {}  # released and nobody's yet, by number, oldest first
        self.given: dict[int, Order] = {}  # on their way
        self._released = 0
        self._took: list[float] = []  # [s] from release to done
        self._due: list[float] = []  # [s] of those done
        self._late = 0

    def release(self, now: float) -> None:
        """Make the orders known whose time has come [s]."""
        while self._coming and self._coming[-1].release <= now:
            self.open[self._released] = self._coming.pop()
            self._released += 1
            if self._demand is not None:
                self._coming.append(self._demand.draw())

    @property
    def next_release(self) -> float:
        """When the next order becomes known [s]; never where there is none."""
        return self._coming[-1].release if self._coming else math.inf

    def give(self, number: int) -> Order:
        """Take an open order as a robot's."""
        order = self.given[number] = self.open.pop(number)
        return order

    def give_back(self, number: int) -> None:
        """Open an order again that a robot cannot begin."""
        self.open = dict(sorted({**self.open, number: self.given.pop(number)}.items()))

    def complete(self, number: int, now: float) -> None:
        """Count an order as done."""
        order = self.given.pop(number)
        self._took.append(now - order.release)
        self._due.append(order.due)
        self._late += now > order.due

    def row(self, now: float) -> dict[str, float]:
        """Return the metrics of the orders so far; due: done or not; late: done too late, or due and not done."""
        overdue = sum(order.due < now for orders in (self.open, self.given) for order in orders.values())
        median, slow = np.quantile(self._took, (0.5, 0.95)).tolist() if self._took else (math.nan, math.nan)
        return {
            "orders_released": float(self._released),
            "orders_done": float(len(self._took)),
            "orders_per_hour": len(self._took) / now * 3600.0 if now > 0 else math.nan,
            "order_median_s": median,
            "order_p95_s": slow,
            "orders_due": float(sum(due < now for due in self._due) + overdue),
            "orders_in_time": float(len(self._took) - self._late),
            "orders_late": float(self._late + overdue),
            "orders_open": float(len(self.open)),
        }
