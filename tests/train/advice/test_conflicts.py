"""Conflicts between routes by hand-counted cases and properties."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from train.advice.conflicts import Conflicts, Route, conflict_table, conflicts
from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import MOVES, Cell
from warehouse_env.planning import path_length

SHAPE = (7, 7)
ROW = [(3, c) for c in range(7)]


def route(*cells: Cell) -> Route:
    return np.array(cells, dtype=np.int64)


def straight(start: Cell, goal: Cell) -> Route:
    steps = max(abs(goal[0] - start[0]), abs(goal[1] - start[1]))
    return np.array([np.rint(np.linspace(a, b, steps + 1)) for a, b in zip(start, goal, strict=True)], dtype=np.int64).T


EAST, WEST = straight((3, 0), (3, 6)), straight((3, 6), (3, 0))
SOUTH = straight((0, 3), (6, 3))


def test_routes_that_cross() -> None:
    # Window 1, duration 6 each.
    assert conflicts([EAST, SOUTH], SHAPE) == Conflicts(pytest.approx(2 / 6), 0)


def test_routes_against_each_other() -> None:
    # The stretch is 6 long: window 7.
    assert conflicts([EAST, WEST], SHAPE) == Conflicts(0, pytest.approx(7 * 2 / 6))


def test_driving_behind_each_other_is_one_merging() -> None:
    joining = np.concatenate([route((1, 1), (2, 1)), EAST[2:]])
    assert conflicts([EAST, joining], SHAPE) == Conflicts(pytest.approx(1 / 6 + 1 / path_length(joining)), 0)


def test_diagonals_that_change_over_share_no_cell_but_cross() -> None:
    a, b = route((0, 0), (1, 1)), route((0, 1), (1, 0))
    for routes in ([a, b], [b, a], [a[::-1], b]):
        assert conflicts(routes, SHAPE) == Conflicts(pytest.approx(2 / math.sqrt(2)), 0)


def test_bad_input_is_refused() -> None:
    with pytest.raises(ConfigError, match="without cells"):
        conflicts([EAST, np.empty((0, 2), np.int64)], SHAPE)


@st.composite
def wanderings(draw: st.DrawFn) -> Route:
    """A random self-avoiding walk on an open floor of SHAPE."""
    cells = [draw(st.tuples(st.integers(0, 6), st.integers(0, 6)))]
    for move in draw(st.lists(st.integers(0, 7), min_size=1, max_size=20)):
        to = (cells[-1][0] + int(MOVES[move, 0]), cells[-1][1] + int(MOVES[move, 1]))
        if 0 <= to[0] < 7 and 0 <= to[1] < 7 and to not in cells:
            cells.append(to)
    return np.array(cells, dtype=np.int64)


@settings(max_examples=200, deadline=None)
@given(st.lists(wanderings(), min_size=2, max_size=4))
def test_conflicts_are_mutual_and_do_not_care_for_names(routes: list[Route]) -> None:
    table = conflict_table(routes, SHAPE)
    np.testing.assert_allclose(table, table.transpose(1, 0, 2))
    np.testing.assert_allclose(conflict_table(routes[::-1], SHAPE), table[::-1, ::-1])
