"""The accounts of one world's shift: orders drawn, open, assigned, done; time in service, in queues; empty driving."""

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.simulation.tasks.orders import Order
from warehouse_env.work import OrderSpec


class Demand:
    """An endless stream of orders, drawn from its own generator: Poisson times, or in waves.

    The class (A, B, C, ...) of each pick face is drawn first and stays the same for the whole episode.
    """

    def __init__(self, spec: OrderSpec, grid: GridMap, payload: float, rng: np.random.Generator) -> None:
        self._spec, self._payload, self._rng = spec, payload, rng
        picks, self._stations, _ = grid.endpoints
        shelf = [picks[k] for k in rng.permutation(len(picks))]
        ends = np.round(np.cumsum((0.0, *spec.faces)) * len(shelf)).astype(int)
        self._classes = [shelf[begin:end] or shelf for begin, end in itertools.pairwise(ends)]
        self._shares = np.array(spec.demand) / sum(spec.demand)
        self._now = 0.0  # [s], when the last one came

    def draw(self) -> Order:
        """Return the next order, released no earlier than the last one."""
        spec, rng = self._spec, self._rng
        self._now += float(rng.exponential(3600.0 / spec.per_hour))
        release = math.ceil(self._now / spec.wave) * spec.wave if spec.wave else self._now
        picks: list[Cell] = []
        for _ in range(int(rng.integers(1, spec.picks + 1))):
            faces = self._classes[int(rng.choice(len(self._shares), p=self._shares))]
            picks.append(faces[int(rng.integers(len(faces)))])
        drop = self._stations[int(rng.integers(len(self._stations)))]
        weight = min(float(rng.uniform(0.0, 2 * spec.weight)), self._payload)
        return Order(release, tuple(dict.fromkeys(picks)), drop, release + spec.due, weight)


class Ledger:
    """Orders from release to completion."""

    def __init__(self, given: Sequence[Order] | Demand) -> None:
        """given: all orders, sorted by release, or the demand to draw them from."""
        self._demand = given if isinstance(given, Demand) else None
        self._coming = [given.draw()] if isinstance(given, Demand) else list(reversed(given))
        self.open: dict[int, Order] = {}  # released and not assigned, by number, oldest first
        self.given: dict[int, Order] = {}  # on their way
        self._released = 0
        self._took: list[float] = []  # [s] from release to done
        self._due: list[float] = []  # [s] of those done
        self._late = 0

    def release(self, now: float) -> None:
        """Open the orders released until now [s]."""
        while self._coming and self._coming[-1].release <= now:
            self.open[self._released] = self._coming.pop()
            self._released += 1
            if self._demand is not None:
                self._coming.append(self._demand.draw())

    @property
    def next_release(self) -> float:
        """Time of the next release [s], inf without one."""
        return self._coming[-1].release if self._coming else math.inf

    def give(self, number: int) -> Order:
        """Assign an open order to a robot."""
        order = self.given[number] = self.open.pop(number)
        return order

    def give_back(self, number: int) -> None:
        """Reopen an order that a robot cannot begin."""
        self.open = dict(sorted({**self.open, number: self.given.pop(number)}.items()))

    def complete(self, number: int, now: float) -> None:
        """Count an order as done."""
        order = self.given.pop(number)
        self._took.append(now - order.release)
        self._due.append(order.due)
        self._late += now > order.due

    def row(self, now: float) -> dict[str, float]:
        """Return the metrics of the orders so far; late orders were done too late, or are due and not done."""
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


class Tally:
    """Sums over a world's N robots, in seconds and metres."""

    def __init__(self, count: int) -> None:
        self.waited = 0.0  # [s] for cells that others held
        self._served = self._at_stations = self._empty = 0.0  # [s], [s], [m]
        self._seen = np.zeros(count)  # [m] driven when this was last looked at

    def serve(self, seconds: float, at_station: bool) -> None:
        """Count a service at its begin."""
        self._served += seconds
        self._at_stations += seconds if at_station else 0.0

    def drive(self, robot: int, driven: float, carried: bool) -> None:
        """Count a robot's way since the last call, up to `driven` [m] since the reset."""
        self._empty += 0.0 if carried else driven - self._seen[robot]
        self._seen[robot] = driven

    def row(
        self, now: float, driven: NDArray[np.float64], carries: NDArray[np.bool_],
        to_come: Sequence[tuple[float, bool]], waiting: float, stations: int,
    ) -> dict[str, float]:  # fmt: skip
        """Return the metrics after `now` [s].

        `served_share`, `queueing_share`: of the robots' time, in service and waiting for a cell that another holds;
        `station_utilisation`: of the stations' time, with a robot in service; `empty_driving`: of the metres driven,
        those without a load.

        driven [N] [m], carries bool[N]: now; to_come: for each running service the remaining seconds and whether it is
        at one of the `stations`; waiting [s]: of the robots that wait, so far.
        """
        served = self._served - sum(seconds for seconds, _ in to_come)
        at_stations = self._at_stations - sum(seconds for seconds, at_station in to_come if at_station)
        empty = self._empty + float((driven - self._seen)[~carries].sum())
        time = now if now > 0 else math.nan
        return {
            "served_share": served / (len(driven) * time),
            "queueing_share": (self.waited + waiting) / (len(driven) * time),
            "station_utilisation": at_stations / (stations * time),
            "empty_driving": empty / float(driven.sum()) if driven.any() else math.nan,
        }
