"""Local search: hand-drawn detours, and the properties it must have on any path."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning import climb, make_planner, path_length, turns, validate
from warehouse_env.planning.ants.floor import make_floor
from warehouse_env.planning.ants.local_search import shorten, straight_runs


def moves_of(cells: list[Cell]) -> NDArray[np.int8]:
    table = [tuple(move) for move in MOVES.tolist()]
    return np.array([table.index(tuple(step)) for step in np.diff(cells, axis=0).tolist()], dtype=np.int8)


def improved(grid: GridMap, cells: list[Cell], gentleness: float = 0.0) -> NDArray[np.int64]:
    floor = make_floor(grid, cells[-1], gentleness)
    start = cells[0][0] * floor.columns + cells[0][1]
    moves = shorten(floor, straight_runs(floor), start, moves_of(cells))
    return np.concatenate([[cells[0]], cells[0] + np.cumsum(MOVES[moves], axis=0)])


def test_a_zigzag_on_open_floor_becomes_one_turn() -> None:
    zigzag = [(0, 0), (1, 0), (1, 1), (2, 1), (2, 2), (2, 3), (1, 4), (2, 5)]
    cells = improved(GridMap(np.zeros((4, 6), dtype=bool)), zigzag)
    assert path_length(cells) == 3 + 2 * math.sqrt(2)
    assert turns(cells) == 1


def test_a_detour_round_a_bump_stays_if_it_is_worth_it() -> None:
    height = np.zeros((3, 5))
    height[0, 2] = 0.1  # straight over it: 4 cells and 0.2 m; round it: 2 + 2 sqrt 2 cells
    grid = GridMap(np.zeros((3, 5), dtype=bool), height)
    around = [(0, 0), (0, 1), (1, 2), (0, 3), (0, 4)]
    detour = 2 * math.sqrt(2) - 2
    assert path_length(improved(grid, around, 0.9 * detour / 0.2)) == 4
    kept = improved(grid, around, 1.1 * detour / 0.2)
    assert climb(grid, kept) == 0
    assert path_length(kept) == 2 + 2 * math.sqrt(2)


def test_never_worse_and_always_valid_on_the_paths_of_ants() -> None:
    rng = np.random.default_rng(6)
    ants = make_planner("aco", ants=1, iterations=1, heuristic="next_cell")
    for _ in range(30):
        occupied = rng.random((14, 15)) < 0.2
        occupied[0, 0] = occupied[13, 14] = False
        grid = GridMap(occupied, rng.random((14, 15)) * (rng.random() < 0.5))
        path = ants.plan(grid, (0, 0), (13, 14), rng).cells
        if not len(path):
            continue
        start = [(int(row), int(column)) for row, column in path]
        for gentleness in (0.0, 2.0):
            cells = improved(grid, start, gentleness)
            validate(grid, cells, (0, 0), (13, 14))
            before, after = (path_length(c) + gentleness * climb(grid, c) for c in (path, cells))
            assert after <= before + 1e-5  # heights are rounded to micrometres
            again = improved(grid, [(int(row), int(column)) for row, column in cells], gentleness)
            assert path_length(again) + gentleness * climb(grid, again) <= after + 1e-5
