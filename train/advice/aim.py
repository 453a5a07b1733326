"""The measure of a floor: goals an hour, or with orders, orders an hour and the share in time."""

from __future__ import annotations

from typing import NamedTuple

from train.reporting.columns import Measure, field_of
from train.reporting.rows import Row
from warehouse_env.simulation.simulator import Simulator

FELL = 0.9  # of the throughput with fewer robots, below which a floor is jammed


class Aim(NamedTuple):
    """A measure, and how it is read from a trial's row."""

    noun: str
    late: Measure  # per robot and hour, in the second half of an episode
    gained: str  # the measure for changes of the floor
    whole: str  # field of a row: `gained` per robot and hour, in the whole episode
    fell: float  # of the throughput of fewer robots, below which a floor is jammed
    share: Measure | None = None  # the target, if it is not the throughput

    def made(self, row: Row) -> float:
        """Return the throughput of all robots in the second half of an episode, 0 if it has none."""
        return float(row["robots"] * (row[self.late.name] or 0.0))

    def asked(self, row: Row) -> float | None:
        """Return the measure of the target: the throughput of all robots, or the share."""
        return self.made(row) if self.share is None else self.share.value(row)

    def gain(self, row: Row) -> float:
        """Return the measure for changes, per robot and hour of a whole episode."""
        return row[self.whole] or 0.0


def _late(name: str) -> Measure:
    return Measure(name, "late", field_of(name))


GOALS = Aim("goals", _late("late_goals_per_robot_hour"), "goals", "goals_per_robot_hour", FELL)
# The number of orders is random, so fewer orders in other episodes do not mean a jam.
ORDERS = Aim(
    "orders", _late("late_orders_per_robot_hour"), "orders in time", "orders_in_time_per_robot_hour", 0.0,
    Measure("in_time_share", "in time %", field_of("in_time_share"), factor=100.0, most=1.0),
)  # fmt: skip


class OrdersSoFar:
    """A watcher of one world that counts orders in both halves of an episode."""

    def __init__(self, middle: int) -> None:
        """middle: steps after which the second half begins."""
        self._middle = middle
        self._before: dict[str, float] = {}  # metrics then

    def __call__(self, simulator: Simulator, steps: int) -> None:
        """Note the metrics at half time."""
        if steps == self._middle:
            self._before = simulator.episode_metrics(0)

    def row(self, row: Row, hours: float) -> Row:
        """Return the fields that `ORDERS` reads, from an episode's row and the hours of its second half.

        If unassigned orders pile up in the second half, all will be late in the end. So the share in time is at most
        the share that does not pile up.
        """
        robots, due = row["robots"], row["orders_due"]
        done, came, piled = (
            row[name] - self._before[name] for name in ("orders_done", "orders_released", "orders_open")
        )
        kept = 1.0 - max(0.0, piled) / came if came else 1.0
        return {
            "late_orders_per_robot_hour": done / hours / robots,
            "orders_in_time_per_robot_hour": row["orders_in_time"] / (row["seconds"] / 3600.0) / robots,
            "in_time_share": min(kept, 1.0 - row["orders_late"] / due) if due else None,
        }
