"""What changes bring: that noise is not called a gain, that a gain is found, and what storage is lost."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.train.advice.floors import driver, floor_of, plan_of
from train.advice.candidates import Candidate, storage_lost
from train.advice.changes import PAIRS, Effect, affordable, effects
from train.advice.study import Crew
from train.advice.trials import Clock

HALL = floor_of(*["............"] * 10)
CREW = Crew("ours", 20)
NOTHING = np.zeros(HALL.shape, dtype=np.bool_)
AISLES = [Candidate("aisle", f"aisle {k}", HALL, NOTHING) for k in range(6)]
RULES = [Candidate("one-way", f"rule {k}", HALL, NOTHING) for k in range(6)]


def tried(salt: int, pairs: int = PAIRS, **changed: float) -> list[Effect]:
    """Return the effects of six changes of each kind, in noise of 3%; changed: what some bring, "_" for a blank."""
    gains = {name.replace("_", " "): gain for name, gain in changed.items()}
    drive = driver({"ours": lambda robots: 4000.0}, 0.03, changed=gains, salt=salt)
    return effects(plan_of(HALL, episodes=pairs), [*AISLES, *RULES], CREW, drive, Clock(None))


def test_noise_is_said_to_bring_something_on_at_most_one_floor_in_twenty() -> None:
    floors = [tried(salt) for salt in range(300)]
    measured = [[effect for effect in floor if effect.goals is not None] for floor in floors]
    assert all(len(best) == 2 for best in measured)
    wrong = sum(any(effect.told for effect in best) for best in measured)
    assert wrong <= 23  # of 300 at 5%, as many are seen with 98%
    assert wrong >= 4  # and the intervals are no wider than they say
    flattered = sum(any(effect.first.low > 0 for effect in best) for best in measured)
    assert flattered > 2 * wrong  # which is what the episodes would say by which the best was chosen


@pytest.mark.parametrize("salt", range(5))
def test_what_helps_is_found_among_what_does_not(salt: int) -> None:
    best, *_ = tried(salt, 12, aisle_3=400.0, rule_1=-400.0)
    assert best.candidate.text == "aisle 3"
    assert best.told
    assert best.goals is not None
    assert best.goals.mean == pytest.approx(400.0, abs=150.0)


def test_few_pairs_tell_nothing() -> None:
    best, *_ = tried(0, PAIRS - 1, aisle_3=4000.0)
    assert best.goals is not None
    assert best.goals.low > 0
    assert not best.told


def test_those_that_were_not_measured_come_behind_the_best_of_their_kind() -> None:
    found = tried(0)
    assert [effect.candidate.kind for effect in found] == ["aisle"] * 6 + ["one-way"] * 6
    assert [effect.goals is not None for effect in found] == ([True] + [False] * 5) * 2


def test_as_many_changes_as_there_is_time_for() -> None:
    assert affordable(math.inf, 1.0) == 6
    assert affordable((3 * (1 + 2 * 2) + 3 * PAIRS) * 10.0, 10.0) == 2  # two of each kind, then the pairs
    assert affordable(3 * PAIRS * 10.0, 10.0) == 1
    assert affordable((3 * PAIRS - 1) * 10.0, 10.0) == 0


def test_storage_that_an_aisle_costs() -> None:
    """A rack of eight cells with twelve cells around it, one of whose two rows is opened, and a wall that is none."""
    hall = floor_of("######", "......", ".####.", ".####.", "......")
    opened = np.zeros(hall.shape, dtype=np.bool_)
    opened[2, 1:5] = True
    lost = storage_lost(hall, Candidate("aisle", "", hall, opened))
    assert (lost.cells, lost.share) == (4, 0.5)
    picks = {tuple(cell) for cell in hall.picks.tolist()}
    north = picks & {(1, column) for column in range(1, 5)}
    ends = picks & {(2, 0), (2, 5)}
    assert (lost.faces, lost.of) == (len(north) + len(ends), len(picks))
    assert lost.faces > 0


def test_a_floor_may_have_changes_of_one_kind_or_none() -> None:
    drive = driver({"ours": lambda robots: 4000.0})
    (only,) = effects(plan_of(HALL), AISLES[:1], CREW, drive, Clock(None))
    assert only.goals is not None
    assert math.isnan(only.first.mean)  # who runs alone needs no race
    assert effects(plan_of(HALL), [], CREW, drive, Clock(None)) == []
