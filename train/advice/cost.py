"""How long an advice takes on this machine, told from the first episodes of it."""

from __future__ import annotations

from collections.abc import Iterable

from train.advice import capacity, changes
from train.advice.curve import rungs
from train.advice.fittings import RUNGS
from train.advice.race import FEWEST
from train.advice.study import Study

UPWARD = 8  # times as many robots as the search begins with: about where most goals are made


def expected(study: Study, minutes: float | None) -> str:
    """Say how long it should take to find the number of robots, and what changes bring; minutes: those given."""
    first = capacity.begins_with(study.plan.grid, study.plan.most)
    number, change = needed(study)
    text = (
        f"An episode of {first} robots takes {study.seconds(first):.2g} s here. The number of robots should take about "
        f"{_rounded(number)}, what changes of the floor bring {_rounded(change)} more."
    )
    if minutes is None or minutes >= number + change:
        return text
    given = f"{minutes:g} minute{'s' * (minutes != 1)}"
    if minutes >= number:
        return f"{text} In {given} fewer changes are tried, and less is told of them."
    return f"{text} In {given} it is looked for less closely, and may not be found."


def needed(study: Study) -> tuple[float, float]:
    """Return about how long [min] it takes to find the number of robots, and what changes bring."""
    plan = study.plan
    first = capacity.begins_with(plan.grid, plan.most)
    most = min(plan.most, UPWARD * first)
    return _minutes(study, _for_the_number(study, first, most)), _minutes(
        study, _for_changes(most, changes.ladders(plan))
    )


def _for_the_number(study: Study, first: int, most: int) -> Iterable[tuple[int, int]]:
    """Yield episodes and robots: on the way up, between policies, between numbers, below them, and confirmed."""
    plan, policies = study.plan, len(study.plan.policies)
    near = rungs(max(1, most // 2), min(2 * most, plan.most))
    yield from ((capacity.SCOUTS, count) for count in (first, most // 4, most // 2, most, near[-1]))
    yield from (((policies - 1) * FEWEST, count) for count in (most // 2, most))
    yield from ((FEWEST, count) for count in near)
    yield from ((capacity.STEADY, count) for count in rungs(max(1, most // 4), most))
    yield capacity.CONFIRMED * policies, most


def _for_changes(most: int, ladders: int) -> Iterable[tuple[int, int]]:
    raced = len(changes.KINDS)
    yield FEWEST * (raced * (changes.SOUGHT + 1)), most
    yield changes.PAIRS * (1 + raced + ladders * RUNGS), most


def _minutes(study: Study, asked: Iterable[tuple[int, int]]) -> float:
    return sum(study.plan.at_most(episodes) * study.seconds(robots) for episodes, robots in asked) / 60


def _rounded(minutes: float) -> str:
    return f"{60 * minutes:.0f} s" if minutes < 1 else f"{minutes:.0f} minute{'s' * (round(minutes) > 1)}"
