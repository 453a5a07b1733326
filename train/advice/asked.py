"""The fewest robots that make the goals an hour, or orders in time, asked for; confirmed on new seeds."""

from __future__ import annotations

import math
from typing import NamedTuple

from train.advice.capacity import Capacity
from train.advice.curve import bracket, fewest_that
from train.advice.study import Team, TrialRuns
from train.advice.trials import Use
from train.reporting.rows import Interval, mean_interval

LOOKS = (4, 8, 12, 16)  # episodes of a number, until it is clear whether it makes enough
ANSWERS = 12  # episodes on new seeds of a number that may be the answer
TRIES = 3  # of such numbers, at most
SURE = 1 - 0.05 / TRIES  # of each interval, so that all together hold with 95%


class RobotsNeeded(NamedTuple):
    """What it takes to make the goals an hour, or the share of orders in time, asked for."""

    wanted: float  # goals per hour, or the share
    robots: int | None  # that make them, None if no number surely does
    goals: Interval  # what those make, at SURE; else what the best make

    @property
    def possible(self) -> bool:
        """Whether the floor may bear it."""
        return not self.goals.high < self.wanted


def asked(study: TrialRuns, capacity: Capacity, share: float) -> RobotsNeeded:
    """Return the fewest robots of the chosen policy that make what the plan wants, if the floor can."""
    plan, policy = study.plan, capacity.crew.policy
    wanted = plan.wanted or 0.0
    none = RobotsNeeded(wanted, None, capacity.goals.asked)
    ends = bracket(capacity.loads, wanted)
    if ends is None:
        return none

    def reaches(robots: int) -> bool:
        crew, made = Team(policy, robots), Interval(0.0, -math.inf, math.inf, 0)
        for episodes in LOOKS:
            seeds = plan.seeds(Use.ASK, plan.at_most(episodes))
            if not made.low < wanted <= made.high or not study.affords([crew], seeds, share):
                break
            made = mean_interval(map(plan.aim.asked, *study.rows([crew], seeds)))
        return made.low >= wanted

    number = fewest_that(reaches, *ends)
    for _ in range(TRIES):
        (rows,) = study.rows([Team(policy, number)], plan.seeds(Use.ANSWER, plan.at_most(ANSWERS)))
        made = mean_interval(map(plan.aim.asked, rows), SURE)
        if made.low >= wanted:
            return RobotsNeeded(wanted, number, made)
        number = min(plan.most, number + max(1, number // 16))
    return none
