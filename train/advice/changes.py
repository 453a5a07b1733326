"""What changes of the floor gain: aisles and one-way rules are raced, and the best are measured on new seeds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.advice import candidates
from train.advice.candidates import Candidate, Kind
from train.advice.study import FEWEST, Team, TrialRuns, best_of, race
from train.advice.trials import AdvicePlan, Use
from train.advice.trips import Bottleneck, Trip
from train.reporting.rows import Interval, mean_interval
from train.reporting.trainings import difference_of

KINDS: tuple[Kind, ...] = ("aisle", "one-way")
SOUGHT = 6  # changes of each kind that are raced, at most
CHOSEN_AT = 3  # bottlenecks at which changes are sought
ROUNDS = 6  # of the race, at most
PAIRS = 8  # of episodes, from which on a gain is reported
MOST_PAIRS = 64


class Effect(NamedTuple):
    """What a change of the floor gains, in pairs of episodes with the same seeds."""

    candidate: Candidate
    tried: int  # changes of its kind, of which it was the best
    base: Interval  # goals, or orders, per hour of all robots on the floor as it is
    gain: Interval  # difference; all gains of an advice together hold with 95%

    @property
    def significant(self) -> bool:
        """Whether there are enough pairs, and the interval excludes 0."""
        return self.gain.samples >= PAIRS and not self.gain.low <= 0 <= self.gain.high


def options(
    plan: AdvicePlan, worst: Sequence[Bottleneck], trips: Sequence[Trip], moves: NDArray[np.float64], robots: int,
    most: int,
) -> list[Candidate]:  # fmt: skip
    """Return up to `most` changes of each kind at the worst places; moves: see RouteTraffic."""
    if not most:
        return []
    cells = [place.cell for place in worst[:CHOSEN_AT]]
    opened = [one for cell in cells for one in candidates.aisles(plan.grid, cell)]
    directed = [one for cell in cells for one in candidates.one_ways(plan.grid, cell, moves)]
    return [one for kind in (opened, directed) for one in candidates.choose(kind, trips, robots, most)]


def affordable(left: float, took: float) -> int:
    """Return how many changes of each kind can be raced in the seconds left, 0 to SOUGHT.

    The best of each and the floor as it is are then driven PAIRS times. took: of an episode.
    """
    episodes = min(left / max(took, 1e-9), 1e9) - PAIRS * (1 + len(KINDS))
    return 0 if episodes < 0 else int(min(SOUGHT, max(1, (episodes / FEWEST - 1) // len(KINDS))))


def effects(study: TrialRuns, chosen: Sequence[Candidate], team: Team) -> list[Effect]:
    """Race the changes of each kind, and measure the best of each on new seeds."""
    kinds = [own for kind in KINDS if (own := [one for one in chosen if one.kind == kind])]
    if not kinds:
        return []
    aim, robots = study.plan.aim, team.robots
    study.floors |= {one.text: one.grid for one in chosen}
    measured = [_best_of(study, own, team) for own in kinds]
    base, *gained = study.repeat(
        [team, *(team._replace(floor=one.text) for one in measured)], Use.MEASURE, MOST_PAIRS, 1.0
    )
    whole = mean_interval(map(aim.gain, base)).times(robots)
    sure = 1 - 0.05 / len(measured)
    return [
        Effect(one, len(own), whole, difference_of(rows, base, aim.gain, ("seed",), sure).times(robots))
        for one, own, rows in zip(measured, kinds, gained, strict=True)
    ]


def _best_of(study: TrialRuns, changes: Sequence[Candidate], team: Team) -> Candidate:
    """Race changes; return the best."""
    gain, changed = study.plan.aim.gain, {team._replace(floor=one.text): one for one in changes}

    def play(left: Sequence[Team], number: int) -> list[float]:
        (base,), *rows = study.rows([team, *left], study.plan.seeds(Use.LOOK, 1, number))
        return [gain(row) - gain(base) for (row,) in rows]

    def goes_on(left: Sequence[Team], number: int) -> bool:
        seeds, reserve = study.plan.seeds(Use.LOOK, 1, number), PAIRS * (1 + len(KINDS)) * study.seconds(team.robots)
        return len(left) > 1 and (number < FEWEST or study.affords([team, *left], seeds, 1.0, reserve))

    return changed[best_of(race(changed, play, study.plan.at_most(ROUNDS), goes_on))]
