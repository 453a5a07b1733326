"""What a floor is judged by, in one place: goals an hour, or where orders are given, orders an hour and those in time.

Orders can outnumber what robots can do, but not the other way round: more robots than it takes make no more of them.
"""

from __future__ import annotations

from typing import NamedTuple

from train.reporting.columns import Measure, field_of
from train.reporting.rows import Row
from warehouse_env.simulation.simulator import Simulator

FELL = 0.9  # of the throughput with fewer robots, below which it counts as jammed as well


class Aim(NamedTuple):
    """What is counted, and how it is read from a trial's row."""

    noun: str  # what is made
    late: Measure  # of it per robot and hour, in the second half of an episode
    gained: str  # what changes of the floor are to bring more of
    whole: str  # field of a row: `gained` per robot and hour, in the whole episode
    fell: float  # of what fewer robots make, below which a floor counts as jammed
    share: Measure | None = None  # of what is made, that has to be high enough where that is asked for

    def made(self, row: Row) -> float:
        """Return what all robots together made an hour in the second half of an episode, 0 where it has none."""
        return float(row["robots"] * (row[self.late.name] or 0.0))

    def asked(self, row: Row) -> float | None:
        """Return what is held against the wish: what they made, or the share of it."""
        return self.made(row) if self.share is None else self.share.value(row)

    def gain(self, row: Row) -> float:
        """Return per robot and hour of a whole episode what changes are judged by."""
        return row[self.whole] or 0.0


def _late(name: str) -> Measure:
    return Measure(name, "late", field_of(name))


GOALS = Aim("goals", _late("late_goals_per_robot_hour"), "goals", "goals_per_robot_hour", FELL)
# How many orders come is chance, so fewer of them in other episodes are no jam.
ORDERS = Aim(
    "orders", _late("late_orders_per_robot_hour"), "orders in time", "orders_in_time_per_robot_hour", 0.0,
    Measure("in_time_share", "in time %", field_of("in_time_share"), factor=100.0, most=1.0),
)  # fmt: skip


class OrdersSoFar:
    """A watcher of one world that counts orders in each half of an episode."""

    def __init__(self, middle: int) -> None:
        """middle: steps after which the second half begins."""
        self._middle = middle
        self._before: dict[str, float] = {}  # metrics then

    def __call__(self, simulator: Simulator, steps: int) -> None:
        """Look once."""
        if steps == self._middle:
            self._before = simulator.episode_metrics(0)

    def row(self, row: Row, hours: float) -> Row:
        """Return what `ORDERS` reads, of an episode's row and the hours of its second half.

        Where the queue of those that nobody has grows, all will be late one day, though an episode may not see it: no
        larger a share counts as in time than does not pile up of those that come in the second half.
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
