"""Central planners: PIBT on cells against an independent checker, car-like robots against sampling."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from train.central import CENTRAL, central_config
from train.central.car_like.floor import CarBody, CarFloor, floor_of, off_discs, stays_inside
from train.central.car_like.together import Effort, plan_together
from train.central.car_like.traffic import (
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
from train.central.grid_pibt import BACKWARDS, cost_to_go, pibt_step
from train.central.orders import CentralOrders, advance, append, forget_future
from train.central.pibt import rounded
from train.clmapf.instance import body_gap, disc_gap
from train.evaluation.rollout import make_experiment, run
from warehouse_env.config import EnvConfig
from warehouse_env.routes.reeds_shepp import rolled
from warehouse_env.simulation.simulator import Simulator

STEPS = {0: (0, 1), 1: (-1, 0), 2: (0, -1), 3: (1, 0)}


def check_step(
    blocked: NDArray[np.bool_], cell: list[int], heading: list[int], chosen: list[int], moves: list[int]
) -> None:
    """Raise unless robots can make their moves, and no two meet on a cell, on an edge or in a ring."""
    columns = blocked.shape[1]
    assert len(set(chosen)) == len(chosen), "two robots in a cell"
    where = {at: i for i, at in enumerate(cell)}
    for i, (old, new, move) in enumerate(zip(cell, chosen, moves, strict=True)):
        assert not blocked[new // columns, new % columns]
        if old == new:
            assert move == heading[i]
            continue
        way = move if move < BACKWARDS else (move - BACKWARDS + 2) % 4
        assert move >= BACKWARDS or (move - heading[i]) % 4 != 2, "turned round at once"
        assert move < BACKWARDS or move - BACKWARDS == heading[i], "backed with another heading"
        assert (new // columns - old // columns, new % columns - old % columns) == STEPS[way]
        chain = [i]
        while (j := where.get(chosen[chain[-1]])) is not None and chosen[j] != cell[j]:
            assert j not in chain, "a swap or a ring"
            chain.append(j)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000))
def test_no_step_breaks_a_rule(seed: int) -> None:
    rng = np.random.default_rng(seed)
    blocked = rng.random((6, 7)) < 0.25
    free = np.flatnonzero(~blocked)
    robots = int(rng.integers(1, max(2, len(free) - 1)))
    cell, heading = rng.permutation(free)[:robots].astype(np.int64), rng.integers(0, 4, robots)
    held, tail = rng.random(robots) < 0.1, np.full(robots, -1)
    costs = np.stack([cost_to_go(blocked, int(goal)) for goal in rng.choice(free, robots)])
    for _ in range(8):
        noise = rng.uniform(0.0, 0.4, (robots, 5))
        chosen, moves = pibt_step(cell, heading, costs, rng.permutation(robots), held, tail, noise, blocked)
        check_step(blocked, cell.tolist(), heading.tolist(), chosen.tolist(), moves.tolist())
        assert (chosen[held] == cell[held]).all()
        cell, heading = chosen, moves % BACKWARDS


def test_the_first_in_order_goes_and_the_other_makes_room() -> None:
    """Head on at the end of an aisle of one cell with a bay: the first drives on, the second goes into the bay."""
    blocked = np.array([[1, 1, 0], [0, 0, 0]], np.bool_)
    costs = np.stack([cost_to_go(blocked, 5), cost_to_go(blocked, 3)])
    cell, heading = np.array([4, 5]), np.array([0, 2])  # nose to nose, the second below the bay
    noise, held, tail = np.zeros((2, 5)), np.zeros(2, np.bool_), np.full(2, -1)
    chosen, moves = pibt_step(cell, heading, costs, np.array([0, 1]), held, tail, noise, blocked)
    assert chosen.tolist() == [5, 2]
    assert moves.tolist() == [0, 1]


def test_a_cell_is_entered_only_when_the_one_before_has_left() -> None:
    """Two robots in a row of cells: the second's visit of a cell is granted when the first's body is out of it."""
    centre = np.stack([np.arange(6) + 0.5, np.full(6, 0.5)], axis=-1)
    orders = CentralOrders.of(np.array([1, 0]), np.array([0, 0]), 6)
    append(orders, np.array([2, 1]), np.array([0, 0]), np.array([True, True]))
    append(orders, np.array([3, 2]), np.array([0, 0]), np.array([True, True]))
    body, heading = np.array([0.45, 0.3, 0.3]), np.zeros(2)
    axle = np.array([[1.5, 0.5], [0.5, 0.5]])
    advance(orders, axle, heading, centre, body, 5)
    assert orders.granted.tolist() == [2, 0]
    axle[0, 0] = 2.6  # its tail at 1.85
    advance(orders, axle, heading, centre, body, 5)
    assert orders.granted.tolist() == [2, 0]
    axle[0, 0] = 2.7  # at 1.95: out of cell 1 but for less than the slack
    advance(orders, axle, heading, centre, body, 5)
    assert orders.granted.tolist() == [2, 1]
    forget_future(orders)
    assert orders.end.tolist() == [3, 2]
    assert orders.planned.tolist() == [1, 1, 1, 1, 0, 0]


@pytest.mark.parametrize("name", list(CENTRAL))
def test_a_central_planner_drives_to_goals_and_makes_rows(name: str) -> None:
    base = EnvConfig(layout="open", num_agents=4, planner="astar")
    experiments = [make_experiment(name, base, episodes, 40.0, seed=3) for episodes in (1, 2)]
    assert experiments[0].config == central_config(base).replace(max_steps=200)
    alone, beside = (run(experiment) for experiment in experiments)
    assert alone[0]["policy"] == name
    assert alone[0]["goals"] > 0
    assert {k: v for k, v in alone[0].items() if k != "ms_per_step"} == {
        k: v for k, v in beside[0].items() if k != "ms_per_step"
    }


@pytest.mark.parametrize("name", list(CENTRAL))
def test_a_reset_begins_a_new_plan(name: str) -> None:
    config = central_config(EnvConfig(layout="open", num_agents=3, planner="astar"))
    simulator, planner, ways = Simulator(config), CENTRAL[name].make(config), []
    for _ in range(2):
        simulator.reset(5)
        generators = [np.random.default_rng(1)]
        for _ in range(20):
            simulator.step(planner.act_on(simulator, generators))
        ways.append(simulator.state.pose.copy())
    assert np.array_equal(ways[0], ways[1])


def test_corners_become_arcs() -> None:
    quarter = rounded(np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)]))
    arc = quarter[1:-1]
    np.testing.assert_allclose(np.hypot(*(arc - [0.5, 0.5]).T), 0.5, atol=1e-12)
    np.testing.assert_allclose(arc[[0, -1]], [(0.5, 0.0), (1.0, 0.5)], atol=1e-12)
    eighth = rounded(np.array([(0.0, 0.0), (1.0, 0.0), (2.0, 1.0)]))
    radius = np.hypot(*(eighth[1:-1] - [0.5, 0.5 / math.tan(math.pi / 8)]).T)
    assert radius == pytest.approx(0.5 / math.tan(math.pi / 8))
    straight = np.array([(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)])
    np.testing.assert_array_equal(rounded(straight), straight[[0, 2]])


BODY = CarBody(2.0, 1.0, 1.0, 3.0)
COORDINATE = st.floats(-5.0, 5.0)
CURVATURE = st.sampled_from([0.0, 1 / 3, -1 / 3])


def floor(discs: list[tuple[float, float]]) -> CarFloor:
    return floor_of(30.0, 30.0, np.array(discs, float).reshape(-1, 2), 0.8, BODY, 0.01)


def route(*pieces: tuple[float, float, float], start: tuple[float, float, float]) -> np.ndarray:  # type: ignore[type-arg]
    """Pieces of (rate, curvature, seconds), one after the other."""
    rows, pose, t = [], start, 0.0
    for rate, bend, seconds in pieces:
        row = np.empty(PIECE)
        row[[X, Y, HEADING]], row[[BEGIN, END, RATE, BEND]] = pose, (t, t + seconds, rate, bend)
        rows.append(row)
        pose, t = rolled(*pose, rate * seconds, bend), t + seconds
    return np.array(rows)


@settings(max_examples=100, deadline=None)
@given(COORDINATE, COORDINATE, st.floats(-4.0, 4.0), st.floats(-6.0, 6.0), CURVATURE)
def test_discs_are_kept_off_as_sampling_says(dx: float, dy: float, heading: float, length: float, bend: float) -> None:
    disc = np.array([15.0 + dx, 15.0 + dy])
    poses = [np.array(rolled(15.0, 15.0, heading, share * length, bend)) for share in np.linspace(0, 1, 200)]
    least = min(disc_gap(pose, disc) for pose in poses)
    free = off_discs(15.0, 15.0, heading, length, bend, floor([tuple(disc)]))
    assert free or least < 0.01 + 6.0 * 1.5 / 200
    assert not free or least > 0.0


@settings(max_examples=100, deadline=None)
@given(st.floats(0.0, 4.0), st.floats(-4.0, 4.0), st.floats(-6.0, 6.0), CURVATURE)
def test_the_border_is_kept_as_sampling_says(y: float, heading: float, length: float, bend: float) -> None:
    least = min(rolled(15.0, y, heading, share * length, bend)[1] for share in np.linspace(0, 1, 400))
    inside = stays_inside(15.0, y, heading, length, bend, floor([]))
    assert inside or least < 6.0 / 400
    assert not inside or least > -1e-6


PIECES = st.lists(st.tuples(st.sampled_from([1.0, -1.0, 0.0]), CURVATURE, st.floats(0.3, 3.0)), min_size=1, max_size=4)


@settings(max_examples=60, deadline=None)
@given(PIECES, PIECES, COORDINATE, COORDINATE, st.floats(-4.0, 4.0))
def test_meetings_are_those_that_sampling_sees(own: list, other: list, dx: float, dy: float, turn: float) -> None:  # type: ignore[type-arg]
    """Each slot in which sampled bodies overlap counts once; one whose bodies stay clear does not."""
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
            if (
                gap < 0.012 * math.sqrt(2) + 3.0 * 3.0 / 120
            ):  # the gap that is looked at is at least 0.7 of the true one
                near |= {int(t), int(t + 0.03), int(max(t - 0.03, 0.0))}
        assert len(overlaps - {int(piece[END])}) <= count <= len(near) + 1


def test_a_robot_alone_takes_the_shortest_curve() -> None:
    found = plan_together([(5.0, 15.0, 0.0)], [(25.0, 15.0, 0.0)], floor([]))
    assert found.routes[0].tolist() == [[0.0, 5.0, 15.0, 0.0, 1.0, 0.0, 20.0]]


def test_two_that_change_places_go_round_each_other() -> None:
    poses = [(5.0, 15.0, 0.0), (25.0, 15.0, math.pi)]
    goals = [(25.0, 15.0, 0.0), (5.0, 15.0, math.pi)]
    found = plan_together(poses, goals, floor([]), seed=1)
    assert found.meeting == 0
    assert not found.stranded
    assert sum(way[-1, END] for way in found.routes) < 44.0  # 20 each, and a little round each other


def test_a_goal_that_is_reached_through_a_gate() -> None:
    """Discs close on both sides and ahead of the goal: only its lane leads there."""
    discs = [(15.0 + dx, 15.0 + side * 1.9) for dx in (-5.0, -3.0, -1.0, 1.0) for side in (-1, 1)] + [(17.9, 15.0)]
    found = plan_together([(5.0, 5.0, 1.57)], [(15.0, 15.0, 0.0)], floor(discs))
    assert not found.stranded
    end = found.routes[0][-1]
    assert rolled(*end[[X, Y, HEADING]], end[RATE] * (end[END] - end[BEGIN]), end[BEND])[:2] == pytest.approx((15, 15))


def test_a_robot_shut_in_is_named() -> None:
    ring = [(15.5 + 3.2 * math.cos(a), 15.0 + 3.0 * math.sin(a)) for a in np.linspace(0, 2 * math.pi, 24)]
    found = plan_together([(15.0, 15.0, 0.0)], [(25.0, 15.0, 0.0)], floor(ring), effort=Effort(search=50))
    assert found.stranded == [0]
    assert found.routes == []
