"""Episodes of the floor as it is, by policy and number of robots: each driven once, with what it cost."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from train.advice.curve import STUCK, Load, loads
from train.advice.race import Raced, race
from train.advice.trials import BLOCK, Clock, Drive, Plan, Use
from train.reporting.rows import Row

STEEPNESS = 1.25  # power by which time grows with the robots, where no two numbers of them were driven


class Crew(NamedTuple):
    """Who drives: so many robots under a policy."""

    policy: str
    robots: int


class Study:
    """What was driven so far; what is asked for again is not driven again."""

    def __init__(self, plan: Plan, drive: Drive, clock: Clock) -> None:
        self.plan, self.clock = plan, clock
        self.stretch = 1.0  # of all shares of the time, where nothing comes behind what they are for
        self._drive = drive
        self._rows: dict[tuple[Crew, int], Row] = {}
        self._took: dict[int, tuple[float, int]] = {}  # [s] and episodes, by number of robots

    def rows(self, crews: Sequence[Crew], seeds: Sequence[int]) -> list[list[Row]]:
        """Drive what is lacking; return the rows of each crew in the order of the seeds."""
        missing = [(crew, seed) for seed in seeds for crew in crews if (crew, seed) not in self._rows]
        asked = [trial for crew, seed in missing for trial in self.plan.trials(self.plan.grid, *crew, [seed])]
        for key, row in zip(missing, self._drive(asked) if asked else [], strict=True):
            self._rows[key] = row
            spent, episodes = self._took.get(row["robots"], (0.0, 0))
            self._took[row["robots"]] = spent + row["took_s"] / self.plan.processes, episodes + 1
        return [[self._rows[crew, seed] for seed in seeds] for crew in crews]

    def restart(self) -> None:
        """Begin the time anew, and forget what took longer for being the first."""
        self.clock.restart()
        self._took.clear()

    def seconds(self, robots: int) -> float:
        """Return the time [s] that an episode should take, all processes at work, by the largest ones that were driven.

        NaN where none was.
        """
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

    def affords(self, crews: Sequence[Crew], seeds: Sequence[int], share: float) -> bool:
        """Return whether what is lacking of these episodes ends within a share of the time, by what is known."""
        lacking = [crew.robots for crew in crews for seed in seeds if (crew, seed) not in self._rows]
        needed = sum(map(self.seconds, lacking))
        return math.isnan(needed) or self.clock.allows(needed, min(1.0, self.stretch * share))

    def loads(self, policy: str, use: Use = Use.CHOOSE) -> list[Load]:
        """Return what a policy's robots did on the seeds of a use, for each number of them."""
        own = set(self.plan.seeds(use, BLOCK))
        found: dict[int, list[Row]] = {}
        for (crew, seed), row in sorted(self._rows.items()):
            if crew.policy == policy and seed in own:
                found.setdefault(crew.robots, []).append(row)
        return loads(found, self.plan.aim)

    def of(self, crew: Crew) -> list[Row]:
        """Return all rows of a crew."""
        return [row for (one, _), row in sorted(self._rows.items()) if one == crew]

    def race(
        self, crews: Sequence[Crew], rounds: int, share: float,
        settled: Callable[[Sequence[Crew]], bool] = lambda left: len(left) <= 1,
    ) -> Raced[Crew]:  # fmt: skip
        """Race crews for what all robots make together, a seed a round, within a share of the time.

        An episode at whose end robots are stuck counts nothing.
        """

        def play(left: Sequence[Crew], number: int) -> list[float]:
            rows = self.rows(left, self.plan.seeds(Use.CHOOSE, 1, number))
            return [self.plan.aim.made(row) * (row["stuck"] < STUCK) for (row,) in rows]

        def go_on(left: Sequence[Crew], number: int) -> bool:
            return self.affords(left, self.plan.seeds(Use.CHOOSE, 1, number), share)

        return race(crews, play, self.plan.at_most(rounds), go_on, settled)
