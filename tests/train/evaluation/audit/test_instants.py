"""Test footprints and steps of the audit against samples, polygons and hand-made cases."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.simulation.reference import WHEELBASE, bodies, polygon_distance, rectangle, separation
from train.evaluation.audit import instants
from train.evaluation.audit.arcs import STATE
from train.evaluation.audit.bodies import AuditFleet, Outline, gap, point_gap
from train.evaluation.audit.instants import HORIZON, EnvStep, Findings, Obstacles, audit_step
from warehouse_env.config import EnvConfig

SIDES = st.floats(0.05, 1.0)
ANGLES = st.floats(-math.pi, math.pi)
NEAR = st.floats(-1.5, 1.5)


def gap_of(dx: float, dy: float, one: float, other: float, sides: tuple[float, float, float, float]) -> float:
    """Return the gap of two rectangles at headings `one` and `other` [rad]."""
    first = Outline(0.0, 0.0, math.cos(one), math.sin(one), *sides[:2])
    return gap(first, Outline(dx, dy, math.cos(other), math.sin(other), *sides[2:]))


@given(NEAR, NEAR, ANGLES, ANGLES, st.tuples(SIDES, SIDES, SIDES, SIDES))
def test_gaps_equal_polygon_distances(
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
def test_point_gaps_by_hand(u: float, v: float, expected: float) -> None:
    assert point_gap(u, v, 0.45, 0.3) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("dx", "other", "expected"),
    [
        (0.95, 0.0, 0.05),  # one behind the other
        (0.80, 0.0, -0.1),
        (0.80, math.pi / 2, 0.05),  # one across the other's way
        (0.0, math.pi / 2, -0.3),  # a cross: each covers the other's centre, but no corner
        (0.6, math.pi / 2, -0.15),  # across the end
    ],
)
def test_rectangle_gaps_by_hand(dx: float, other: float, expected: float) -> None:
    assert gap_of(dx, 0.0, 0.0, other, (0.45, 0.3, 0.45, 0.3)) == pytest.approx(expected)


Floats = NDArray[np.float64]
State = tuple[float, float, float, float, float]  # x, y [m], heading [rad], speed [m/s], steering [rad]

STEP = 0.1  # [s]
FREE = np.zeros((40, 40), dtype=np.bool_)  # cells of a metre
NO_DISCS = np.zeros((0, 3))
SLACK = 2e-5  # [m] tolerance of rounding


def moved(state: State, speed: float, steer: float, seconds: float = STEP, looks: int = 2) -> list[State]:
    """Return states at `looks` even instants of a physics step of two arcs, by tiny steps, up to its end."""
    x, y, heading, speed_0, steer_0 = state
    tiny = 2000
    share = (np.arange(tiny) + 0.5) / tiny
    distance = (speed_0 + (speed - speed_0) * share) * seconds / tiny
    turn = -np.tan(steer_0 + (steer - steer_0) * np.where(share < 0.5, 0.25, 0.75)) / WHEELBASE * distance
    middle = heading + np.cumsum(turn) - turn / 2
    ways = np.cumsum(distance * np.cos(middle)), np.cumsum(distance * np.sin(middle)), np.cumsum(turn)
    done = np.arange(1, looks + 1) / looks
    at = (done * tiny).astype(int) - 1
    motion = speed_0 + (speed - speed_0) * done, steer_0 + (steer - steer_0) * done
    columns = x + ways[0][at], y + ways[1][at], heading + ways[2][at], *motion
    return list(zip(*(column.tolist() for column in columns), strict=True))


def audited(
    before: Sequence[State], after: Sequence[State], *, put_back: Sequence[bool] = (), people: Floats | None = None,
    walked: Floats | None = None, solid: NDArray[np.bool_] = FREE, discs: Floats = NO_DISCS, repeat: int = 1,
) -> tuple[list[list[float]], float, float]:  # fmt: skip
    """Audit a step; return its faults, the closest approach and the total distance [m]."""
    findings = Findings(np.full(1, HORIZON), np.zeros(1), np.empty((20, instants.FAULT)))
    fleet, nobody = AuditFleet.of(EnvConfig(num_agents=len(before), action_repeat=repeat)), np.empty((1, 0, 2))
    step = EnvStep(
        np.array(before).reshape(1, -1, STATE), np.array(after).reshape(1, -1, STATE),
        np.array([list(put_back) or [False] * len(before)]), nobody if people is None else people,
        nobody if walked is None else walked,
    )  # fmt: skip
    count = audit_step(step, Obstacles(solid, discs, 1.0), fleet, findings)
    return findings.faults[:count].tolist(), float(findings.closest[0]), float(findings.ways[0])


def kinds(faults: list[list[float]]) -> list[int]:
    """Return the kinds of faults."""
    return [int(fault[instants.KIND]) for fault in faults]


def straight(x: float, y: float, heading: float, speed: float) -> tuple[State, State]:
    """Return a robot's states before and after a straight step."""
    before = (x, y, heading, speed, 0.0)
    return before, (x + STEP * speed * math.cos(heading), y + STEP * speed * math.sin(heading), heading, speed, 0.0)


def corner_pass(ahead: float, above: float) -> list[tuple[State, State]]:
    """Return two robots at 1.5 m/s, east and south; the second's front left corner passes the first's rear left one.

    ahead, above: initial offset of the second robot's corner from the first robot's [m].
    """
    return [straight(10.0, 10.0, 0.0, 1.5), straight(8.95 + ahead, 10.45 + above, -math.pi / 2, 1.5)]


def test_corner_overlap_between_samples_is_found() -> None:
    pair = corner_pass(ahead=0.06, above=0.03)
    faults, closest, way = audited(*zip(*pair, strict=True))
    assert kinds(faults) == [instants.ROBOT]
    fault: Any = faults[0]
    assert {fault[instants.FIRST], fault[instants.SECOND]} == {0, 1}
    assert fault[instants.TIME] == pytest.approx(0.02, abs=1e-4)  # 0.03 m at 1.5 m/s
    assert fault[instants.SIZE] == pytest.approx(0.015, abs=1e-4)  # equally deep along both axes
    assert closest == pytest.approx(-0.015, abs=1e-4)
    assert way == pytest.approx(0.3)


def tail_by_a_shelf(deep: float) -> tuple[State, State]:
    """Return states on a tight circle; in mid-step the outer rear corner is `deep` metres beyond x = 20."""
    steer, speed = 1.0, 1.4
    bend = -math.tan(steer) / WHEELBASE
    swept = bend * speed * STEP  # [rad]
    out, back = 0.3 - 1 / bend, 0.75  # the corner's offsets from the circle's centre
    heading = -math.atan2(out, -back) - swept / 2  # half a step before the corner is due east of the circle's centre
    east = 20.0 + deep - math.hypot(out, back)  # the circle's centre
    x, y = east + 1 / bend * math.sin(heading), 20.5 - 1 / bend * math.cos(heading)
    before = (x, y, heading, speed, steer)
    return before, moved(before, speed, steer)[-1]


@pytest.mark.parametrize("deep", [0.004, -0.004])
@pytest.mark.parametrize("pole", [False, True])
def test_tail_swing_into_an_obstacle_is_found(pole: bool, deep: float) -> None:
    solid, discs = FREE.copy(), NO_DISCS
    before, after = tail_by_a_shelf(deep)
    if pole:  # at the tail's farthest point
        tails = [bodies(*np.array(state[:3])) for state in moved(before, before[3], before[4], looks=200)]
        x, y = max((corner for corners in tails for corner in corners), key=lambda corner: corner[0])
        discs = np.array([[x + 0.5 - deep, y, 0.5]])
    else:
        solid[20] = True
    ends = [bodies(*np.array(state[:3])) for state in (before, after)]
    assert max(corners[:, 0].max() for corners in ends) < 20 - 0.005  # clear at both ends
    faults, _, _ = audited([before], [after], solid=solid, discs=discs)
    assert kinds(faults) == ([instants.SHELF] if deep > 0 else [])
    for fault in faults:
        assert fault[instants.SIZE] == pytest.approx(deep, abs=2e-4)
        assert 0 < fault[instants.TIME] < STEP / 2


def test_person_contact_within_a_step_is_found() -> None:
    people, walked = np.array([[[10.0, 10.58]]]), np.array([[[0.0, -1.0]]])  # 0.03 m from a standing robot's side
    faults, _, _ = audited(*zip(straight(10.0, 10.0, 0.0, 0.0), strict=True), people=people, walked=walked)
    assert kinds(faults) == [instants.PERSON]
    assert faults[0][instants.TIME] == pytest.approx(0.03, abs=1e-4)
    assert faults[0][instants.SIZE] == pytest.approx(0.07, abs=1e-4)


def test_jump_is_found() -> None:
    before, (x, y, *rest) = straight(10.0, 10.0, 0.3, 1.0)
    faults, _, _ = audited([before], [(x, y + 0.005, *rest)])  # type: ignore[list-item]
    assert kinds(faults) == [instants.JUMP]
    assert faults[0][instants.SIZE] == pytest.approx(0.005, rel=0.1)


@pytest.mark.parametrize(
    ("first", "last", "expected"),
    [
        ((1.6, 0.0), (1.6, 0.0), {instants.SPEED: 0.1}),
        ((-0.6, 0.0), (-0.5, 0.0), {}),
        ((0.0, 0.0), (0.2, 0.0), {instants.ACCELERATION: 1.0}),
        ((0.5, 1.0), (0.5, 1.1), {instants.STEERING: 1.1 - math.pi / 3}),
        ((0.5, 0.0), (0.5, 0.3), {instants.STEERING_RATE: 1.5}),
        ((1.4, 0.85), (1.5, 1.0), {}),
    ],
)
def test_limits_are_audited(first: tuple[float, float], last: tuple[float, float], expected: dict[int, float]) -> None:
    before = (10.0, 10.0, 0.5, *first)
    faults, _, _ = audited([before], [moved(before, *last)[-1]])
    assert {int(f[instants.KIND]): f[instants.SIZE] for f in faults} == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(("knot", "expected"), [((1.1, 0.15), []), ((1.2, 0.0), [instants.ACCELERATION])])
def test_decision_of_two_physics_steps_is_audited(knot: tuple[float, float], expected: list[int]) -> None:
    before = (10.0, 10.0, 0.5, 1.0, 0.0)
    middle = moved(before, *knot)[-1]
    after = moved(middle, 1.0, 0.1)[-1]
    faults, _, way = audited([before], [after], repeat=2)
    assert kinds(faults) == expected
    assert way == pytest.approx((1.0 + knot[0]) * STEP, abs=2e-5)


SPEEDS, STEERS = st.floats(-0.5, 1.5), st.floats(-0.85, 0.85)
DRIVES = st.tuples(st.floats(-math.pi, math.pi), SPEEDS, STEERS, st.floats(-0.1, 0.1), st.floats(-0.15, 0.15))


@given(DRIVES, DRIVES, st.floats(0.5, 1.3), st.floats(-math.pi, math.pi))
@settings(max_examples=60, deadline=None)
def test_audit_agrees_with_dense_sampling(
    one: tuple[float, ...], two: tuple[float, ...], distance: float, bearing: float
) -> None:
    states = []
    places = ((10.0, 10.0), (10.0 + distance * math.cos(bearing), 10.0 + distance * math.sin(bearing)))
    for (x, y), (heading, speed, steer, faster, further) in zip(places, (one, two), strict=True):
        start = (x, y, heading, speed, steer)
        end = min(max(speed + faster, -0.5), 1.5), steer + further
        states.append([start, *moved(start, *end, looks=100)])
    track = np.array(states)
    a, b = (bodies(*one[:, :3].T) for one in track)
    between = separation(a, b)
    faults, closest, _ = audited([s[0] for s in states], [s[-1] for s in states])
    deep = between < -4 * SLACK
    if deep.any():
        assert kinds(faults) == [instants.ROBOT]
        assert faults[0][instants.TIME] <= int(deep.argmax()) * STEP / 100 + 1e-9
    elif faults:  # between samples: at most the depth of half a millisecond
        assert between.min() < 0.004
    else:
        least = min(polygon_distance(a[k], b[k]) for k in np.argsort(between)[:5])
        assert closest <= max(least, 0.0) + 1.01e-4 or least > HORIZON
        assert closest > least - 0.004 or least > HORIZON
