"""Changes: noise is not called a gain, a gain is found, and lost storage is counted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from tests.train.advice.floors import driver, floor_of, plan_of
from train.advice.candidates import Candidate, storage_lost
from train.advice.changes import PAIRS, Effect, affordable, effects
from train.advice.study import Team, TrialRuns
from train.advice.trials import AS_IS, BLOCK, TimeBudget, Trial, Use

HALL = floor_of(*["............"] * 10)
TEAM = Team("ours", 20)
NOTHING = np.zeros(HALL.shape, dtype=np.bool_)
AISLES = [Candidate("aisle", f"aisle {k}", HALL, NOTHING) for k in range(6)]
RULES = [Candidate("one-way", f"rule {k}", HALL, NOTHING) for k in range(6)]


def tried(salt: int, pairs: int = PAIRS, **changed: float) -> list[Effect]:
    """Return the effects of six changes of each kind, in noise of 3%; changed: what some bring, "_" for a blank."""
    gains = {name.replace("_", " "): gain for name, gain in changed.items()}
    drive = driver({"ours": lambda robots: 4000.0}, 0.03, changed=gains, salt=salt)
    return effects(TrialRuns(plan_of(HALL, episodes=pairs), drive, TimeBudget(None)), [*AISLES, *RULES], TEAM)


def test_noise_is_called_a_gain_on_at_most_one_floor_in_twenty() -> None:
    floors = [tried(salt) for salt in range(60)]
    assert all([effect.tried for effect in floor] == [6, 6] for floor in floors)
    assert sum(any(effect.significant for effect in floor) for floor in floors) <= 7  # of 60 at 5%, with 98%


@pytest.mark.parametrize("salt", range(3))
def test_what_helps_is_found_among_what_does_not(salt: int) -> None:
    best, *_ = tried(salt, 12, aisle_3=400.0, rule_1=-400.0)
    assert best.candidate.text == "aisle 3"
    assert best.significant
    assert best.gain.mean == pytest.approx(400.0, abs=150.0)


def test_a_gain_is_measured_on_seeds_that_had_no_part_in_the_race() -> None:
    def drive(trials: Sequence[Trial]) -> list[dict[str, Any]]:
        """Give changed floors twice as much on the seeds of the race."""
        rows = driver({"ours": lambda robots: 4000.0})(trials)
        for row, trial in zip(rows, trials, strict=True):
            lucky = trial.floor != AS_IS and row["seed"] in plan_of(HALL).seeds(Use.LOOK, BLOCK)
            row["goals_per_robot_hour"] *= 2 if lucky else 1
        return rows

    (effect,) = effects(TrialRuns(plan_of(HALL, episodes=12), drive, TimeBudget(None)), AISLES, TEAM)
    assert effect.gain.mean == 0


def test_few_pairs_tell_nothing() -> None:
    best, *_ = tried(0, PAIRS - 1, aisle_3=4000.0)
    assert best.gain.low > 0
    assert not best.significant


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


def test_a_single_change_needs_no_race() -> None:
    driven: list[str] = []

    def drive(trials: Sequence[Trial]) -> list[dict[str, Any]]:
        driven.extend(trial.floor for trial in trials)
        return driver({"ours": lambda robots: 4000.0})(trials)

    study = TrialRuns(plan_of(HALL), drive, TimeBudget(None))
    assert [effect.tried for effect in effects(study, AISLES[:1], TEAM)] == [1]
    assert all(driven.count(floor) == 6 for floor in ("as it is", "aisle 0"))
    assert effects(study, [], TEAM) == []
