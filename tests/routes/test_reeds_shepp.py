"""Reeds-Shepp curves: known lengths, every word drives to its goal, and no way of many short arcs is shorter."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from warehouse_env.routes.reeds_shepp import SEGMENTS, TURNS, WORDS, distance, rolled, seen_from, word, wrapped

PLACE = st.floats(-12.0, 12.0)
HEADING = st.floats(-7.0, 7.0)
RADIUS = st.floats(0.3, 5.0)
POSE = st.tuples(PLACE, PLACE, HEADING)


def end_of(lengths: tuple[float, ...], n: int, radius: float) -> tuple[float, float, float]:
    pose = (0.0, 0.0, 0.0)
    for k in range(SEGMENTS):
        pose = rolled(*pose, lengths[k], TURNS[n, k] / radius)
    return pose


@pytest.mark.parametrize(
    ("goal", "length"),
    [
        ((5.0, 0.0, 0.0), 5.0),
        ((-5.0, 0.0, 0.0), 5.0),
        ((1.0, 1.0, math.pi / 2), math.pi / 2),  # a quarter of a circle to the left
        ((-1.0, 1.0, -math.pi / 2), math.pi / 2),  # the same in reverse
        ((0.0, 2.0, math.pi), math.pi),
        ((0.0, 0.0, math.pi), math.pi),  # three arcs of a third of pi each: a turn on the spot
        ((0.0, 0.0, 0.0), 0.0),
        ((11.0, 1.0, math.pi / 2), 10.0 + math.pi / 2),
    ],
)
def test_known_lengths(goal: tuple[float, float, float], length: float) -> None:
    assert distance(*goal, 1.0) == pytest.approx(length, abs=1e-9)
    assert distance(3.0 * goal[0], 3.0 * goal[1], goal[2], 3.0) == pytest.approx(3.0 * length, abs=1e-8)


@given(PLACE, PLACE, HEADING, RADIUS)
def test_every_word_leads_to_its_goal(ahead: float, left: float, turn: float, radius: float) -> None:
    lengths = []
    for n in range(WORDS):
        length, *parts = word(n, ahead, left, turn, radius)
        if math.isfinite(length):
            x, y, heading = end_of(tuple(parts), n, radius)
            assert (x, y) == (pytest.approx(ahead, abs=1e-5), pytest.approx(left, abs=1e-5))
            assert wrapped(heading - turn) == pytest.approx(0.0, abs=1e-5)
            assert length == pytest.approx(sum(map(abs, parts)))
            lengths.append(length)
    assert min(lengths) == distance(ahead, left, turn, radius)


@given(POSE, POSE, RADIUS)
def test_it_is_a_metric_that_no_mirror_and_no_reversal_changes(
    a: tuple[float, float, float], b: tuple[float, float, float], radius: float
) -> None:
    there = distance(*seen_from(*a, *b), radius)
    assert there == pytest.approx(distance(*seen_from(*b, *a), radius), abs=1e-5)
    ahead, left, turn = seen_from(*a, *b)
    assert there == pytest.approx(distance(ahead, -left, -turn, radius), abs=1e-5)
    assert there == pytest.approx(distance(-ahead, left, -turn, radius), abs=1e-5)
    assert there >= math.hypot(ahead, left) - 1e-9
    assert there >= radius * abs(wrapped(turn)) - 1e-6
