"""Test peak, jam and knee by hand and on known noisy curves, and the fewest robots for a goal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from tests.train.advice.floors import Curve, Slow, driver, floor_of, plan_of
from train.advice.answer import advise
from train.advice.capacity import Capacity, capacity, robots_needed
from train.advice.curve import LoadPoint, bracket, fewest_that, jams_from, knee, loads, peak, rungs, smallest
from train.advice.study import TrialRuns, best_of, race
from train.advice.trials import TimeBudget, Trial
from train.reporting.rows import Interval, mean_interval

NAN = math.nan


def driven(late: float, stuck: float = 0.0) -> dict[str, Any]:
    return {"late_goals_per_robot_hour": late, "stuck": stuck, "waiting_share": 0.1}


def load_point(robots: int, goals: float, half: float = 0.0, jammed: bool = False) -> LoadPoint:
    """Return a load point of four episodes with half width `half`."""
    none = Interval(NAN, NAN, NAN, 0)
    return LoadPoint(robots, 4, Interval(goals, goals - half, goals + half, 4), none, none, none, jammed)


def test_floor_jams_if_robots_stick_or_total_goals_fall() -> None:
    found = loads({16: [driven(100.0), driven(110.0)], 8: [driven(120.0)], 32: [driven(40.0)], 24: [driven(90, 0.06)]})
    assert [(load.robots, load.goals.mean, load.jammed) for load in found] == [
        (8, 960.0, False), (16, 1680.0, False), (24, 2160.0, True), (32, 1280.0, True),
    ]  # fmt: skip
    assert found[1].goals.high == pytest.approx(1680 + 16 * 12.7062 * 5)  # t of one degree, deviation 7.07 / sqrt(2)
    assert peak(found).robots == 16  # 24 reach more goals but jam
    assert peak(found[2:]).robots == 24
    first = jams_from(found)
    assert first is not None
    assert first.robots == 24
    assert jams_from([load_point(8, 1.0, jammed=True), load_point(16, 2.0)]) is None


def test_rungs_of_robot_numbers() -> None:
    assert rungs(1, 24) == [1, 2, 3, 4, 6, 8, 12, 16, 24]
    assert rungs(16, 20) == [16, 20]
    assert rungs(5, 5) == [5]


def test_smallest_near_optimal_number_is_named() -> None:
    assert smallest({16: 4000.0, 24: 4900.0, 32: 5000.0}) == 24


def test_knee_by_hand() -> None:
    # Each robot adds 100 goals up to 10 robots, 60 up to 20, and 20 up to 30. The slope of 50 lies between the centres
    # 15 and 25, a quarter of the way.
    found = [load_point(10, 1000.0), load_point(20, 1600.0), load_point(30, 1800.0)]
    alone = Interval(100.0, 100.0, 100.0, 9)
    assert knee(found, alone, 0) == pytest.approx((17.5, 17.5, 17.5, 4))
    assert knee(found[:2], alone, 0) is None
    assert knee([], alone, 0) is None


def test_interval_of_an_uncertain_knee_is_open() -> None:
    at = knee([load_point(10, 1000.0), load_point(20, 1450.0, half=300.0)], Interval(100.0, 99.0, 101.0, 9), 0)
    assert at is not None
    assert at.high == math.inf
    assert 5.0 < at.low < at.mean < 20.0


def test_knee_intervals_cover_the_truth() -> None:
    """Goals a n (1 - n / 2m) have half of their initial slope at n = m / 2; noise is 3%, as on real floors."""
    true, numbers = 32.0, [8, 16, 24, 32, 48, 64]
    hits, points = 0, []
    for seed in range(20):
        rng = np.random.default_rng(seed)

        def seen(robots: float, rng: np.random.Generator = rng) -> Interval:
            goals = 200.0 * robots * (1 - robots / 128)
            return mean_interval((goals * (1 + 0.03 * rng.standard_normal(6))).tolist())

        found = [load_point(robots, 0.0)._replace(goals=seen(robots)) for robots in numbers]
        at = knee(found, seen(1), seed)
        assert at is not None
        hits += at.low <= true <= at.high
        points.append(at.mean)
    assert hits >= 17
    assert np.mean(points) == pytest.approx(true, rel=0.05)


def test_fewest_robots_by_bisection() -> None:
    tried: list[int] = []

    def reaches(robots: int) -> bool:
        tried.append(robots)
        return robots >= 21

    assert fewest_that(reaches, 0, 32) == 21
    assert tried == [16, 24, 20, 22, 21]
    assert fewest_that(lambda robots: robots >= 700, 512, 1024) == 704  # within a sixteenth


def test_bracket_of_sufficient_numbers() -> None:
    found = [
        load_point(8, 800.0, 10.0),
        load_point(16, 1500.0, 200.0),
        load_point(32, 2200.0, 50.0),
        load_point(64, 2100.0, 50.0),
    ]
    assert bracket(found, 500.0) == (0, 8)
    assert bracket(found, 1400.0) == (8, 32)  # 16 may reach it
    assert bracket(found, 2190.0) == (16, 32)
    assert bracket(found, 2300.0) is None


HALL = floor_of(*["." * 48] * 48)  # 2,304 cells


def peaked(at: float, each: float = 200.0) -> Curve:
    """Return a curve with initial slope `each`, a peak at `at`, and a slow fall beyond."""
    return lambda robots: each * robots * math.exp(-robots / at)


def plateau(robots: float) -> float:
    """Rise to 4,000 goals at 20 robots, then stay level."""
    return 200.0 * min(robots, 20.0)


def collapse(robots: float) -> float:
    """Rise to 8,000 goals at 40 robots, then drop to 500."""
    return 200.0 * robots if robots <= 40 else 500.0


def found(curve: Curve, noise: float = 0.0, salt: int = 0, **changes: object) -> Capacity:
    plan = plan_of(HALL, **changes)
    return capacity(TrialRuns(plan, driver({"ours": curve}, noise, salt=salt), TimeBudget(None)))


@pytest.mark.parametrize("salt", range(3))
@pytest.mark.parametrize("at", [7.0, 30.0, 200.0])
def test_known_peak_is_found_in_noise(at: float, salt: int) -> None:
    curve = peaked(at)
    one = found(curve, 0.03, salt)
    assert curve(one.team.robots) >= 0.93 * curve(at)
    assert one.team.robots <= 2 * at
    assert one.goals.goals.mean == pytest.approx(curve(one.team.robots), rel=0.05)


def test_start_of_a_plateau_is_named() -> None:
    one = found(plateau)
    assert one.team.robots == 24  # the smallest tried number with the most goals
    assert one.knee is not None
    assert 16 < one.knee.mean < 24
    assert one.jam is None


def test_peak_lies_before_a_collapse() -> None:
    one = found(collapse)
    assert one.team.robots == 32
    assert one.jam is not None
    assert one.jam.robots == 48
    assert one.jam.episodes == 6


@pytest.mark.parametrize("salt", range(3))
def test_best_policy_is_chosen_and_measured_again(salt: int) -> None:
    curves = {"ours": peaked(30.0), "better": peaked(30.0, 230.0), "worse": peaked(30.0, 150.0)}
    plan = plan_of(HALL, policies=tuple(curves))
    one = capacity(TrialRuns(plan, driver(curves, 0.03, salt=salt), TimeBudget(None)))
    assert one.team.policy == "better"
    assert one.alone.mean == pytest.approx(230.0, rel=0.1)


def test_answer_is_measured_on_fresh_seeds() -> None:
    lucky = driver({"ours": peaked(30.0)})

    def drive(trials: Sequence[Trial]) -> list[dict[str, Any]]:
        """Triple the goals on seeds of the choice."""
        rows = lucky(trials)
        for row in rows:
            row["late_goals_per_robot_hour"] *= 3 if row["seed"] < 1_000 else 1
        return rows

    one = capacity(TrialRuns(plan_of(HALL), drive, TimeBudget(None)))
    assert one.goals.goals.mean == pytest.approx(peaked(30.0)(one.team.robots))


def test_floor_where_all_robots_stick_jams_at_one() -> None:
    one = capacity(
        TrialRuns(plan_of(HALL), driver({"ours": peaked(160.0)}, stuck=lambda robots: 1.0), TimeBudget(None))
    )
    assert one.goals.jammed
    assert one.jam is not None
    assert one.jam.robots == 1


def test_peak_of_a_large_floor_is_found_in_little_time() -> None:
    """An episode takes 1 ms per robot; the peak is at 512 robots."""
    clock = Slow(0.6, driver({"ours": peaked(512.0)}, 0.01, seconds=lambda robots: robots / 1000))
    one = capacity(TrialRuns(plan_of(floor_of(*["." * 180] * 180), episodes=None, most=2048), clock.drive, clock))
    assert one.team.robots in (384, 512)
    assert one.knee is not None
    assert 100 < one.knee.mean < 250
    assert clock.spent <= 60 * 0.6


@pytest.mark.parametrize(("minutes", "sought"), [(0.1, False), (30.0, True)])
def test_time_budget_is_kept_and_used(minutes: float, sought: bool) -> None:
    clock = Slow(minutes, driver({"ours": peaked(250.0)}, 0.01, seconds=lambda robots: robots / 1000))
    one = advise(plan_of(HALL, episodes=None), clock.drive, clock)
    assert one.sought == sought
    assert clock.spent <= 60 * minutes
    assert sought or clock.spent > 0.65 * 60 * minutes  # without changes, capacity uses more of the time
    assert one.capacity.team.robots >= 64


def test_short_time_budget_states_what_is_missing() -> None:
    clock = Slow(0.01, driver({"ours": peaked(30.0)}, 0.01, seconds=lambda robots: robots / 1000))
    one = capacity(TrialRuns(plan_of(HALL, episodes=None), clock.drive, clock))
    assert one.stopped
    assert one.goals.episodes >= 3


@pytest.mark.parametrize("salt", range(3))
def test_fewest_robots_for_the_wanted_goals(salt: int) -> None:
    curve = peaked(60.0)
    plan = plan_of(HALL, wanted=3000.0, episodes=12)
    study = TrialRuns(plan, driver({"ours": curve}, 0.03, salt=salt), TimeBudget(None))
    one = robots_needed(study, capacity(study), 1.0)
    fewest = next(robots for robots in range(60) if curve(robots) >= 3000.0)
    assert one.robots is not None
    assert fewest <= one.robots <= 1.25 * fewest
    assert one.goals.low >= 3000.0


def test_unreachable_goals_are_reported_as_impossible() -> None:
    study = TrialRuns(plan_of(HALL, wanted=5000.0), driver({"ours": peaked(30.0)}, 0.02), TimeBudget(None))
    one = robots_needed(study, capacity(study), 1.0)  # the maximum is 200 * 30 / e = 2,207
    assert (one.robots, one.possible) == (None, False)


def run(marks: dict[str, Sequence[float]], last: int = 99) -> dict[str, list[float]]:
    """Race four rounds; time runs out before round `last`."""
    return race(
        marks, lambda left, number: [marks[arm][number] for arm in left], 4, lambda left, n: len(left) > 1 and n < last
    )


def test_arms_that_are_significantly_worse_are_dropped_after_three_rounds() -> None:
    raced = run({"best": [9, 10, 11, 10], "near": [8, 11, 10, 10], "far": [1, 2, 3, 2]})
    assert {arm: len(values) for arm, values in raced.items()} == {"best": 4, "near": 4}
    assert best_of(raced) == "best"
    assert run({"best": [9, 10, 11, 10], "far": [1, 2, 3, 2]}) == {"best": [9, 10, 11]}
    assert list(run({"best": [9, 9], "far": [1, 1]}, last=2)) == ["best", "far"]  # two rounds decide nothing
    assert run({"best": [9, 9], "far": [1, 1]}, last=0) == {"best": [], "far": []}
