"""Episodes of the floor as it is, by policy and number of robots: each driven once and timed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from train.advice.curve import STUCK, LoadPoint, loads
from train.advice.race import Raced, race
from train.advice.trials import BLOCK, AdvicePlan, Drive, TimeBudget, Use
from train.reporting.rows import Row

STEEPNESS = 1.25  # power by which time grows with the robots, before two numbers of them were driven


class Team(NamedTuple):
    """Robots under a policy."""

    policy: str
    robots: int


class TrialRuns:
    """The episodes driven so far; none is driven twice."""

    def __init__(self, plan: AdvicePlan, drive: Drive, clock: TimeBudget) -> None:
        self.plan, self.clock = plan, clock
        self._drive = drive
        self._rows: dict[tuple[Team, int], Row] = {}
        self._took: dict[int, tuple[float, int]] = {}  # [s] and episodes, by number of robots

    def rows(self, crews: Sequence[Team], seeds: Sequence[int]) -> list[list[Row]]:
        """Return the rows of each crew in the order of the seeds; drive those that are missing."""
        missing = [(crew, seed) for seed in seeds for crew in crews if (crew, seed) not in self._rows]
        asked = [trial for crew, seed in missing for trial in self.plan.trials(self.plan.grid, *crew, [seed])]
        for key, row in zip(missing, self._drive(asked) if asked else [], strict=True):
            self._rows[key] = row
            spent, episodes = self._took.get(row["robots"], (0.0, 0))
            self._took[row["robots"]] = spent + row["took_s"] / self.plan.processes, episodes + 1
        return [[self._rows[crew, seed] for seed in seeds] for crew in crews]

    def restart(self) -> None:
        """Restart the clock, and forget the times of the first episodes, which include compiling."""
        self.clock.restart()
        self._took.clear()

    def seconds(self, robots: int) -> float:
        """Return the expected time [s] of an episode with all processes busy; NaN before any was driven."""
        took = {count: spent / episodes for count, (spent, episodes) in sorted(self._took.items()) if spent > 0}
        if not took:
            return math.nan
        if robots in took:
            return took[robots]
        *_, most = took
        half = next((count for count in reversed(took) if count <= most / 2), None)
        power = STEEPNESS
        if half is not None:
            power = min(2.0, max(1.0, math.log(took[most] / took[half]) / math.log(most / half)))
        return float(took[most] * (robots / most) ** power)

    def affords(self, crews: Sequence[Team], seeds: Sequence[int], share: float) -> bool:
        """Return whether the missing ones of these episodes should end within a share of the time."""
        lacking = [crew.robots for crew in crews for seed in seeds if (crew, seed) not in self._rows]
        needed = sum(map(self.seconds, lacking))
        return math.isnan(needed) or self.clock.allows(needed, share)

    def loads(self, policy: str, use: Use = Use.CHOOSE) -> list[LoadPoint]:
        """Return what a policy's robots made on the seeds of a use, for each number of them."""
        own = set(self.plan.seeds(use, BLOCK))
        found: dict[int, list[Row]] = {}
        for (crew, seed), row in sorted(self._rows.items()):
            if crew.policy == policy and seed in own:
                found.setdefault(crew.robots, []).append(row)
        return loads(found, self.plan.aim)

    def of(self, crew: Team) -> list[Row]:
        """Return all rows of a crew."""
        return [row for (one, _), row in sorted(self._rows.items()) if one == crew]

    def race(
        self, crews: Sequence[Team], rounds: int, share: float,
        settled: Callable[[Sequence[Team]], bool] = lambda left: len(left) <= 1,
    ) -> Raced[Team]:  # fmt: skip
        """Race crews by what all robots make, one seed a round, within a share of the time; jams count nothing."""

        def play(left: Sequence[Team], number: int) -> list[float]:
            rows = self.rows(left, self.plan.seeds(Use.CHOOSE, 1, number))
            return [self.plan.aim.made(row) * (row["stuck"] < STUCK) for (row,) in rows]

        def go_on(left: Sequence[Team], number: int) -> bool:
            return self.affords(left, self.plan.seeds(Use.CHOOSE, 1, number), share)

        return race(crews, play, self.plan.at_most(rounds), go_on, settled)
