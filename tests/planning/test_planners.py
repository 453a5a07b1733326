"""Test the contract of every planner: valid or empty paths, never too short, repeatable, along arrows."""

from __future__ import annotations

import inspect
from functools import cache
from typing import Any

import numpy as np
import pytest

from tests.simulation.worlds import plain_python
from warehouse_env.errors import ConfigError, MapWarning, PlanError
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.maps.layouts import NAMED_TASKS, make_layout
from warehouse_env.maps.one_way import parse
from warehouse_env.planning import PLANNERS, Plan, Planner, make_planner
from warehouse_env.planning.plan import path_length, validate, validate_line

# Every planner with its defaults, and the modes of the papers.
MODES = (
    *PLANNERS,
    "aco:heuristic=next_cell,dead_end=die",
    "pf_aco:local_search=false,patience=null",
    "fusion_aco:intermediate_point=true",
    "shaa_acs:local_search=false",
    "iaco:smoothing=false",
    "apf_improved:intermediate_point=false",
)
SMALL = {"ants": 8, "particles": 8, "fish": 6, "iterations": 6}  # for speed; each planner takes the keys it knows
MAY_FAIL = ("apf", "die")  # local walkers and dying ants may find no path
LAYOUTS_TRIED = ("paper46_rough", "single_lane", "random", "pillars")


def small(mode: str) -> Planner:
    """Return a planner, with a small colony or swarm if it has one."""
    fields = inspect.signature(PLANNERS[mode.partition(":")[0]]).parameters
    return make_planner(mode, **{key: value for key, value in SMALL.items() if key in fields})


def search(mode: str, grid: GridMap, start: Cell, goal: Cell, seed: int = 0, cost: Any = None) -> Plan:
    return small(mode).plan(grid, start, goal, np.random.default_rng(seed), cost)


def checked(mode: str, grid: GridMap, start: Cell, goal: Cell) -> Plan:
    """Return a plan after checking that it is valid and not shorter than the optimum, or empty where it may be."""
    plan = search(mode, grid, start, goal)
    if not plan.found:
        assert any(word in mode for word in MAY_FAIL), (start, goal)
        return plan
    validate(grid, plan.cells, start, goal)
    assert path_length(plan.cells) >= grid.distance_to(goal)[start] - 1e-9
    if plan.line is not None:
        validate_line(grid, plan.line, start, goal)
    return plan


@cache
def layout(name: str) -> GridMap:
    return make_layout(name)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("where", LAYOUTS_TRIED)
def test_paths_are_valid_and_never_shorter_than_the_optimum(mode: str, where: str) -> None:
    grid = layout(where)
    rng = np.random.default_rng(3)
    for a, b in rng.integers(0, len(grid.free_cells), (3, 2)):
        start, goal = tuple(grid.free_cells[a].tolist()), tuple(grid.free_cells[b].tolist())
        plan = checked(mode, grid, start, goal)
        assert plan.cells.dtype == np.int64
        assert plan.seconds > 0
        if plan.found and len(plan.best_by_iteration):
            assert plan.best_by_iteration[-1] == path_length(plan.cells)
        if plan.line is not None:
            assert np.hypot(*np.subtract(start, goal)) - 1e-9 <= plan.line_length <= path_length(plan.cells) + 1e-9


@pytest.mark.parametrize("task", ["in_zone_2", "cross_zone_1"])
@pytest.mark.parametrize(
    ("mode", "share"),
    [
        ("apf_aco", 1.01),
        ("fusion_aco", 1.02),
        ("fusion_aco:intermediate_point=true", 1.02),
        ("pso", 1.03),
        ("afsa", 1.03),
    ],
)
def test_searches_come_close_to_the_optimum(mode: str, share: float, task: str) -> None:
    grid, (start, goal) = layout("paper46"), NAMED_TASKS["paper46"][task]
    optimum = grid.distance_to(goal)[start]
    plans = [make_planner(mode).plan(grid, start, goal, np.random.default_rng(seed)) for seed in range(2)]
    assert np.mean([path_length(plan.cells) for plan in plans]) <= share * optimum
    for plan in plans:
        assert len(plan.best_by_iteration) == make_planner(mode).iterations  # type: ignore[attr-defined]
        assert not (plan.best_by_iteration[1:] > plan.best_by_iteration[:-1]).any()


@pytest.mark.parametrize("mode", MODES)
def test_the_same_seed_gives_the_same_bits(mode: str) -> None:
    grid = layout("random")
    start, goal = tuple(grid.free_cells[0].tolist()), tuple(grid.free_cells[-1].tolist())
    first, again = (search(mode, grid, start, goal, seed=5) for _ in range(2))
    np.testing.assert_array_equal(first.cells, again.cells)
    np.testing.assert_array_equal(first.best_by_iteration, again.best_by_iteration)


@pytest.mark.parametrize("mode", MODES)
def test_planners_pass_a_corridor_of_one_cell(mode: str) -> None:
    for shape in ((1, 9), (9, 1)):
        grid = GridMap(np.zeros(shape, dtype=bool))
        goal = (shape[0] - 1, shape[1] - 1)
        plan = search(mode, grid, (0, 0), goal)
        validate(grid, plan.cells, (0, 0), goal)
        assert path_length(plan.cells) == 8


@pytest.mark.parametrize("name", PLANNERS)
def test_tight_floor_is_not_entered(name: str) -> None:
    tight = np.zeros((7, 9), np.bool_)
    tight[2:5, 3:6] = True
    grid = GridMap(np.zeros((7, 9)), tight=tight, picks=[(1, 8)], stations=[(3, 0)])
    cells = search(name, grid, (3, 0), (1, 8)).cells
    assert len(cells) or name in MAY_FAIL
    assert not tight[tuple(cells.T)].any()


@pytest.mark.parametrize("name", PLANNERS)
def test_slow_floor_is_avoided_or_warned_about(name: str) -> None:
    slow = np.full((5, 9), np.inf)
    slow[2, 1:8] = 0.5
    planner, grid, rng = make_planner(name), GridMap(np.zeros((5, 9)), speed=slow), np.random.default_rng(0)
    if planner.takes_cost:
        cells = planner.plan(grid, (2, 0), (2, 8), rng).cells
        assert np.isfinite(slow[tuple(cells.T)]).sum() <= 1
    else:
        with pytest.warns(MapWarning, match="neither preferred lanes nor speed limits"):
            planner.plan(grid, (2, 0), (2, 8), rng)


@pytest.mark.parametrize("mode", MODES)
def test_walled_in_goal_gives_an_empty_plan(mode: str) -> None:
    occupied = np.zeros((6, 6), dtype=bool)
    occupied[3, 3:] = occupied[3:, 3] = True  # (4, 4) is cut off: it touches (2, 2) only by corners
    plan = search(mode, GridMap(occupied), (0, 0), (4, 4))
    assert not plan.found
    assert plan.cells.shape == (0, 2)
    assert np.isinf(plan.best_by_iteration).all()
    assert plan.converged_at == 0


@pytest.mark.parametrize("mode", ["astar", "pf_aco"])
@pytest.mark.parametrize(
    ("start", "goal", "message"),
    [
        ((1, 1), (0, 0), r"start \(1, 1\) is on a shelf"),
        ((0, 0), (3, 0), r"goal \(3, 0\) is outside"),
    ],
)
def test_unusable_cells_are_named(mode: str, start: Cell, goal: Cell, message: str) -> None:
    occupied = np.zeros((3, 3), dtype=bool)
    occupied[1, 1] = True
    with pytest.raises(PlanError, match=message):
        search(mode, GridMap(occupied), start, goal)


@pytest.mark.parametrize("mode", MODES)
def test_cost_map_is_used_or_refused(mode: str) -> None:
    grid = GridMap(np.zeros((7, 9), dtype=bool))
    dear = np.zeros((7, 9))
    dear[1:6, 3] = 50.0  # a belt across the straight way; a detour costs two cells
    if not small(mode).takes_cost:
        with pytest.raises(ConfigError, match="takes no cost map"):
            search(mode, grid, (3, 0), (3, 8), cost=dear)
        return
    plan = make_planner(mode).plan(grid, (3, 0), (3, 8), np.random.default_rng(0), dear)
    validate(grid, plan.cells, (3, 0), (3, 8))
    assert dear[tuple(plan.cells.T)].sum() == 0
    free = search(mode, grid, (3, 0), (3, 8), cost=np.zeros((7, 9, 8)))
    np.testing.assert_array_equal(free.cells, search(mode, grid, (3, 0), (3, 8)).cells)
    with pytest.raises(ConfigError, match="cost map must"):
        search(mode, grid, (3, 0), (3, 8), cost=-dear)


def digest() -> str:
    """Return the bits of the plans of all modes."""
    rng = np.random.default_rng(4)
    occupied = rng.random((9, 10)) < 0.2
    occupied[0, 0] = occupied[8, 9] = False
    grid = GridMap(occupied, rng.random((9, 10)) * 0.2)
    lines = []
    for mode in MODES:
        plan = search(mode, grid, (0, 0), (8, 9), seed=1)
        line = b"" if plan.line is None else plan.line.tobytes()
        lines.append(f"{mode} {plan.cells.tobytes().hex()} {plan.best_by_iteration.tobytes().hex()} {line.hex()}")
    return "\n".join(lines)


@pytest.mark.nightly
def test_compiled_and_plain_python_agree_to_the_bit() -> None:
    program = "import numba; assert numba.config.DISABLE_JIT; from tests.planning import test_planners as t; "
    assert plain_python(f"{program}print(t.digest())") == digest().split()


# Two one-way aisles between three rows of shelves, the upper one eastwards, the lower one westwards.
AISLES = [
    ".........",
    ".#######.",
    ".>>>>>>>.",
    ".#######.",
    ".<<<<<<<.",
    ".#######.",
    ".........",
]


def floor(arrows: bool = True) -> GridMap:
    occupied = np.array([[letter == "#" for letter in row] for row in AISLES])
    one_way = parse([row.replace("#", ".") for row in AISLES])
    return GridMap(occupied, one_way=one_way if arrows else np.zeros_like(one_way), name="two aisles")


def against(grid: GridMap, row: int, column: int, move: int) -> bool:
    """Return whether a move is against an arrow of its two cells, by definition."""
    d_row, d_column = MOVES[move]
    for cell in ((row, column), (row + d_row, column + d_column)):
        arrow = int(grid.one_way[cell])
        if arrow and (0, d_column, -d_row, -d_column, d_row)[arrow] < 0:
            return True
    return False


def test_arrows_remove_only_moves_against_them() -> None:
    grid, plain = floor(), floor(arrows=False)
    for row, column, move in np.argwhere(plain.legal_moves).tolist():
        assert grid.legal_moves[row, column, move] == (not against(grid, row, column, move))
    assert not (grid.legal_moves & ~plain.legal_moves).any()
    assert grid.key != plain.key
    np.testing.assert_array_equal(plain.entries, plain.legal_moves)


def test_distance_is_measured_towards_the_goal() -> None:
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
    tasks = [((2, 8), (2, 0)), ((4, 0), (4, 8)), ((2, 3), (2, 1)), ((4, 4), (2, 4)), ((0, 4), (6, 4)), ((4, 6), (4, 7))]
    for start, goal in tasks:
        checked(mode, floor(), start, goal)


def test_validator_refuses_moves_against_an_arrow() -> None:
    grid = floor()
    with pytest.raises(PlanError, match="against"):
        validate(grid, [(2, 3), (2, 2)], (2, 3), (2, 2))
    with pytest.raises(PlanError, match="against"):
        validate(grid, [(2, 1), (2, 0)], (2, 1), (2, 0))  # leaving a one-way cell counts, too
    with pytest.raises(PlanError, match="against"):
        validate_line(grid, np.array([(2.0, 8.0), (2.0, 0.0)]), (2, 8), (2, 0))
    validate(grid, [(2, 0), (2, 1)], (2, 0), (2, 1))
