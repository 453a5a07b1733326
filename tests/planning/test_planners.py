"""What every planner of PLANNERS must keep: valid or honestly empty, never too short, the same for the same seed."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import cache
from typing import Any

import numpy as np
import pytest

from warehouse_env.errors import PlanError
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.planning import PLANNERS, Plan, Planner, make_planner, path_length, validate

SMALL: dict[str, Any] = {"ants": 10, "iterations": 8}
MAY_FAIL = ("apf", "apf_improved")  # walkers, which see only what is near them
LAYOUTS_TRIED = ("paper46", "paper46_rough", "narrow", "single_lane", "random")


def small(name: str, **parameters: Any) -> Planner:
    """A planner with a small colony, if it is one."""
    return make_planner(name, **parameters, **(SMALL if "aco" in name else {}))


def search(planner: Planner, grid: GridMap, start: Cell, goal: Cell, seed: int = 0) -> Plan:
    return planner.plan(grid, start, goal, np.random.default_rng(seed))


@cache
def layout(name: str) -> GridMap:
    return make_layout(name)


@pytest.mark.parametrize("name", PLANNERS)
@pytest.mark.parametrize("where", LAYOUTS_TRIED)
def test_paths_are_valid_and_never_shorter_than_the_optimum(name: str, where: str) -> None:
    grid = layout(where)
    rng = np.random.default_rng(3)
    for a, b in rng.integers(0, len(grid.free_cells), (3, 2)):
        start, goal = tuple(grid.free_cells[a].tolist()), tuple(grid.free_cells[b].tolist())
        plan = search(small(name), grid, start, goal)
        assert plan.cells.dtype == np.int64
        if name in MAY_FAIL and not plan.found:
            continue
        validate(grid, plan.cells, start, goal)
        assert path_length(plan.cells) >= grid.distance_to(goal)[start] - 1e-9
        assert plan.seconds > 0
        if len(plan.best_by_iteration):
            assert plan.best_by_iteration[-1] == path_length(plan.cells)


@pytest.mark.parametrize("name", PLANNERS)
def test_the_same_seed_gives_the_same_bits(name: str) -> None:
    grid = layout("random")
    start, goal = tuple(grid.free_cells[0].tolist()), tuple(grid.free_cells[-1].tolist())
    first, again = (search(small(name), grid, start, goal, seed=5) for _ in range(2))
    np.testing.assert_array_equal(first.cells, again.cells)
    np.testing.assert_array_equal(first.best_by_iteration, again.best_by_iteration)


@pytest.mark.parametrize("name", PLANNERS)
def test_a_corridor_one_cell_wide(name: str) -> None:
    for shape in ((1, 9), (9, 1)):
        grid = GridMap(np.zeros(shape, dtype=bool))
        goal = (shape[0] - 1, shape[1] - 1)
        plan = search(small(name), grid, (0, 0), goal)
        validate(grid, plan.cells, (0, 0), goal)
        assert path_length(plan.cells) == 8


@pytest.mark.parametrize("name", PLANNERS)
def test_start_is_goal(name: str) -> None:
    plan = search(small(name), GridMap(np.zeros((3, 3), dtype=bool)), (1, 2), (1, 2))
    assert plan.cells.tolist() == [[1, 2]]
    assert (plan.best_by_iteration == 0).all()


@pytest.mark.parametrize("name", PLANNERS)
def test_a_walled_in_goal_gives_an_empty_plan(name: str) -> None:
    occupied = np.zeros((6, 6), dtype=bool)
    occupied[3, 3:] = occupied[3:, 3] = True  # (4, 4) is cut off; (2, 2) and it only touch by corners
    plan = search(small(name), GridMap(occupied), (0, 0), (4, 4))
    assert not plan.found
    assert plan.cells.shape == (0, 2)
    assert np.isinf(plan.best_by_iteration).all()
    assert plan.converged_at == 0


@pytest.mark.parametrize("name", PLANNERS)
@pytest.mark.parametrize(
    ("start", "goal", "says"),
    [
        ((1, 1), (0, 0), r"start \(1, 1\) stands on a shelf"),
        ((0, 0), (1, 1), r"goal \(1, 1\) stands on a shelf"),
        ((0, 0), (3, 0), r"goal \(3, 0\) is outside"),
        ((-1, 0), (0, 0), r"start \(-1, 0\) is outside"),
    ],
)
def test_unusable_cells_are_named(name: str, start: Cell, goal: Cell, says: str) -> None:
    occupied = np.zeros((3, 3), dtype=bool)
    occupied[1, 1] = True
    with pytest.raises(PlanError, match=says):
        search(small(name), GridMap(occupied), start, goal)


PLAIN_PYTHON = """
import sys
import numpy as np
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning import PLANNERS, make_planner

def digest():
    rng = np.random.default_rng(4)
    occupied = rng.random((9, 10)) < 0.2
    occupied[0, 0] = occupied[8, 9] = False
    grid = GridMap(occupied, rng.random((9, 10)) * 0.2)
    lines = []
    for name in PLANNERS:
        for more in ({}, {"local_search": False, "dead_end": "die"}) if "aco" in name else ({},):
            small = {"ants": 5, "iterations": 6} if "aco" in name else {}
            plan = make_planner(name, **small, **more).plan(grid, (0, 0), (8, 9), np.random.default_rng(1))
            lines.append(name + " " + plan.cells.tobytes().hex() + " " + plan.best_by_iteration.tobytes().hex())
    return "\\n".join(lines)
"""


def test_compiled_and_plain_python_agree_to_the_bit() -> None:
    scope: dict[str, Any] = {}
    exec(PLAIN_PYTHON, scope)
    plain = subprocess.run(
        [
            sys.executable,
            "-W",
            "error",
            "-c",
            PLAIN_PYTHON + "\nimport numba\nassert numba.config.DISABLE_JIT\nprint(digest())",
        ],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert plain.returncode == 0, plain.stderr
    assert plain.stdout.strip() == scope["digest"]()
