"""Gaps of rectangles, against polygons and by hand: apart, a corner inside, right through each other."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.simulation.reference import polygon_distance, rectangle, separation
from train.evaluation.audit.bodies import Outline, gap, point_gap

SIDES = st.floats(0.05, 1.0)
ANGLES = st.floats(-math.pi, math.pi)
NEAR = st.floats(-1.5, 1.5)


def gap_of(dx: float, dy: float, one: float, other: float, sides: tuple[float, float, float, float]) -> float:
    """The gap of two rectangles at headings `one` and `other` [rad]."""
    first = Outline(0.0, 0.0, math.cos(one), math.sin(one), *sides[:2])
    return gap(first, Outline(dx, dy, math.cos(other), math.sin(other), *sides[2:]))


@given(NEAR, NEAR, ANGLES, ANGLES, st.tuples(SIDES, SIDES, SIDES, SIDES))
def test_gaps_are_those_of_polygons(
    dx: float, dy: float, one: float, other: float, sides: tuple[float, float, float, float]
) -> None:
    a, b = rectangle(0, 0, one, *sides[:2]), rectangle(dx, dy, other, *sides[2:])
    found, between = gap_of(dx, dy, one, other, sides), float(separation(a, b))
    if between > 1e-9:
        assert found == pytest.approx(polygon_distance(a, b), abs=1e-9)
    elif between < -1e-9:
        assert found < 0


@pytest.mark.parametrize(
    ("u", "v", "expected"),
    [(0.5, 0.0, 0.05), (0.0, -0.4, 0.1), (0.48, 0.34, 0.05), (0.44, 0.0, -0.01), (0.0, 0.0, -0.3)],
)
def test_points(u: float, v: float, expected: float) -> None:
    assert point_gap(u, v, 0.45, 0.3) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("dx", "other", "expected"),
    [
        (0.95, 0.0, 0.05),  # one behind the other
        (0.80, 0.0, -0.1),
        (0.80, math.pi / 2, 0.05),  # one across the other's way
        (0.0, math.pi / 2, -0.3),  # a cross: no corner lies in the other, but its middle does
        (0.6, math.pi / 2, -0.15),  # across the end
    ],
)
def test_by_hand(dx: float, other: float, expected: float) -> None:
    assert gap_of(dx, 0.0, 0.0, other, (0.45, 0.3, 0.45, 0.3)) == pytest.approx(expected)
