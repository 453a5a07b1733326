"""Test the ant loop on tiny maps, local search on its paths, and the equations of PF-ACO."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.planning.ants.colonies import EAST, SOUTH, SOUTH_EAST, WEST, search, walked
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.maps.layouts import NAMED_TASKS, make_layout
from warehouse_env.planning import climb, make_planner, path_length, turns, validate
from warehouse_env.planning.ants.colony import Colony, EdgeWeights, WalkRule, cells_of, run, walk
from warehouse_env.planning.ants.local_search import shorten, straight_runs
from warehouse_env.planning.ants.pf_aco import PfAco, gentle_share, initial_pheromone
from warehouse_env.planning.ants.walks import AntFloor, Table, Walks, empty_walks, make_floor, measure


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


def test_first_steps_are_drawn_in_proportion_to_weights() -> None:
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
    """Return a floor whose east arm is a dead end and whose south arm leads to the goal."""
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
    assert (back.steps == 6).all()  # west, south, south, east, east, east, without the dead end
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


def test_local_update_pulls_used_edges_to_its_level() -> None:
    floor = open_floor(1, 3)
    trail = np.full((3, 8), 2.0)
    send(floor, np.ones((3, 8)), np.ones((3, 8)), 2, trail=trail, local=(0.1, 1.0))
    assert trail[0, EAST] == pytest.approx(1 + 0.9**2)  # 2 -> 1.9 -> 1.81
    assert trail[1, EAST] == pytest.approx(1.81)
    assert trail[2, 4] == 2.0


def test_walk_measures_by_hand() -> None:
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


def test_improved_path_counts_as_best() -> None:
    floor = open_floor(3, 3)
    table, start = np.ones((9, 8)), np.ones((9, 8))

    def appraise(walks: Walks) -> int:
        walks.moves[1, :2], walks.steps[1] = SOUTH_EAST, 2
        return measure(floor, walks, 0, 3)

    def update(_: AntFloor, iteration: int, pheromone: Table, walks: Walks, best: Walks) -> None:
        assert walks.length.min() == best.length[0] == 2 * math.sqrt(2)
        pheromone += 1

    colony = Colony(start, lambda iteration: (table, table), update)
    search = run(floor, colony, 0, 3, 2, np.random.default_rng(0), appraise=appraise)
    assert cells_of(floor, search.best, 0).tolist() == [[0, 0], [1, 1], [2, 2]]
    assert search.best_by_iteration.tolist() == [2 * math.sqrt(2)] * 2
    assert (start == 1).all()  # run works on a copy


def nothing(floor: AntFloor, iteration: int, pheromone: Table, walks: Walks, best: Walks) -> None:
    """Mark nothing."""


def test_search_finds_no_path_to_an_unreachable_goal() -> None:
    grid = GridMap(np.array([[False, True, False, False]]), picks=np.array([[0, 2]]), stations=np.array([[0, 3]]))
    floor, table = make_floor(grid, (0, 3)), np.ones((4, 8))
    colony = Colony(table, lambda iteration: (table, table), nothing)
    search = run(floor, colony, 0, 2, 3, np.random.default_rng(0))
    assert search.best.steps[0] == -1
    assert search.best_by_iteration.tolist() == [math.inf] * 3


def test_patience_ends_the_search_without_improvement() -> None:
    floor = open_floor(1, 4)
    table = np.ones((4, 8))
    colony = Colony(table, lambda iteration: (table, table), nothing)
    search = run(floor, colony, 0, 2, 50, np.random.default_rng(0), patience=5)
    assert search.best_by_iteration.tolist() == [3] * 6  # found in the first iteration, then five more


def moves_of(cells: list[Cell]) -> NDArray[np.int8]:
    table = [tuple(move) for move in MOVES.tolist()]
    return np.array([table.index(tuple(step)) for step in np.diff(cells, axis=0).tolist()], dtype=np.int8)


def improved(grid: GridMap, cells: list[Cell], gentleness: float = 0.0) -> NDArray[np.int64]:
    floor = make_floor(grid, cells[-1], gentleness)
    start = cells[0][0] * floor.columns + cells[0][1]
    moves = shorten(floor, straight_runs(floor), start, moves_of(cells))
    return np.concatenate([[cells[0]], cells[0] + np.cumsum(MOVES[moves], axis=0)])


def test_local_search_straightens_a_zigzag() -> None:
    zigzag = [(0, 0), (1, 0), (1, 1), (2, 1), (2, 2), (2, 3), (1, 4), (2, 5)]
    cells = improved(GridMap(np.zeros((4, 6), dtype=bool)), zigzag)
    assert path_length(cells) == 3 + 2 * math.sqrt(2)
    assert turns(cells) == 1


def test_local_search_keeps_a_worthwhile_detour() -> None:
    height = np.zeros((3, 5))
    height[0, 2] = 0.1  # straight over it: 4 cells and 0.2 m; round it: 2 + 2 sqrt 2 cells
    grid = GridMap(np.zeros((3, 5), dtype=bool), height)
    around = [(0, 0), (0, 1), (1, 2), (0, 3), (0, 4)]
    detour = 2 * math.sqrt(2) - 2
    assert path_length(improved(grid, around, 0.9 * detour / 0.2)) == 4
    kept = improved(grid, around, 1.1 * detour / 0.2)
    assert climb(grid, kept) == 0
    assert path_length(kept) == 2 + 2 * math.sqrt(2)


def test_local_search_is_valid_and_never_worse() -> None:
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


def test_initial_pheromone_eq_17() -> None:
    floor = make_floor(GridMap(np.zeros((4, 4), dtype=bool)), (1, 2))
    table = initial_pheromone(floor, 2 * 4 + 1, 1.5).reshape(4, 4, 8)
    assert (table[1:3, 1:3] == 1.5).all()
    assert table.sum() == 8 * (16 + 4 * 0.5)


def test_gentle_share_eqs_12_to_14() -> None:
    height = np.array([[0.0, 0.1, 0.0], [0.04, 0.0, 0.0]])
    floor = make_floor(GridMap(np.zeros((2, 3), dtype=bool), height), (1, 2))
    share = gentle_share(floor, 0.001)
    # From (0, 0): east climbs 0.1, south 0.04, south-east 0; h_max 0.1, h_min 0.
    assert share[0, [EAST, SOUTH, SOUTH_EAST]] == pytest.approx([0, 0.06 / 0.101, 0.1 / 0.101])
    assert share[0, WEST] == 0
    flat = make_floor(GridMap(np.zeros((2, 3), dtype=bool)), (1, 2))
    assert (gentle_share(flat, 0.001) == 0).all()


@pytest.mark.parametrize(("iteration", "fr"), [(0, 1.0), (25, 0.75), (99, 0.01)])
def test_heuristic_eq_8_with_eqs_9_to_15(iteration: int, fr: float) -> None:
    grid = GridMap(np.zeros((3, 6), dtype=bool))
    floor = make_floor(grid, (1, 5))
    turning, straight = PfAco().colony(grid, floor, 7).attraction(iteration)
    cell = 1 * 6 + 2  # in the open, 8 legal moves; the goal lies east
    assert straight[cell, EAST] == pytest.approx((fr * 1 + 1 + 0.3 * (0.5 * fr + 0.2)) ** 2)
    assert turning[cell, EAST] == pytest.approx((fr * 1 + 1 + 0.3 * 0.5 * fr / 8) ** 2)
    assert turning[cell, SOUTH_EAST] == pytest.approx((fr * math.sqrt(0.5) + 1 + 0.3 * 0.5 * fr / 8) ** 2)
    assert turning[cell, WEST] == pytest.approx((1 + 0.3 * 0.5 * fr / 8) ** 2)
    corner = 0  # three legal moves
    assert turning[corner, SOUTH] == pytest.approx((fr / math.sqrt(26) + 1 + 0.3 * 0.5 * fr / 3) ** 2)


def test_update_eqs_18_to_25_on_a_flat_floor() -> None:
    grid = GridMap(np.zeros((2, 3), dtype=bool))
    floor = make_floor(grid, (1, 2))
    colony = PfAco().colony(grid, floor, 0)
    pheromone = colony.pheromone.copy()
    assert (pheromone == 1.5).all()
    colony.update(floor, 0, pheromone, walked(floor, [EAST, SOUTH_EAST], [EAST, EAST, SOUTH]), walked(floor))
    first = 0.2 * 3 * (1 / (1 + math.sqrt(2)) + 0.2 / 1)
    second = 0.2 * 3 * (1 / 3 + 0.2 / 1)
    assert pheromone[0, EAST] == pytest.approx(0.8 * 1.5 + first + second)
    assert pheromone[1, SOUTH_EAST] == pytest.approx(0.8 * 1.5 + first)
    assert pheromone[5, WEST] == pytest.approx(0.8 * 1.5)


def test_update_eq_21_rewards_even_paths() -> None:
    height = np.zeros((2, 3))
    height[0, 1] = 0.3
    grid = GridMap(np.zeros((2, 3), dtype=bool), height)
    floor = make_floor(grid, (1, 2))
    pheromone = np.ones((6, 8))
    colony = PfAco().colony(grid, floor, 0)
    colony.update(floor, 0, pheromone, walked(floor, [EAST, SOUTH_EAST], [SOUTH_EAST, EAST]), walked(floor))
    common = 1 / (1 + math.sqrt(2)) + 0.2
    assert pheromone[0, EAST] == pytest.approx(0.8 + 0.6 * (common + 0.05 / (100 * math.sqrt(0.03))))
    assert pheromone[0, SOUTH_EAST] == pytest.approx(0.8 + 0.6 * (common + 0.05 / (100 * 0.01)))


TURNS_OF_THE_PAPER = {"in_zone": 8, "cross_zone": 18}  # tables 1 and 2 of paper 000


@pytest.mark.parametrize("task", NAMED_TASKS["paper46"])
def test_pf_aco_reaches_the_optimum_before_the_traditional_colony(task: str) -> None:
    grid = make_layout("paper46")
    start, goal = NAMED_TASKS["paper46"][task]
    optimum = grid.distance_to(goal)[start]
    plans = [search("pf_aco", grid, start, goal, seed) for seed in range(4)]
    assert [path_length(plan.cells) for plan in plans] == [optimum] * 4
    assert max(turns(plan.cells) for plan in plans) <= TURNS_OF_THE_PAPER[task[:-2]]
    traditional = search("aco", grid, start, goal)
    assert max(plan.converged_at for plan in plans) < traditional.converged_at


@pytest.mark.parametrize("local_search", [True, False])
@pytest.mark.parametrize("task", NAMED_TASKS["paper46_rough"])
def test_pf_aco_takes_gentle_ground_at_a_small_cost(task: str, local_search: bool) -> None:
    grid = make_layout("paper46_rough")
    start, goal = NAMED_TASKS["paper46_rough"][task]
    optimum = grid.distance_to(goal)[start]
    shortest = search("astar_turns", grid, start, goal)
    gentle = search("pf_aco", grid, start, goal, local_search=local_search)
    assert climb(grid, shortest.cells) >= 0.4
    assert climb(grid, gentle.cells) == 0
    assert optimum < path_length(gentle.cells) < 1.08 * optimum
    blind = search("pf_aco", grid, start, goal, gentleness=0.0, b=0.0, a=2.0, height_weight=0.0)
    assert path_length(blind.cells) < path_length(gentle.cells)
