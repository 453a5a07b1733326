"""Conflicts between routes by hand-counted cases and properties; cost maps that price exactly what is counted."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning import make_planner, path_length, validate
from warehouse_env.traffic.conflicts import HOLD, Conflicts, Route, conflict_table, conflicts, congestion
from warehouse_env.traffic.together import choose_together, plan_together

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
    # Both are 3 cells from the middle, so they meet there if they start together; window 1, duration 6 each.
    assert conflicts([EAST, SOUTH], SHAPE, "count") == Conflicts(1, 0)
    assert conflicts([EAST, SOUTH], SHAPE, "start") == Conflicts(1, 0)
    assert conflicts([EAST, SOUTH], SHAPE, "lifelong") == Conflicts(pytest.approx(2 / 6), 0)


def test_routes_against_each_other() -> None:
    # The stretch is 6 long: window 7.
    assert conflicts([EAST, WEST], SHAPE, "count") == Conflicts(0, 1)
    assert conflicts([EAST, WEST], SHAPE, "start") == Conflicts(0, 1)
    assert conflicts([EAST, WEST], SHAPE, "lifelong") == Conflicts(0, pytest.approx(7 * 2 / 6))


def test_driving_behind_each_other_is_one_merging() -> None:
    joining = np.concatenate([route((1, 1), (2, 1)), EAST[2:]])
    assert conflicts([EAST, joining], SHAPE, "count") == Conflicts(1, 0)
    # At (3, 2) after 2 and after 1 + sqrt 2: closer than the window.
    assert conflicts([EAST, joining], SHAPE, "start") == Conflicts(1, 0)
    assert conflicts([EAST, joining], SHAPE, "lifelong") == Conflicts(
        pytest.approx(1 / 6 + 1 / path_length(joining)), 0
    )


def test_diagonals_that_change_over_share_no_cell_but_cross() -> None:
    a, b = route((0, 0), (1, 1)), route((0, 1), (1, 0))
    for routes in ([a, b], [b, a], [a[::-1], b]):
        assert conflicts(routes, SHAPE, "start") == Conflicts(1, 0)
    assert conflicts([a, b], SHAPE, "lifelong") == Conflicts(pytest.approx(2 / math.sqrt(2)), 0)


def test_bad_input_is_refused() -> None:
    with pytest.raises(ConfigError, match="timing"):
        conflicts([EAST], SHAPE, "sometimes")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="without cells"):
        conflicts([EAST, np.empty((0, 2), np.int64)], SHAPE)
    with pytest.raises(ConfigError, match="at least one candidate"):
        choose_together([[EAST], []], SHAPE)


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
    for timing in ("count", "start", "lifelong"):
        table = conflict_table(routes, SHAPE, timing)  # type: ignore[arg-type]
        np.testing.assert_allclose(table, table.transpose(1, 0, 2))
        np.testing.assert_allclose(conflict_table(routes[::-1], SHAPE, timing), table[::-1, ::-1])  # type: ignore[arg-type]
    assert (conflict_table(routes, SHAPE, "start") <= conflict_table(routes, SHAPE, "count")).all()


def paid(path: Route, cost: np.ndarray) -> float:
    steps = np.diff(path, axis=0)
    moves = [int(np.flatnonzero((step == MOVES).all(axis=1))[0]) for step in steps]
    return sum(float(cost[(*cell, move)]) for cell, move in zip(path[:-1].tolist(), moves, strict=True))


@settings(max_examples=300, deadline=None)
@given(wanderings(), wanderings())
def test_the_directed_map_charges_what_is_counted(mine: Route, other: Route) -> None:
    # A robot that repeats `other` (duration T) conflicts on one drive of mine with chance 2 window / T a place; the
    # symmetric measure is the mean over both drives, so it is scaled from one to the other.
    cost = congestion([other], SHAPE, 1.0, 1.0)
    mean = conflict_table([mine, other], SHAPE, "lifelong")[0, 1].sum()
    t_mine, t_other = (max(path_length(path), 1.0) for path in (mine, other))
    expected = 2 / t_other * mean / (1 / t_mine + 1 / t_other)
    free_start = tuple(mine[0].tolist()) not in {tuple(cell) for cell in other.tolist()}
    entered = paid(mine, cost) + (0.0 if free_start else 2 * HOLD / t_other)  # the start is not entered
    assert entered == pytest.approx(expected)


def test_following_is_free_and_opposing_is_dear() -> None:
    cost = congestion([EAST], SHAPE, 1.0, 5.0)
    assert cost[3, 2, 0] == 0
    assert cost[3, 2, 4] == pytest.approx(5 * 2 / 6)
    assert cost[2, 2, 6] == pytest.approx(2 * HOLD / 6)  # onto the route from the side


def test_planned_together_routes_keep_out_of_each_others_way() -> None:
    # Two streets between the same ends: one for each direction, at no more length.
    occupied = np.zeros((5, 9), dtype=bool)
    occupied[1:4, 1:8] = True
    grid = GridMap(occupied)
    tasks = [((2, 0), (2, 8)), ((2, 8), (2, 0)), ((1, 0), (1, 8))]
    astar = make_planner("astar")
    for directed in (False, True):
        plans = plan_together(astar, grid, tasks[:2], directed=directed)
        for plan, (start, goal) in zip(plans, tasks, strict=False):
            validate(grid, plan.cells, start, goal)
        assert conflicts([plan.cells for plan in plans], grid.shape).opposing == 0
    plans = plan_together(astar, grid, tasks)  # the third can follow the first
    assert conflicts([plan.cells for plan in plans], grid.shape).opposing == 0
