"""From pose to pose: times of curves worked out by hand, the rows of a few pairs, and the table."""

from __future__ import annotations

import math

import pytest

from train.benchmarks import poses
from train.benchmarks.poses import curve_seconds
from warehouse_env.config import RobotSpec
from warehouse_env.maps.layouts import make_layout

ROBOT = RobotSpec()  # 1.5 m/s ahead, 0.5 m/s back, 1 m/s^2
RADIUS = ROBOT.wheelbase / math.tan(ROBOT.max_steering)


def test_the_soonest_curve_by_hand() -> None:
    # 3 m ahead: 1.5 s up, 1.5 s down, 0.75 m at 1.5 m/s; nothing to steer
    assert curve_seconds((0.0, 0.0, 0.0), (3.0, 0.0, 0.0), ROBOT) == pytest.approx((3.5, 3.5))
    # 1 m back: 0.5 s up and down, 0.75 m at 0.5 m/s
    assert curve_seconds((0.0, 0.0, 0.0), (-1.0, 0.0, 0.0), ROBOT) == pytest.approx((2.5, 2.5))
    # a quarter of a circle at full lock, shorter than what it takes to reach 1.5 m/s; the lock takes 60 degrees
    way = math.pi / 2 * RADIUS
    seconds = 2 * math.sqrt(way)
    steered, free = curve_seconds((0.0, 0.0, 0.0), (RADIUS, RADIUS, math.pi / 2), ROBOT)
    assert free == pytest.approx(seconds)
    assert steered == pytest.approx(seconds + ROBOT.max_steering / ROBOT.max_steering_rate)


def test_pairs_of_poses_are_driven() -> None:
    row = poses.drive(make_layout("narrow"), 12, 31_000_000)
    assert row["pairs"] == row["arrived"] == 12
    assert row["drawn"] >= 24
    assert row["most_off_m"] <= 0.05
    assert row["most_turned_deg"] <= 5.0
    assert 0.5 < row["over_curve"] < row["over_free_steering"]
