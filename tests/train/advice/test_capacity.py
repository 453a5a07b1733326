"""The number of robots, on curves with a known peak, a plateau, a collapse and noise; and the fewest for a goal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import pytest

from tests.train.advice.floors import Curve, Slow, driver, floor_of, plan_of
from train.advice.capacity import Capacity, capacity, robots_needed
from train.advice.course import advise
from train.advice.study import TrialRuns, best_of, race
from train.advice.trials import TimeBudget, Trial

HALL = floor_of(*["." * 48] * 48)  # 2,304 cells


def peaked(at: float, each: float = 200.0) -> Curve:
    """Return goals that rise with `each` of the first, are most at `at`, and fall slowly behind."""
    return lambda robots: each * robots * math.exp(-robots / at)


def plateau(robots: float) -> float:
    """Rise to 4,000 goals at 20 robots, and stay."""
    return 200.0 * min(robots, 20.0)


def collapse(robots: float) -> float:
    """Rise to 8,000 goals at 40 robots, and fall to next to nothing beyond."""
    return 200.0 * robots if robots <= 40 else 500.0


def found(curve: Curve, noise: float = 0.0, salt: int = 0, **changes: object) -> Capacity:
    plan = plan_of(HALL, **changes)
    return capacity(TrialRuns(plan, driver({"ours": curve}, noise, salt=salt), TimeBudget(None)))


@pytest.mark.parametrize("salt", range(3))
@pytest.mark.parametrize("at", [7.0, 30.0, 200.0])
def test_a_known_peak_is_found_through_noise(at: float, salt: int) -> None:
    curve = peaked(at)
    one = found(curve, 0.03, salt)
    assert curve(one.team.robots) >= 0.93 * curve(at)
    assert one.team.robots <= 2 * at
    assert one.goals.goals.mean == pytest.approx(curve(one.team.robots), rel=0.05)


def test_of_a_plateau_its_beginning_is_named() -> None:
    one = found(plateau)
    assert one.team.robots == 24  # the first of the numbers tried that makes most
    assert one.knee is not None
    assert 16 < one.knee.mean < 24
    assert one.jam is None


def test_a_collapse_is_not_where_the_most_is() -> None:
    one = found(collapse)
    assert one.team.robots == 32
    assert one.jam is not None
    assert one.jam.robots == 48
    assert one.jam.episodes == 6


@pytest.mark.parametrize("salt", range(3))
def test_the_policy_that_drives_best_is_chosen_and_measured_anew(salt: int) -> None:
    curves = {"ours": peaked(30.0), "better": peaked(30.0, 230.0), "worse": peaked(30.0, 150.0)}
    plan = plan_of(HALL, policies=tuple(curves))
    one = capacity(TrialRuns(plan, driver(curves, 0.03, salt=salt), TimeBudget(None)))
    assert one.team.policy == "better"
    assert one.alone.mean == pytest.approx(230.0, rel=0.1)


def test_the_answer_is_measured_on_seeds_that_had_no_part_in_the_choice() -> None:
    lucky = driver({"ours": peaked(30.0)})

    def drive(trials: Sequence[Trial]) -> list[dict[str, Any]]:
        """Give whoever drives a seed of the choice three times as much."""
        rows = lucky(trials)
        for row in rows:
            row["late_goals_per_robot_hour"] *= 3 if row["seed"] < 1_000 else 1
        return rows

    one = capacity(TrialRuns(plan_of(HALL), drive, TimeBudget(None)))
    assert one.goals.goals.mean == pytest.approx(peaked(30.0)(one.team.robots))


def test_a_floor_on_which_all_get_stuck() -> None:
    one = capacity(
        TrialRuns(plan_of(HALL), driver({"ours": peaked(160.0)}, stuck=lambda robots: 1.0), TimeBudget(None))
    )
    assert one.goals.jammed
    assert one.jam is not None
    assert one.jam.robots == 1


def test_on_a_large_floor_the_peak_is_found_in_little_time() -> None:
    """An episode takes 1 ms a robot, so a second is one episode of a thousand; 512 make most."""
    clock = Slow(0.6, driver({"ours": peaked(512.0)}, 0.01, seconds=lambda robots: robots / 1000))
    one = capacity(TrialRuns(plan_of(floor_of(*["." * 180] * 180), episodes=None, most=2048), clock.drive, clock))
    assert one.team.robots in (384, 512)
    assert one.knee is not None
    assert 100 < one.knee.mean < 250
    assert clock.spent <= 60 * 0.6


@pytest.mark.parametrize(("minutes", "sought"), [(0.1, False), (30.0, True)])
def test_the_time_is_kept_and_used(minutes: float, sought: bool) -> None:
    clock = Slow(minutes, driver({"ours": peaked(250.0)}, 0.01, seconds=lambda robots: robots / 1000))
    one = advise(plan_of(HALL, episodes=None), clock.drive, clock)
    assert one.sought == sought
    assert clock.spent <= 60 * minutes
    assert sought or clock.spent > 0.65 * 60 * minutes  # more than its share if changes are tried
    assert one.capacity.team.robots >= 64


def test_if_time_is_short_it_says_what_is_missing() -> None:
    clock = Slow(0.01, driver({"ours": peaked(30.0)}, 0.01, seconds=lambda robots: robots / 1000))
    one = capacity(TrialRuns(plan_of(HALL, episodes=None), clock.drive, clock))
    assert one.stopped
    assert one.goals.episodes >= 3


@pytest.mark.parametrize("salt", range(3))
def test_the_fewest_that_make_so_many_goals(salt: int) -> None:
    curve = peaked(60.0)
    plan = plan_of(HALL, wanted=3000.0, episodes=12)
    study = TrialRuns(plan, driver({"ours": curve}, 0.03, salt=salt), TimeBudget(None))
    one = robots_needed(study, capacity(study), 1.0)
    fewest = next(robots for robots in range(60) if curve(robots) >= 3000.0)
    assert one.robots is not None
    assert fewest <= one.robots <= 1.25 * fewest
    assert one.goals.low >= 3000.0


def test_goals_that_a_floor_cannot_make_are_called_so() -> None:
    study = TrialRuns(plan_of(HALL, wanted=5000.0), driver({"ours": peaked(30.0)}, 0.02), TimeBudget(None))
    one = robots_needed(study, capacity(study), 1.0)  # the most is 200 * 30 / e = 2,207
    assert (one.robots, one.possible) == (None, False)


def run(marks: dict[str, Sequence[float]], last: int = 99) -> dict[str, list[float]]:
    """Race four rounds; last: the round before which there is no more time."""
    return race(
        marks, lambda left, number: [marks[arm][number] for arm in left], 4, lambda left, n: len(left) > 1 and n < last
    )


def test_arms_that_are_significantly_worse_are_dropped_after_three_rounds() -> None:
    raced = run({"best": [9, 10, 11, 10], "near": [8, 11, 10, 10], "far": [1, 2, 3, 2]})
    assert {arm: len(values) for arm, values in raced.items()} == {"best": 4, "near": 4}
    assert best_of(raced) == "best"
    assert run({"best": [9, 10, 11, 10], "far": [1, 2, 3, 2]}) == {"best": [9, 10, 11]}
    assert list(run({"best": [9, 9], "far": [1, 1]}, last=2)) == ["best", "far"]  # of two rounds nothing is told
    assert run({"best": [9, 9], "far": [1, 1]}, last=0) == {"best": [], "far": []}
