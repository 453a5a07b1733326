"""What changes of the floor gain: aisles and one-way rules are raced, and the best are measured on new seeds.

One more and one fewer station or charger are measured without a race.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.advice import candidates, fittings
from train.advice.candidates import Bottleneck, Candidate, Kind
from train.advice.race import FEWEST, race
from train.advice.study import Team
from train.advice.tasks import Task
from train.advice.trials import AS_IS, AdvicePlan, Drive, TimeBudget, Use
from train.reporting.rows import Interval, Row, mean_interval, paired

KINDS: tuple[Kind, ...] = ("aisle", "one-way")  # that are raced
SOUGHT = 6  # changes of each kind that are raced, at most
CHOSEN_AT = 3  # bottlenecks at which changes are sought
ROUNDS = 6  # of the race, at most
PAIRS = 8  # of episodes, from which on a gain is reported
MOST_PAIRS = 64


class Effect(NamedTuple):
    """What a change of the floor gains, in pairs of episodes with the same seeds."""

    candidate: Candidate
    tried: int  # changes of its kind, of which it was the best
    base: Interval  # goals, or orders in time, per hour of all robots on the floor as it is
    gain: Interval  # difference; all gains of an advice together hold with 95%

    @property
    def told(self) -> bool:
        """Whether there are enough pairs, and the interval excludes 0."""
        return self.gain.samples >= PAIRS and not self.gain.low <= 0 <= self.gain.high


def kinds(plan: AdvicePlan) -> tuple[Kind, ...]:
    """Return the kinds of changes that are tried."""
    return KINDS + fittings.kinds(plan.work)


def options(
    plan: AdvicePlan,
    worst: Sequence[Bottleneck],
    trips: Sequence[Task],
    flow: NDArray[np.float64],
    crew: Team,
    most: int,
) -> list[Candidate]:
    """Return the changes to try: up to `most` aisles and rules at the worst places, and all of the other kinds."""
    if not most:
        return []
    cells = [place.cell for place in worst[:CHOSEN_AT]]
    opened = [one for cell in cells for one in candidates.aisles(plan.grid, cell)]
    directed = [one for cell in cells for one in candidates.one_ways(plan.grid, cell, flow)]
    directed += candidates.alternating(plan.grid) if cells else []
    chosen = [one for kind in (opened, directed) for one in candidates.choose(kind, trips, crew.robots, most)]
    return chosen + fittings.options(plan, crew)


def affordable(left: float, took: float, others: int = 0) -> int:
    """Return how many aisles, and how many rules, can be raced in the seconds left, 0 to SOUGHT.

    The best of each, the floor as it is and `others` changes are then driven PAIRS times. took: of an episode.
    """
    episodes = min(left / max(took, 1e-9), 1e9) - PAIRS * (1 + len(KINDS) + others)
    return 0 if episodes < 0 else int(min(SOUGHT, max(1, (episodes / FEWEST - 1) // len(KINDS))))


def effects(plan: AdvicePlan, chosen: Sequence[Candidate], crew: Team, drive: Drive, clock: TimeBudget) -> list[Effect]:
    """Race aisles and rules, then measure the best of each kind, and all of the other kinds, on new seeds."""
    others = [(one, 1) for one in chosen if one.kind not in KINDS]
    rounds = _Rounds(plan, crew, drive, clock, len(others))
    raced = [[one for one in chosen if one.kind == kind] for kind in KINDS]
    measured = [(rounds.best_of(own), len(own)) for own in raced if own] + others
    base, gained = rounds.pairs([one for one, _ in measured])
    whole = mean_interval(map(plan.aim.gain, base)).times(crew.robots)
    sure = 1 - 0.05 / max(1, len(measured))
    return [
        Effect(one, tried, whole, paired(rows, base, plan.aim.gain, ("seed",), sure).times(crew.robots))
        for (one, tried), rows in zip(measured, gained, strict=True)
    ]


class _Rounds:
    """Rounds of episodes on changed floors and the floor as it is, with the same seeds."""

    def __init__(self, plan: AdvicePlan, crew: Team, drive: Drive, clock: TimeBudget, others: int) -> None:
        self._plan, self._crew, self._drive, self._clock, self._others = plan, crew, drive, clock, others
        self._took = 0.0  # [s] of an episode in the last round
        self._base: dict[int, Row] = {}  # episodes on the floor as it is, by seed

    def best_of(self, changes: Sequence[Candidate]) -> Candidate:
        """Race changes; return the best."""
        by_text = {one.text: one for one in changes}

        def play(left: Sequence[str], number: int) -> list[float]:
            (base,), *rows = self._driven([by_text[text] for text in left], self._plan.seeds(Use.LOOK, 1, number))
            return [self._plan.aim.gain(row) - self._plan.aim.gain(base) for (row,) in rows]

        def go_on(left: Sequence[str], number: int) -> bool:
            reserved = PAIRS * (1 + len(KINDS) + self._others) * self._took
            return number < FEWEST or self._clock.allows((len(left) + 1) * self._took + reserved)

        return by_text[race(list(by_text), play, self._plan.at_most(ROUNDS), go_on).best]

    def pairs(self, changes: Sequence[Candidate]) -> tuple[list[Row], list[list[Row]]]:
        """Drive the floor as it is and these changes, FEWEST times and then as often as there is time; return rows."""
        base, found = list[Row](), [list[Row]() for _ in changes]
        most = self._plan.at_most(MOST_PAIRS)
        while changes and len(base) < most:
            done = len(base)
            count = min(most - done, max(0 if done else FEWEST, self._plan.processes))
            if done and not self._clock.allows(count * (1 + len(changes)) * self._took):
                break
            as_is, *rows = self._driven(changes, self._plan.seeds(Use.MEASURE, count, done))
            base += as_is
            for known, own in zip(found, rows, strict=True):
                known += own
        return base, found

    def _driven(self, floors: Sequence[Candidate], seeds: Sequence[int]) -> list[list[Row]]:
        """Return the rows of the floor as it is, which may be known, and of changed ones."""
        begin, plan = self._clock.spent, self._plan
        lacking = [seed for seed in seeds if seed not in self._base]
        asked = plan.trials(plan.grid, *self._crew, lacking, AS_IS)
        asked += [trial for one in floors for trial in plan.trials(one.grid, *self._crew, seeds, one.text, one.work)]
        rows = self._drive(asked)
        self._base |= zip(lacking, rows[: len(lacking)], strict=True)
        rows = rows[len(lacking) :]
        self._took = (self._clock.spent - begin) / max(1, len(asked))
        changed = [rows[k * len(seeds) : (k + 1) * len(seeds)] for k in range(len(floors))]
        return [[self._base[seed] for seed in seeds], *changed]
