"""Test joint planning of car-like robots against dense sampling."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from train.central.floor import CarBody, CarFloor, floor_of, off_discs, stays_inside
from train.central.together import plan_together
from train.central.traffic import (
    BEGIN,
    BEND,
    END,
    HEADING,
    PIECE,
    RATE,
    RoutePiece,
    X,
    Y,
    empty_traffic,
    insert,
    meetings,
)
from train.clmapf.instance import body_gap, disc_gap
from warehouse_env.routes.reeds_shepp import rolled

BODY = CarBody(2.0, 1.0, 1.0, 3.0)
COORDINATE = st.floats(-5.0, 5.0)
CURVATURE = st.sampled_from([0.0, 1 / 3, -1 / 3])


def floor(discs: list[tuple[float, float]]) -> CarFloor:
    return floor_of(30.0, 30.0, np.array(discs, float).reshape(-1, 2), 0.8, BODY, 0.01)


def route(*pieces: tuple[float, float, float], start: tuple[float, float, float]) -> np.ndarray:  # type: ignore[type-arg]
    """Return a route of consecutive pieces (rate, curvature, seconds)."""
    rows, pose, t = [], start, 0.0
    for rate, bend, seconds in pieces:
        row = np.empty(PIECE)
        row[[X, Y, HEADING]], row[[BEGIN, END, RATE, BEND]] = pose, (t, t + seconds, rate, bend)
        rows.append(row)
        pose, t = rolled(*pose, rate * seconds, bend), t + seconds
    return np.array(rows)


@settings(max_examples=100, deadline=None)
@given(COORDINATE, COORDINATE, st.floats(-4.0, 4.0), st.floats(-6.0, 6.0), CURVATURE)
def test_disc_clearance_agrees_with_sampling(dx: float, dy: float, heading: float, length: float, bend: float) -> None:
    disc = np.array([15.0 + dx, 15.0 + dy])
    poses = [np.array(rolled(15.0, 15.0, heading, share * length, bend)) for share in np.linspace(0, 1, 200)]
    least = min(disc_gap(pose, disc) for pose in poses)
    free = off_discs(15.0, 15.0, heading, length, bend, floor([tuple(disc)]))
    assert free or least < 0.01 + 6.0 * 1.5 / 200
    assert not free or least > 0.0


@settings(max_examples=100, deadline=None)
@given(st.floats(0.0, 4.0), st.floats(-4.0, 4.0), st.floats(-6.0, 6.0), CURVATURE)
def test_border_check_agrees_with_sampling(y: float, heading: float, length: float, bend: float) -> None:
    least = min(rolled(15.0, y, heading, share * length, bend)[1] for share in np.linspace(0, 1, 400))
    inside = stays_inside(15.0, y, heading, length, bend, floor([]))
    assert inside or least < 6.0 / 400
    assert not inside or least > -1e-6


PIECES = st.lists(st.tuples(st.sampled_from([1.0, -1.0, 0.0]), CURVATURE, st.floats(0.3, 3.0)), min_size=1, max_size=4)


@settings(max_examples=60, deadline=None)
@given(PIECES, PIECES, COORDINATE, COORDINATE, st.floats(-4.0, 4.0))
def test_meetings_agree_with_sampling(own: list, other: list, dx: float, dy: float, turn: float) -> None:  # type: ignore[type-arg]
    """A time slot counts once if sampled footprints overlap in it, and not if they stay clear."""
    ways = route(*own, start=(15.0, 15.0, 0.0)), route(*other, start=(15.0 + dx, 15.0 + dy, turn))
    traffic, plain = empty_traffic(2, 8, 40), floor([])
    insert(traffic, 1, ways[1], len(ways[1]), plain)
    for piece in ways[0]:
        count = meetings(0, RoutePiece(*piece), 100, traffic, plain)
        overlaps, near = set(), set()
        for t in np.linspace(piece[BEGIN], piece[END], 120):
            theirs = next((one for one in ways[1] if t < one[END]), ways[1][-1])
            driven = theirs[RATE] * (min(t, theirs[END]) - theirs[BEGIN])
            gap = body_gap(
                np.array(rolled(*piece[[X, Y, HEADING]], piece[RATE] * (t - piece[BEGIN]), piece[BEND])),
                np.array(rolled(theirs[X], theirs[Y], theirs[HEADING], driven, theirs[BEND])),
            )
            if gap < -1e-9:
                overlaps.add(int(t))
            if gap < 0.012 * math.sqrt(2) + 3.0 * 3.0 / 120:  # the checked gap is at least 0.7 of the true one
                near |= {int(t), int(t + 0.03), int(max(t - 0.03, 0.0))}
        assert len(overlaps - {int(piece[END])}) <= count <= len(near) + 1


def test_single_robot_takes_the_shortest_curve() -> None:
    found = plan_together([(5.0, 15.0, 0.0)], [(25.0, 15.0, 0.0)], floor([]))
    assert found.routes[0].tolist() == [[0.0, 5.0, 15.0, 0.0, 1.0, 0.0, 20.0]]


def test_two_robots_swap_places() -> None:
    poses = [(5.0, 15.0, 0.0), (25.0, 15.0, math.pi)]
    goals = [(25.0, 15.0, 0.0), (5.0, 15.0, math.pi)]
    found = plan_together(poses, goals, floor([]), seed=1)
    assert found.meeting == 0
    assert not found.stranded
    assert sum(way[-1, END] for way in found.routes) < 44.0  # 20 each plus a short detour


def test_goal_is_reached_through_a_gate() -> None:
    """Discs close both sides and the front of the goal, so only one lane leads there."""
    discs = [(15.0 + dx, 15.0 + side * 1.9) for dx in (-5.0, -3.0, -1.0, 1.0) for side in (-1, 1)] + [(17.9, 15.0)]
    found = plan_together([(5.0, 5.0, 1.57)], [(15.0, 15.0, 0.0)], floor(discs))
    assert not found.stranded
    end = found.routes[0][-1]
    assert rolled(*end[[X, Y, HEADING]], end[RATE] * (end[END] - end[BEGIN]), end[BEND])[:2] == pytest.approx((15, 15))


def test_enclosed_robot_is_named() -> None:
    ring = [(15.5 + 3.2 * math.cos(a), 15.0 + 3.0 * math.sin(a)) for a in np.linspace(0, 2 * math.pi, 24)]
    found = plan_together([(15.0, 15.0, 0.0)], [(25.0, 15.0, 0.0)], floor(ring))
    assert found.stranded == [0]
    assert found.routes == []
