"""One-way cells: every planner keeps them, on floors where the shortest way would not."""

from __future__ import annotations

import numpy as np
import pytest

from tests.planning.test_planners import MAY_FAIL, MODES, search
from warehouse_env.errors import PlanError
from warehouse_env.maps.grid_map import MOVES, GridMap
from warehouse_env.maps.one_way import parse
from warehouse_env.planning.plan import path_length, validate, validate_line

# Two aisles between three rows of shelves, the upper one to the east, the lower one to the west; rims all round.
SHELVES = [
    ".........",
    ".#######.",
    ".........",
    ".#######.",
    ".........",
    ".#######.",
    ".........",
]
ARROWS = [
    ".........",
    ".........",
    ".>>>>>>>.",
    ".........",
    ".<<<<<<<.",
    ".........",
    ".........",
]


def floor(arrows: list[str] = ARROWS) -> GridMap:
    occupied = np.array([[letter == "#" for letter in row] for row in SHELVES])
    return GridMap(occupied, one_way=parse(arrows), name="two aisles")


def against(grid: GridMap, row: int, column: int, move: int) -> bool:
    """Whether a move is against one of its two cells' arrows, from their definition."""
    d_row, d_column = MOVES[move]
    for cell in ((row, column), (row + d_row, column + d_column)):
        arrow = int(grid.one_way[cell])
        if arrow and (0, d_column, -d_row, -d_column, d_row)[arrow] < 0:
            return True
    return False


def test_legal_moves_are_those_of_the_shelves_but_for_moves_against_an_arrow() -> None:
    grid, plain = floor(), floor(["." * 9] * 7)
    for row, column, move in np.argwhere(plain.legal_moves).tolist():
        assert grid.legal_moves[row, column, move] == (not against(grid, row, column, move))
    assert not (grid.legal_moves & ~plain.legal_moves).any()
    assert grid.key != plain.key
    np.testing.assert_array_equal(plain.entries, plain.legal_moves)


def test_the_distance_is_that_of_the_way_there_not_of_the_way_back() -> None:
    grid = floor()
    assert grid.distance_to((2, 8))[2, 0] == 8  # along the arrows
    assert grid.distance_to((2, 0))[2, 8] == 12  # round by the aisle below, or by the rim above
    assert grid.distance_to((4, 0))[4, 8] == 8
    for goal in ((2, 4), (4, 4), (0, 0)):
        distance = grid.distance_to(goal)
        for row, column in grid.free_cells.tolist():
            onwards = [
                distance[row + MOVES[m, 0], column + MOVES[m, 1]] + (2**0.5 if m % 2 else 1.0)
                for m in np.flatnonzero(grid.legal_moves[row, column])
            ]
            assert (row, column) == goal or distance[row, column] == pytest.approx(min(onwards))


@pytest.mark.parametrize("mode", MODES)
def test_every_planner_keeps_one_way_cells(mode: str) -> None:
    grid = floor()
    found = 0
    tasks = [((2, 8), (2, 0)), ((4, 0), (4, 8)), ((2, 3), (2, 1)), ((4, 4), (2, 4)), ((0, 4), (6, 4)), ((4, 6), (4, 7))]
    for start, goal in tasks:
        plan = search(mode, grid, start, goal)
        if not plan.found:
            assert any(word in mode for word in MAY_FAIL), (start, goal)
            continue
        found += 1
        validate(grid, plan.cells, start, goal)
        assert path_length(plan.cells) >= grid.distance_to(goal)[start] - 1e-9
        if plan.line is not None:
            validate_line(grid, plan.line, start, goal)
    assert found or any(word in mode for word in MAY_FAIL)


def test_the_validator_refuses_what_drives_against_an_arrow() -> None:
    grid = floor()
    with pytest.raises(PlanError, match="against"):
        validate(grid, [(2, 3), (2, 2)], (2, 3), (2, 2))
    with pytest.raises(PlanError, match="against"):
        validate(grid, [(2, 1), (2, 0)], (2, 1), (2, 0))  # leaving counts as well
    with pytest.raises(PlanError, match="against"):
        validate_line(grid, np.array([(2.0, 8.0), (2.0, 0.0)]), (2, 8), (2, 0))
    validate(grid, [(2, 0), (2, 1)], (2, 0), (2, 1))
