"""What changes of the floor bring: many race in few pairs of episodes, the best of each kind is measured anew."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.advice import candidates, fittings
from train.advice.candidates import Bottleneck, Candidate, Kind
from train.advice.race import FEWEST, race
from train.advice.study import Crew
from train.advice.trials import AS_IS, Clock, Drive, Plan, Use
from train.reporting.columns import field_of
from train.reporting.rows import Interval, Row, mean_interval, paired
from warehouse_env.traffic.together import Task

KINDS: tuple[Kind, ...] = ("aisle", "one-way")  # where nothing takes time
SOUGHT = 6  # changes of each kind that are driven at most, where there is time
CHOSEN_AT = 3  # bottlenecks, the worst ones, that changes are sought for
ROUNDS = 6  # of the race, at most
PAIRS = 8  # of episodes before a change is said to bring something
MOST_PAIRS = 40  # where there is time


def kinds(plan: Plan) -> tuple[Kind, ...]:
    """Return the kinds of changes that are tried."""
    return KINDS + fittings.kinds(plan.work)


def sure(plan: Plan) -> float:
    """Return what of an interval holds: of a hundred floors where nothing helps, at most five are told otherwise."""
    return 1 - 0.05 / len(kinds(plan))


class Effect(NamedTuple):
    """What a change of the floor brings, in pairs of episodes with the same seeds."""

    candidate: Candidate
    first: Interval  # goals, or orders in time, per hour of all robots, by which it was chosen among others
    base: Interval  # the same on the floor as it is, in the episodes of `goals`
    goals: Interval | None  # the difference in episodes of their own, at `sure`; None for what was not chosen
    waiting: Interval | None  # share of time, the same
    trip: Interval | None  # metres driven to a goal, the same
    took: Interval | None = None  # [s] from an order's release to its drop, the median of an episode, the same

    @property
    def told(self) -> bool:
        """Whether there were enough pairs, and their interval leaves out 0."""
        return self.goals is not None and self.goals.samples >= PAIRS and not self.goals.low <= 0 <= self.goals.high


def options(
    plan: Plan, worst: Sequence[Bottleneck], trips: Sequence[Task], flow: NDArray[np.float64], crew: Crew, most: int
) -> list[Candidate]:
    """Return the changes by which trips should cost least, up to `most` of each kind; of aisles at the worst places."""
    cells = [place.cell for place in worst[:CHOSEN_AT]]
    opened = [one for cell in cells for one in candidates.aisles(plan.grid, cell)]
    directed = [one for cell in cells for one in candidates.one_ways(plan.grid, cell, flow)]
    directed += candidates.alternating(plan.grid) if cells else []
    chosen = [one for kind in (opened, directed) for one in candidates.choose(kind, trips, crew.robots, most)]
    return chosen + fittings.options(plan, crew, most)


def affordable(left: float, took: float, of: int = len(KINDS)) -> int:
    """Return how many changes of each kind, 0 to SOUGHT, can be raced in the seconds that are left.

    The best of each kind, and the floor as it is, are then driven PAIRS times; who is alone in its kind needs no race.
    took: an episode; of: kinds.
    """
    episodes = min(left / max(took, 1e-9), 1e9) - PAIRS * (1 + of)
    return 0 if episodes < 0 else int(min(SOUGHT, max(1, (episodes / FEWEST - 1) // of)))


def effects(plan: Plan, chosen: Sequence[Candidate], crew: Crew, drive: Drive, clock: Clock) -> list[Effect]:
    """Race the changes of each kind, then measure the best of each on new seeds, for what it was chosen by flatters it.

    The effects are in the order of their kind, best first.
    """
    rounds = _Rounds(plan, crew, drive, clock)
    order: list[tuple[Candidate, Interval]] = []
    for kind in kinds(plan):
        order += _raced([one for one in chosen if one.kind == kind], rounds)
    best = [one for k, (one, _) in enumerate(order) if k == 0 or order[k - 1][0].kind != one.kind]
    base, again = rounds.pairs(best)
    found = {one.text: rows for one, rows in zip(best, again, strict=True)}
    return [_effect(one, first, base, found.get(one.text), plan, crew.robots) for one, first in order]


class _Rounds:
    """Rounds of episodes on changed floors and the one as it is, a seed a round."""

    def __init__(self, plan: Plan, crew: Crew, drive: Drive, clock: Clock) -> None:
        self.plan, self.crew, self._drive, self._clock = plan, crew, drive, clock
        self.took = 0.0  # [s], an episode of the last round
        self.base: dict[int, Row] = {}  # episodes on the floor as it is, by seed

    def look(self, left: Sequence[Candidate], number: int) -> list[float]:
        """Return what changes bring in a round of their race, an hour."""
        (base,), *rows = self._driven(left, self.plan.seeds(Use.LOOK, 1, number))
        gain = self.plan.aim.gain
        return [self.crew.robots * (gain(row) - gain(base)) for (row,) in rows]

    def go_on(self, left: Sequence[Candidate], number: int) -> bool:
        """Return whether there is time for another round beside those that measure."""
        reserved = PAIRS * (1 + len(kinds(self.plan))) * self.took
        return number < FEWEST or self._clock.allows((len(left) + 1) * self.took + reserved)

    def pairs(self, best: Sequence[Candidate]) -> tuple[list[Row], list[list[Row]]]:
        """Drive the floor as it is and the best changes, FEWEST times at least and as often as there is time for."""
        found: list[list[Row]] = [[] for _ in range(1 + len(best))]
        done, most = 0, self.plan.at_most(MOST_PAIRS) if best else 0
        while done < most:
            count = min(most - done, max(0 if done else FEWEST, self.plan.processes))
            if done and not self._clock.allows(count * len(found) * self.took):
                break
            for own, rows in zip(found, self._driven(best, self.plan.seeds(Use.MEASURE, count, done)), strict=True):
                own += rows
            done += count
        base, *again = found
        return base, again

    def _driven(self, floors: Sequence[Candidate], seeds: Sequence[int]) -> list[list[Row]]:
        """Drive the floor as it is, where that is not known, and changed ones; return the rows of each."""
        begin, plan = self._clock.spent, self.plan
        lacking = [seed for seed in seeds if seed not in self.base]
        asked = plan.trials(plan.grid, *self.crew, lacking, AS_IS)
        asked += [trial for one in floors for trial in plan.trials(one.grid, *self.crew, seeds, one.text, one.work)]
        rows = self._drive(asked)
        self.base |= zip(lacking, rows[: len(lacking)], strict=True)
        rows = rows[len(lacking) :]
        self.took = (self._clock.spent - begin) / max(1, len(asked))
        changed = [rows[k * len(seeds) : (k + 1) * len(seeds)] for k in range(len(floors))]
        return [[self.base[seed] for seed in seeds], *changed]


def _raced(chosen: Sequence[Candidate], rounds: _Rounds) -> list[tuple[Candidate, Interval]]:
    """Race changes of one kind; return them and what they brought, best first: those left, then those out."""
    by_text = {one.text: one for one in chosen}
    raced = race(
        list(by_text), lambda left, number: rounds.look([by_text[text] for text in left], number),
        rounds.plan.at_most(ROUNDS), lambda left, number: rounds.go_on([by_text[text] for text in left], number),
    )  # fmt: skip
    found = {text: mean_interval(values) for text, values in raced.values.items()}
    order = sorted(found, key=lambda text: (text not in raced.left, -found[text].mean if found[text].samples else 0.0))
    return [(by_text[text], found[text]) for text in order]


def _effect(
    one: Candidate, first: Interval, base: Sequence[Row], rows: Sequence[Row] | None, plan: Plan, robots: int
) -> Effect:
    gain = plan.aim.gain
    whole = mean_interval(map(gain, base)).times(robots)
    if rows is None:
        return Effect(one, first, whole, None, None, None)
    goals, waiting, trip, took = (
        paired(rows, base, value, ("seed",), sure(plan))
        for value in (gain, *map(field_of, ("waiting_share", "path_length_m", "order_median_s")))
    )
    return Effect(one, first, whole, goals.times(robots), waiting, trip, took if took.samples else None)
