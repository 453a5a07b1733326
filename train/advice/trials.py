"""Trials: one episode each of robots under right of way by rules on a floor, which may be one that is only thought of.

All trials of a seed have the same starts and first goals where floors have the same endpoints, so they pair.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from train.evaluation.jobs import Job, Result, Tick
from train.evaluation.places import Places
from train.evaluation.rollout import make_experiment, run
from train.reporting.rows import Row
from warehouse_env import __version__
from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import GridMap

POLICY = "greedy"  # right of way alone: no training, and no contact
AS_IS = "as it is"  # the floor without a change


@dataclass(frozen=True)
class Trial(Job):
    """An episode to be driven."""

    floor: str  # its name among those that are tried
    grid: GridMap
    robots: int
    seed: int
    seconds: float
    planner: str

    @property
    def identity(self) -> Row:
        """What its row is known by."""
        return {
            "floor": self.floor, "content": f"{self.grid.key} {self.grid.endpoints[2]}", "robots": self.robots,
            "seed": self.seed, "planner": self.planner, "asked_seconds": self.seconds, "version": __version__,
        }  # fmt: skip

    @property
    def title(self) -> str:
        """Its robots, and its floor where that is changed."""
        changed = "" if self.floor == AS_IS else f", {self.floor}"
        return f"{self.robots} robot{'s' * (self.robots > 1)}{changed}"

    def left(self, rows: Sequence[Row]) -> tuple[Sequence[Row], Trial | None]:
        """Return its row, if there is one."""
        return (rows[:1], None) if rows else ([], self)

    def run(self, tick: Tick) -> Result:
        """Drive an episode; its row also says what was noted of places."""
        env = EnvConfig(num_agents=self.robots, planner=self.planner)
        experiment = make_experiment(POLICY, env, 1, self.seconds, self.seed)
        places = Places(experiment)
        (row,) = run(experiment, [places], self.grid)
        (note,) = places.rows()
        left_out = ("config", "layout", "deadlock_log", "episode")
        kept = {name: value for name, value in {**note, **row}.items() if name not in left_out}
        return Result([kept | self.identity])


Drive = Callable[[Sequence[Trial]], list[Row]]
"""From trials to their rows."""


class Clock:
    """A budget of time, or none."""

    def __init__(self, minutes: float | None) -> None:
        self.restart()
        self._budget = None if minutes is None else 60.0 * minutes

    def restart(self) -> None:
        """Begin anew."""
        self._begin = time.monotonic()

    @property
    def spent(self) -> float:
        """Seconds since it was made, or restarted."""
        return time.monotonic() - self._begin

    @property
    def left(self) -> float:
        """Seconds of the budget that are left, infinite without one."""
        return math.inf if self._budget is None else self._budget - self.spent

    def allows(self, seconds: float, share: float = 1.0) -> bool:
        """Return whether so much more time stays within a share of the budget."""
        return self._budget is None or self.spent + seconds <= share * self._budget
