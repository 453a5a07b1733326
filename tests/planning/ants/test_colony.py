"""The ant loop on maps small enough to count, and local search on the paths of ants."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.planning import climb, make_planner, path_length, turns, validate
from warehouse_env.planning.ants.colony import Colony, EdgeWeights, WalkRule, cells_of, run, walk
from warehouse_env.planning.ants.floor import AntFloor, Table, make_floor
from warehouse_env.planning.ants.local_search import shorten, straight_runs
from warehouse_env.planning.ants.walks import Walks, empty_walks, measure

EAST, SOUTH_EAST, SOUTH = 0, 7, 6


def open_floor(rows: int, columns: int, height: Any = None) -> AntFloor:
    return make_floor(GridMap(np.zeros((rows, columns), dtype=bool), height), (rows - 1, columns - 1), gentleness=2.0)


def send(floor: AntFloor, turning: Table, straight: Table, ants: int, q0: float = 0.0, **options: Any) -> Walks:
    walks = empty_walks(options.get("start", 0), ants, len(floor.height))
    seeds = np.random.default_rng(0).integers(1, 2**63, ants, dtype=np.uint64)
    trail = options.get("trail", np.ones_like(turning))
    rule = WalkRule(q0, options.get("backtrack", True), *options.get("local", (0.0, 0.0)))
    visited = np.zeros(len(floor.height), np.int64)
    walk(floor, EdgeWeights(trail, turning, straight), rule, seeds, visited, 1, walks)
    return walks


def test_first_steps_are_drawn_in_proportion() -> None:
    floor = open_floor(2, 2)
    table = np.ones((4, 8))
    table[0, EAST], table[0, SOUTH_EAST], table[0, SOUTH] = 1.0, 5.0, 2.0
    walks = send(floor, table, table, 20_000)
    share = [(walks.moves[:, 0] == move).mean() for move in (EAST, SOUTH_EAST, SOUTH)]
    assert share == pytest.approx([1 / 8, 5 / 8, 2 / 8], abs=0.012)


def test_greedy_ants_take_the_best_edge() -> None:
    floor = open_floor(2, 2)
    table = np.ones((4, 8))
    table[0, SOUTH] = 1.5
    assert (send(floor, table, table, 200, q0=1.0).moves[:, 0] == SOUTH).all()
    half = (send(floor, table, table, 20_000, q0=0.5).moves[:, 0] == SOUTH).mean()
    assert half == pytest.approx(0.5 + 0.5 * 1.5 / 3.5, abs=0.015)


def dead_end_map() -> AntFloor:
    """The east arm ends blind, the south arm leads to the goal; ants are drawn east."""
    drawing = (
        "....",
        ".###",
        "....",
    )
    grid = GridMap(np.array([[c == "#" for c in row] for row in drawing]))
    return make_floor(grid, (2, 3))


def test_ants_step_back_from_a_dead_end_or_die() -> None:
    floor = dead_end_map()
    table = np.ones((12, 8))
    table[1, EAST] = 1e12
    back = send(floor, table, table, 20, start=1)
    assert (back.steps == 6).all()  # west, south, south, east, east, east: the arm is not in the path
    assert back.moves[0, :6].tolist() == [4, 6, 6, 0, 0, 0]
    dead = send(floor, table, table, 20, start=1, backtrack=False)
    assert (dead.steps == -1).all()


def test_no_ant_visits_a_cell_twice() -> None:
    floor = open_floor(5, 6)
    walks = send(floor, np.ones((30, 8)), np.ones((30, 8)), 100)
    for ant in range(100):
        cell, seen = 0, {0}
        for move in walks.moves[ant, : walks.steps[ant]]:
            cell = int(floor.neighbour[cell, move])
            assert cell not in seen
            seen.add(cell)
        assert cell == floor.goal


def test_local_update_draws_used_edges_to_its_level() -> None:
    floor = open_floor(1, 3)
    trail = np.full((3, 8), 2.0)
    send(floor, np.ones((3, 8)), np.ones((3, 8)), 2, trail=trail, local=(0.1, 1.0))
    assert trail[0, EAST] == pytest.approx(1 + 0.9**2)  # 2 -> 1.9 -> 1.81
    assert trail[1, EAST] == pytest.approx(1.81)
    assert trail[2, 4] == 2.0


def test_measures_of_walks_by_hand() -> None:
    height = np.zeros((2, 3))
    height[0, 1] = 0.3
    floor = open_floor(2, 3, height)
    walks = empty_walks(0, 3, 6)
    walks.steps[:] = 2, 2, -1
    walks.moves[0, :2] = EAST, SOUTH_EAST  # over the bump
    walks.moves[1, :2] = SOUTH_EAST, EAST
    assert measure(floor, walks, 0, 3) == 1
    assert walks.length[:2] == pytest.approx([1 + math.sqrt(2)] * 2)
    assert walks.turns[:2].tolist() == [1, 1]
    assert walks.cost[:2] == pytest.approx([1 + math.sqrt(2) + 2 * 0.6, 1 + math.sqrt(2)])
    # Heights 0, 0.3, 0: mean 0.1, sum of squares 0.06, over p - 1 = 2 (eq. 24).
    assert walks.spread[:2] == pytest.approx([math.sqrt(0.03), 0.0])
    assert math.isinf(walks.length[2])


def test_an_improved_path_counts() -> None:
    floor = open_floor(3, 3)
    table, start = np.ones((9, 8)), np.ones((9, 8))

    def appraise(walks: Walks) -> int:
        walks.moves[1, :2], walks.steps[1] = SOUTH_EAST, 2
        return measure(floor, walks, 0, 3)

    def update(iteration: int, pheromone: Table, walks: Walks, best: Walks) -> None:
        assert walks.length.min() == best.length[0] == 2 * math.sqrt(2)
        pheromone += 1

    colony = Colony(start, lambda iteration: (table, table), update)
    search = run(floor, colony, 0, 3, 2, np.random.default_rng(0), appraise=appraise)
    assert cells_of(floor, search.best, 0).tolist() == [[0, 0], [1, 1], [2, 2]]
    assert search.best_by_iteration.tolist() == [2 * math.sqrt(2)] * 2
    assert (start == 1).all()  # run works on a copy


def nothing(iteration: int, pheromone: Table, walks: Walks, best: Walks) -> None:
    """An update that marks nothing."""


def test_a_start_that_is_cut_off_ends_the_search() -> None:
    grid = GridMap(np.array([[False, True, False, False]]), picks=np.array([[0, 2]]), stations=np.array([[0, 3]]))
    floor, table = make_floor(grid, (0, 3)), np.ones((4, 8))
    colony = Colony(table, lambda iteration: (table, table), nothing)
    search = run(floor, colony, 0, 2, 3, np.random.default_rng(0))
    assert search.best.steps[0] == -1
    assert search.best_by_iteration.tolist() == [math.inf] * 3


def test_patience_ends_the_search_after_iterations_without_a_better_path() -> None:
    floor = open_floor(1, 4)
    table = np.ones((4, 8))
    colony = Colony(table, lambda iteration: (table, table), nothing)
    search = run(floor, colony, 0, 2, 50, np.random.default_rng(0), patience=5)
    assert search.best_by_iteration.tolist() == [3] * 6  # found in the first, then five more


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
