"""The peak, jam and knee of a curve of goals over robots, by hand and on known curves."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from train.advice.curve import LoadPoint, bracket, fewest_that, jams_from, knee, loads, peak, rungs, smallest
from train.reporting.rows import Interval, mean_interval

NAN = math.nan


def driven(late: float, stuck: float = 0.0) -> dict[str, Any]:
    return {"late_goals_per_robot_hour": late, "stuck": stuck, "waiting_share": 0.1}


def made(robots: int, goals: float, half: float = 0.0, jammed: bool = False) -> LoadPoint:
    """Return a load with an interval of so much to both sides, of four episodes."""
    none = Interval(NAN, NAN, NAN, 0)
    return LoadPoint(robots, 4, Interval(goals, goals - half, goals + half, 4), none, none, none, jammed)


def test_a_floor_jams_where_robots_are_stuck_or_all_together_do_less() -> None:
    found = loads({16: [driven(100.0), driven(110.0)], 8: [driven(120.0)], 32: [driven(40.0)], 24: [driven(90, 0.06)]})
    assert [(load.robots, load.goals.mean, load.jammed) for load in found] == [
        (8, 960.0, False), (16, 1680.0, False), (24, 2160.0, True), (32, 1280.0, True),
    ]  # fmt: skip
    assert found[1].goals.high == pytest.approx(1680 + 16 * 12.7062 * 5)  # t of one degree, deviation 7.07 / sqrt(2)
    assert peak(found).robots == 16  # 24 make more, but jam
    assert peak(found[2:]).robots == 24
    first = jams_from(found)
    assert first is not None
    assert first.robots == 24
    assert jams_from([made(8, 1.0, jammed=True), made(16, 2.0)]) is None


def test_numbers_to_try() -> None:
    assert rungs(1, 24) == [1, 2, 3, 4, 6, 8, 12, 16, 24]
    assert rungs(16, 20) == [16, 20]
    assert rungs(5, 5) == [5]


def test_the_smaller_of_two_that_cannot_be_told_apart_is_named() -> None:
    assert smallest({16: 4000.0, 24: 4900.0, 32: 5000.0}) == 24


def test_the_knee_by_hand() -> None:
    # From 0 to 10 robots each brings 100, from 10 to 20 it is 60, from 20 to 30 it is 20; half of 100 lies between the
    # middles 15 and 25, a quarter of the way.
    found = [made(10, 1000.0), made(20, 1600.0), made(30, 1800.0)]
    alone = Interval(100.0, 100.0, 100.0, 9)
    assert knee(found, alone, 0) == pytest.approx((17.5, 17.5, 17.5, 4))
    assert knee(found[:2], alone, 0) is None
    assert knee([], alone, 0) is None


def test_an_interval_of_a_knee_that_may_not_be_reached_is_open() -> None:
    at = knee([made(10, 1000.0), made(20, 1450.0, half=300.0)], Interval(100.0, 99.0, 101.0, 9), 0)
    assert at is not None
    assert at.high == math.inf
    assert 5.0 < at.low < at.mean < 20.0


def test_intervals_of_the_knee_hold_its_truth() -> None:
    """Goals a n (1 - n / 2m) have half of their first slope where n = m / 2; noise of 3% as on real floors."""
    true, numbers = 32.0, [8, 16, 24, 32, 48, 64]
    hits, points = 0, []
    for seed in range(20):
        rng = np.random.default_rng(seed)

        def seen(robots: float, rng: np.random.Generator = rng) -> Interval:
            goals = 200.0 * robots * (1 - robots / 128)
            return mean_interval((goals * (1 + 0.03 * rng.standard_normal(6))).tolist())

        found = [made(robots, 0.0)._replace(goals=seen(robots)) for robots in numbers]
        at = knee(found, seen(1), seed)
        assert at is not None
        hits += at.low <= true <= at.high
        points.append(at.mean)
    assert hits >= 17
    assert np.mean(points) == pytest.approx(true, rel=0.05)


def test_the_fewest_by_halves() -> None:
    tried: list[int] = []

    def reaches(robots: int) -> bool:
        tried.append(robots)
        return robots >= 21

    assert fewest_that(reaches, 0, 32) == 21
    assert tried == [16, 24, 20, 22, 21]
    assert fewest_that(lambda robots: robots >= 700, 512, 1024) == 704  # within a sixteenth


def test_between_which_numbers_enough_is_made() -> None:
    found = [made(8, 800.0, 10.0), made(16, 1500.0, 200.0), made(32, 2200.0, 50.0), made(64, 2100.0, 50.0)]
    assert bracket(found, 500.0) == (0, 8)
    assert bracket(found, 1400.0) == (8, 32)  # of 16 it is not sure
    assert bracket(found, 2190.0) == (16, 32)
    assert bracket(found, 2300.0) is None
