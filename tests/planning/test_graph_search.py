"""The exact searches against hand-counted maps, the map's own distance field, and an exhaustive search for turns."""

from __future__ import annotations

import math

import numpy as np
import pytest

from warehouse_env.errors import PlanError
from warehouse_env.maps.grid_map import MOVES, Cell, GridMap
from warehouse_env.maps.layouts import NAMED_TASKS, make_layout
from warehouse_env.planning import make_planner, min_turns, path_length, turns, validate

EXACT = ("dijkstra", "astar", "astar_turns")
RNG = np.random.default_rng(0)


def drawn(*rows: str) -> GridMap:
    return GridMap(np.array([[c == "#" for c in row] for row in rows]))


@pytest.mark.parametrize("name", EXACT)
def test_a_wall_with_one_gap_by_hand(name: str) -> None:
    grid = drawn(
        ".....",
        "###.#",
        ".....",
    )
    plan = make_planner(name).plan(grid, (0, 0), (2, 0), RNG)
    # No diagonal at the gap: three east, two south, three west.
    validate(grid, plan.cells, (0, 0), (2, 0))
    assert path_length(plan.cells) == 8
    assert turns(plan.cells) == min_turns(grid, (0, 0), (2, 0)) == 2


def test_turns_decide_among_equally_short_paths() -> None:
    # 3 diagonal and 4 straight steps: one turn is enough, and no shortest path has none.
    grid = drawn(*["........"] * 4)
    plan = make_planner("astar_turns").plan(grid, (0, 0), (3, 7), RNG)
    assert path_length(plan.cells) == 4 + 3 * math.sqrt(2)
    assert turns(plan.cells) == 1


def test_named_tasks_have_the_lengths_they_claim() -> None:
    for layout, tasks in NAMED_TASKS.items():
        grid = make_layout(layout)
        for task in tasks.values():
            for name in EXACT:
                plan = make_planner(name).plan(grid, task.start, task.goal, RNG)
                validate(grid, plan.cells, task.start, task.goal)
                assert path_length(plan.cells) == task.optimal_length


def test_lengths_equal_the_distance_field_on_random_maps() -> None:
    rng = np.random.default_rng(1)
    for _ in range(40):
        occupied = rng.random((9, 12)) < 0.35
        occupied[0, 0] = occupied[8, 11] = False
        grid = GridMap(occupied)
        distance = float(grid.distance_to((8, 11))[0, 0])
        for name in EXACT:
            plan = make_planner(name).plan(grid, (0, 0), (8, 11), RNG)
            assert path_length(plan.cells) == pytest.approx(distance)
            if plan.found:
                validate(grid, plan.cells, (0, 0), (8, 11))


def fewest_turns(grid: GridMap, cell: Cell, goal: Cell, heading: int, left: float) -> float:
    """Walk every shortest path; `left` is what may still be driven."""
    if cell == goal:
        return 0
    best = math.inf
    for move in np.flatnonzero(grid.legal_moves[cell]).tolist():
        to = (cell[0] + int(MOVES[move, 0]), cell[1] + int(MOVES[move, 1]))
        rest = left - (math.sqrt(2) if move % 2 else 1)
        if grid.distance_to(goal)[to] <= rest + 1e-9:
            turned = 0 if heading in (-1, move) else 1
            best = min(best, turned + fewest_turns(grid, to, goal, move, rest))
    return best


def test_min_turns_equals_an_exhaustive_search() -> None:
    rng = np.random.default_rng(2)
    tried = 0
    while tried < 25:
        occupied = rng.random((6, 7)) < 0.2
        occupied[0, 0] = occupied[5, 6] = False
        grid = GridMap(occupied)
        distance = float(grid.distance_to((5, 6))[0, 0])
        if math.isinf(distance):
            continue
        assert min_turns(grid, (0, 0), (5, 6)) == fewest_turns(grid, (0, 0), (5, 6), -1, distance)
        tried += 1


def test_min_turns_without_a_path_is_refused() -> None:
    with pytest.raises(PlanError, match="no path"):
        min_turns(drawn(".#.", ".#."), (0, 0), (0, 2))


def test_astar_takes_well_under_a_millisecond() -> None:
    grid = make_layout("paper46")
    task = NAMED_TASKS["paper46"]["cross_zone_1"]
    best = min(make_planner("astar").plan(grid, task.start, task.goal, RNG).seconds for _ in range(30))
    assert best < 0.001
