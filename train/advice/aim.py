"""The measure of a floor: goals an hour, or with orders, orders an hour."""

from __future__ import annotations

from typing import NamedTuple

from train.reporting.columns import Measure, field_of
from train.reporting.rows import Row
from warehouse_env.simulation.simulator import Simulator

FELL = 0.9  # of the throughput with fewer robots, below which a floor is jammed


class Aim(NamedTuple):
    """A measure, and how it is read from a trial's row."""

    noun: str
    fell: float  # of the throughput of fewer robots, below which a floor is jammed

    @property
    def late(self) -> Measure:
        """The measure per robot and hour, in the second half of an episode."""
        name = f"late_{self.noun}_per_robot_hour"
        return Measure(name, "late", field_of(name))

    def made(self, row: Row) -> float:
        """Return the throughput of all robots in the second half of an episode, 0 if it has none."""
        return float(row["robots"] * (row[self.late.name] or 0.0))

    def gain(self, row: Row) -> float:
        """Return the measure for changes, per robot and hour of a whole episode."""
        return row[f"{self.noun}_per_robot_hour"] or 0.0


GOALS = Aim("goals", FELL)
ORDERS = Aim("orders", 0.0)  # the number of orders is random, so fewer orders in other episodes do not mean a jam


class OrdersSoFar:
    """A watcher of one world that counts orders in both halves of an episode."""

    def __init__(self, middle: int) -> None:
        """middle: steps after which the second half begins."""
        self._middle = middle
        self._before = 0.0  # orders done then

    def __call__(self, simulator: Simulator, steps: int) -> None:
        """Note the orders at half time."""
        if steps == self._middle:
            self._before = simulator.episode_metrics(0)["orders_done"]

    def row(self, row: Row, hours: float) -> Row:
        """Return the fields that `ORDERS` reads, from an episode's row and the hours of its second half."""
        return {
            "late_orders_per_robot_hour": (row["orders_done"] - self._before) / hours / row["robots"],
            "orders_per_robot_hour": row["orders_per_hour"] / row["robots"],
        }
