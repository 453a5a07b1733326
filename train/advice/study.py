"""Episodes by policy, number of robots and floor: each driven once and timed; races between such teams."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from train.advice.curve import STUCK, LoadPoint, loads
from train.advice.trials import AS_IS, BLOCK, AdvicePlan, Drive, TimeBudget, Use
from train.reporting.rows import Row, mean_interval

STEEPNESS = 1.25  # power by which time grows with the robots, before two numbers of them were driven
FEWEST = 3  # rounds of a race before any arm is dropped

Arm = TypeVar("Arm")
GoesOn = Callable[[Sequence[Arm], int], bool]
"""Whether the remaining arms race another round, from these and its number."""


class Team(NamedTuple):
    """Robots under a policy on a floor."""

    policy: str
    robots: int
    floor: str = AS_IS  # one of `TrialRuns.floors`


class TrialRuns:
    """The episodes driven so far; none is driven twice."""

    def __init__(self, plan: AdvicePlan, drive: Drive, clock: TimeBudget) -> None:
        self.plan, self.clock = plan, clock
        self.floors = {AS_IS: plan.grid}
        self._drive = drive
        self._rows: dict[tuple[Team, int], Row] = {}
        self._took: dict[int, tuple[float, int]] = {}  # [s] and episodes, by number of robots

    def rows(self, teams: Sequence[Team], seeds: Sequence[int]) -> list[list[Row]]:
        """Return the rows of each team in the order of the seeds; drive those that are missing."""
        missing = self._missing(teams, seeds)
        plan, floors = self.plan, self.floors
        asked = [plan.trial(floors[floor], policy, robots, seed, floor) for (policy, robots, floor), seed in missing]
        for key, row in zip(missing, self._drive(asked) if asked else [], strict=True):
            self._rows[key] = row
            spent, episodes = self._took.get(row["robots"], (0.0, 0))
            self._took[row["robots"]] = spent + row["took_s"] / self.plan.processes, episodes + 1
        return [[self._rows[team, seed] for seed in seeds] for team in teams]

    def restart(self) -> None:
        """Restart the clock, and forget the times of the first episodes, which include compiling."""
        self.clock.restart()
        self._took.clear()

    def seconds(self, robots: int) -> float:
        """Return the expected time [s] of an episode with all processes busy; 0 before any was driven."""
        took = {count: spent / episodes for count, (spent, episodes) in sorted(self._took.items()) if spent > 0}
        if not took:
            return 0.0
        if robots in took:
            return took[robots]
        *_, most = took
        half = next((count for count in reversed(took) if count <= most / 2), None)
        power = STEEPNESS
        if half is not None:
            power = min(2.0, max(1.0, math.log(took[most] / took[half]) / math.log(most / half)))
        return float(took[most] * (robots / most) ** power)

    def affords(self, teams: Sequence[Team], seeds: Sequence[int], share: float, reserve: float = 0.0) -> bool:
        """Return whether the missing ones of these episodes should end within a share of the time.

        reserve: seconds to be left after them.
        """
        needed = sum(self.seconds(team.robots) for team, _ in self._missing(teams, seeds))
        return self.clock.allows(needed + reserve, share)

    def loads(self, policy: str, use: Use = Use.CHOOSE) -> list[LoadPoint]:
        """Return the load of each number of a policy's robots, on the seeds of a use."""
        own = set(self.plan.seeds(use, BLOCK))
        found: dict[int, list[Row]] = {}
        for (team, seed), row in sorted(self._rows.items()):
            if (team.policy, team.floor) == (policy, AS_IS) and seed in own:
                found.setdefault(team.robots, []).append(row)
        return loads(found, self.plan.aim)

    def repeat(self, teams: Sequence[Team], use: Use, most: int, share: float) -> list[list[Row]]:
        """Drive teams on the same seeds, FEWEST times and then as often as there is time; return the rows of each."""
        done, most = 0, self.plan.at_most(most)
        while done < most:
            more = min(most, max(FEWEST, done + self.plan.processes))
            if done and not self.affords(teams, self.plan.seeds(use, more), share):
                break
            done = more
            self.rows(teams, self.plan.seeds(use, done))
        return self.rows(teams, self.plan.seeds(use, done))

    def of(self, team: Team) -> list[Row]:
        """Return all rows of a team."""
        return [row for (one, _), row in sorted(self._rows.items()) if one == team]

    def race(
        self, teams: Sequence[Team], rounds: int, share: float,
        settled: Callable[[Sequence[Team]], bool] = lambda left: len(left) <= 1,
    ) -> dict[Team, list[float]]:  # fmt: skip
        """Race teams by throughput, one seed a round, within a share of the time; a jam counts as 0."""

        def play(left: Sequence[Team], number: int) -> list[float]:
            rows = self.rows(left, self.plan.seeds(Use.CHOOSE, 1, number))
            return [self.plan.aim.made(row) * (row["stuck"] < STUCK) for (row,) in rows]

        def goes_on(left: Sequence[Team], number: int) -> bool:
            return not settled(left) and self.affords(left, self.plan.seeds(Use.CHOOSE, 1, number), share)

        return race(teams, play, self.plan.at_most(rounds), goes_on)

    def _missing(self, teams: Sequence[Team], seeds: Sequence[int]) -> list[tuple[Team, int]]:
        return [(team, seed) for seed in seeds for team in teams if (team, seed) not in self._rows]


def race(
    arms: Iterable[Arm], play: Callable[[Sequence[Arm], int], Sequence[float]], rounds: int, goes_on: GoesOn[Arm]
) -> dict[Arm, list[float]]:
    """Play up to `rounds` while it goes on; return the arms not significantly worse than the best, with their values.

    play: from the remaining arms and the number of the round to a value of each. An arm is dropped if the 95% interval
    of its difference from the best in the same rounds lies below 0. Each round tests again, so this is a rule of thumb:
    measure the winner in rounds of its own.
    """
    left: dict[Arm, list[float]] = {arm: [] for arm in arms}
    for done in range(rounds):
        if not goes_on(list(left), done):
            break
        for values, value in zip(left.values(), play(list(left), done), strict=True):
            values.append(value)
        if done + 1 >= FEWEST:
            best = left[best_of(left)]
            below = {arm: mean_interval(np.subtract(own, best).tolist()).high < 0 for arm, own in left.items()}
            left = {arm: own for arm, own in left.items() if not below[arm]}
    return left


def best_of(raced: Mapping[Arm, Sequence[float]]) -> Arm:
    """Return the arm with the highest mean, the first of equals."""
    return max(raced, key=lambda arm: float(np.mean(raced[arm])) if raced[arm] else 0.0)
