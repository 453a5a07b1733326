"""What changes of the floor bring: many race in few pairs of episodes, the best of each kind is measured anew.

Numbers of stations and of chargers are a ladder: all of its rungs are measured, each until it is told.
"""

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

KINDS: tuple[Kind, ...] = ("aisle", "one-way")  # that are raced; what others there are is a ladder
SOUGHT = 6  # changes of each kind that are driven at most, where there is time
CHOSEN_AT = 3  # bottlenecks, the worst ones, that changes are sought for
ROUNDS = 6  # of the race, at most
PAIRS = 8  # of episodes before a change is said to bring something
LEAST = PAIRS * (1 + len(KINDS))  # episodes, of the best aisle, the best rule and the floor as it is
MOST_PAIRS = 64  # where there is time
LOOKS = (8, 16, 32)  # pairs after which a rung of a ladder that is told needs no more; the end is a further look


def kinds(plan: Plan) -> tuple[Kind, ...]:
    """Return the kinds of changes that are tried."""
    return KINDS + fittings.kinds(plan.work)


def ladders(plan: Plan) -> int:
    """Return how many ladders are tried."""
    return len(kinds(plan)) - len(KINDS)


def sure(kind: Kind) -> float:
    """Return what of an interval holds: where nothing helps, at most five of a hundred are told otherwise.

    Of a hundred floors for aisles and one-way rules together, and for all rungs of a ladder at all looks together.
    """
    return 1 - 0.05 / (len(KINDS) if kind in KINDS else fittings.RUNGS * (len(LOOKS) + 1))


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
    plan: Plan,
    worst: Sequence[Bottleneck],
    trips: Sequence[Task],
    flow: NDArray[np.float64],
    crew: Crew,
    most: int,
    rungs: int,
) -> list[Candidate]:
    """Return the changes by which trips should cost least, up to `most` of each kind, of aisles at the worst places.

    rungs: of each ladder, at most.
    """
    cells = [place.cell for place in worst[:CHOSEN_AT]]
    opened = [one for cell in cells for one in candidates.aisles(plan.grid, cell)]
    directed = [one for cell in cells for one in candidates.one_ways(plan.grid, cell, flow)]
    directed += candidates.alternating(plan.grid) if cells else []
    chosen = [one for kind in (opened, directed) for one in candidates.choose(kind, trips, crew.robots, most)]
    return chosen + fittings.options(plan, crew, rungs)


def affordable_rungs(left: float, took: float, of: int) -> int:
    """Return how many rungs, 0 to RUNGS, of each of so many ladders can be driven PAIRS times in the seconds left.

    The best aisle, the best rule and the floor as it is are driven as often. took: an episode.
    """
    measured = min(left / max(took, 1e-9), 1e9) // PAIRS - 1 - len(KINDS)
    return int(min(fittings.RUNGS, max(0, measured // of))) if of else 0


def affordable(left: float, took: float, rungs: int = 0) -> int:
    """Return how many aisles, and how many rules, 0 to SOUGHT, can be raced in the seconds that are left.

    The best of each, the rungs and the floor as it is are then driven PAIRS times; who is alone needs no race.
    took: an episode; rungs: of all ladders.
    """
    episodes = min(left / max(took, 1e-9), 1e9) - LEAST - PAIRS * rungs
    return 0 if episodes < 0 else int(min(SOUGHT, max(1, (episodes / FEWEST - 1) // len(KINDS))))


def effects(plan: Plan, chosen: Sequence[Candidate], crew: Crew, drive: Drive, clock: Clock) -> list[Effect]:
    """Race aisles and rules, then measure the best of each on new seeds, for what it was chosen by flatters it.

    The effects are in the order of their kind, best first; all rungs of a ladder are measured, the fewest come first.
    """
    rungs = [one for kind in fittings.kinds(plan.work) for one in chosen if one.kind == kind]
    rounds = _Rounds(plan, crew, drive, clock, len(rungs))
    order: list[tuple[Candidate, Interval]] = []
    for kind in KINDS:
        order += _raced([one for one in chosen if one.kind == kind], rounds)
    best = [one for k, (one, _) in enumerate(order) if k == 0 or order[k - 1][0].kind != one.kind]
    order += [(one, mean_interval([])) for one in rungs]
    base, again = rounds.pairs([*best, *rungs])
    return [_effect(one, first, base, again.get(one.text), plan, crew.robots) for one, first in order]


class _Rounds:
    """Rounds of episodes on changed floors and the one as it is, a seed a round."""

    def __init__(self, plan: Plan, crew: Crew, drive: Drive, clock: Clock, rungs: int) -> None:
        self.plan, self.crew, self._drive, self._clock, self._rungs = plan, crew, drive, clock, rungs
        self.took = 0.0  # [s], an episode of the last round
        self.base: dict[int, Row] = {}  # episodes on the floor as it is, by seed

    def look(self, left: Sequence[Candidate], number: int) -> list[float]:
        """Return what changes bring in a round of their race, an hour."""
        (base,), *rows = self._driven(left, self.plan.seeds(Use.LOOK, 1, number))
        gain = self.plan.aim.gain
        return [self.crew.robots * (gain(row) - gain(base)) for (row,) in rows]

    def go_on(self, left: Sequence[Candidate], number: int) -> bool:
        """Return whether there is time for another round beside those that measure."""
        reserved = PAIRS * (1 + len(KINDS) + self._rungs) * self.took
        return number < FEWEST or self._clock.allows((len(left) + 1) * self.took + reserved)

    def pairs(self, best: Sequence[Candidate]) -> tuple[list[Row], dict[str, list[Row]]]:
        """Drive the floor as it is and the best changes, FEWEST times at least and as often as there is time for.

        A rung that is told drives no more. Returns the rows of the floor as it is, and by their text those of changes.
        """
        base, found, left = list[Row](), {one.text: list[Row]() for one in best}, list(best)
        done, most = 0, self.plan.at_most(MOST_PAIRS)
        while left and done < most:
            look = next((look for look in LOOKS if look > done), most)
            count = min(most, look) - done
            count = min(count, max(0 if done else FEWEST, self.plan.processes))
            if done and not self._clock.allows(count * (1 + len(left)) * self.took):
                break
            as_is, *rows = self._driven(left, self.plan.seeds(Use.MEASURE, count, done))
            base += as_is
            for one, own in zip(left, rows, strict=True):
                found[one.text] += own
            done += count
            if done in LOOKS:
                left = [one for one in left if one.kind in KINDS or not self._told(one, base, found[one.text])]
        return base, found

    def _told(self, one: Candidate, base: Sequence[Row], rows: Sequence[Row]) -> bool:
        gained = paired(rows, base, self.plan.aim.gain, ("seed",), sure(one.kind))
        return not gained.low <= 0 <= gained.high

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
    if rows is None:
        return Effect(one, first, mean_interval(map(gain, base)).times(robots), None, None, None)
    base = base[: len(rows)]
    goals, waiting, trip, took = (
        paired(rows, base, value, ("seed",), sure(one.kind))
        for value in (gain, *map(field_of, ("waiting_share", "path_length_m", "order_median_s")))
    )
    whole = mean_interval(map(gain, base)).times(robots)
    return Effect(one, first, whole, goals.times(robots), waiting, trip, took if took.samples else None)
