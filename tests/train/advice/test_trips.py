"""Trips, their traffic, conflicts between routes and bottlenecks, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.train.advice.floors import RACKS
from train.advice.trips import Bottleneck, bottlenecks, draw_trips, plan_trips, traffic
from warehouse_env.maps.layouts import make_layout


def test_trips_go_to_and_fro_between_picks_and_stations() -> None:
    grid = make_layout("single_lane")
    picks, stations = ({tuple(cell) for cell in cells.tolist()} for cells in (grid.picks, grid.stations))
    trips = draw_trips(grid, 1, 50)
    assert len(trips) == 50
    for number, (start, goal) in enumerate(trips):
        assert (start in picks and goal in stations) if number % 2 else (start in stations and goal in picks)
    assert len({start for start, _ in trips[1::2]}) == 25  # picks come again only when all have been
    assert trips == draw_trips(grid, 1, 50)


def test_traffic_of_two_routes_by_hand() -> None:
    visits, moves, _ = traffic([np.array([(0, 0), (0, 1), (1, 2)]), np.array([(0, 1), (0, 0)])], (2, 3))
    assert moves[0, 0, 0] == 0.5  # east
    assert moves[0, 1, 7] == 0.5  # south-east
    assert moves[0, 1, 4] == 0.5  # west
    assert moves.sum() == 1.5
    assert visits.tolist() == [[1.0, 1.0, 0.0], [0.0, 0.0, 0.5]]


def test_bottlenecks_say_where_in_metres_and_how_much() -> None:
    waiting = np.zeros((7, 6))
    waiting[3, 3], waiting[6, 0] = 30.0, 10.0
    visits = np.zeros((7, 6))
    visits[3, 4] = 0.25
    first, second = bottlenecks(RACKS, waiting, visits)
    assert first == Bottleneck((3, 3), 3.5, 3.5, 30.0, 0.75, 0.25)
    assert second[:4] == ((6, 0), 0.5, 0.5, 10.0)


EAST = np.array([(3, column) for column in range(7)])
SOUTH = np.array([(row, 3) for row in range(7)])
JOINING = np.array([(1, 1), (2, 1), *EAST[2:].tolist()])
SLOPE = np.array([(k, k) for k in range(4)])
DIAGONALS = [np.array([(0, 0), (1, 1)]), np.array([(0, 1), (1, 0)])]


@pytest.mark.parametrize(
    ("routes", "met"),
    [
        ([EAST, SOUTH], 2 / 6),  # a window of 1, and both take 6
        ([EAST, EAST[::-1]], 7 * 2 / 6),  # the opposing stretch is 6 long
        ([SLOPE, SLOPE[::-1]], 2 * (1 + 3 * math.sqrt(2)) / (3 * math.sqrt(2))),
        ([EAST, EAST], 2 / 6),  # one behind the other
        ([EAST, JOINING], 1 / 6 + 1 / (5 + math.sqrt(2))),
        (DIAGONALS, 2 / math.sqrt(2)),  # no shared cell, but they cross
        ([DIAGONALS[0][::-1], DIAGONALS[1]], 2 / math.sqrt(2)),
        ([EAST, SOUTH, EAST[::-1]], 2 * 2 / 6 + 7 * 2 / 6),
        ([EAST], 0.0),
    ],
)
def test_conflicts_by_hand(routes: list[np.ndarray], met: float) -> None:
    assert traffic(routes, (7, 7)).conflicts == pytest.approx(met)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(0, 299), min_size=3, max_size=6, unique=True))
def test_conflicts_are_of_pairs_in_any_order(chosen: list[int]) -> None:
    grid = make_layout("paper46")
    all_trips = draw_trips(grid, 0)
    routes = plan_trips(grid, [all_trips[k] for k in chosen])
    pairs = sum(traffic([routes[i], routes[j]], grid.shape).conflicts for i in range(len(routes)) for j in range(i))
    assert traffic(routes, grid.shape).conflicts == pytest.approx(pairs)
    assert traffic(routes[::-1], grid.shape).conflicts == pytest.approx(pairs)
