"""Plan, the measures of a path by hand-computed numbers, and a validator that finds every kind of fault."""

from __future__ import annotations

import math

import numpy as np
import pytest

from warehouse_env.errors import ConfigError, PlanError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning import PLANNERS, Plan, climb, make_planner, path_length, turns, validate

# Shelf at (1, 1); the path goes round it on the south-west side.
ROUND = [(0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (1, 3)]


def shelf_map() -> GridMap:
    occupied = np.zeros((3, 4), dtype=bool)
    occupied[1, 1] = True
    height = np.zeros((3, 4))
    height[2, 1] = 0.25
    return GridMap(occupied, height)


def test_measures_of_a_path() -> None:
    assert path_length(ROUND) == 4 + math.sqrt(2)
    assert turns(ROUND) == 2
    assert climb(shelf_map(), ROUND) == 0.5
    assert path_length([(3, 3)]) == 0
    assert turns([(3, 3)]) == 0
    assert path_length(np.empty((0, 2), int)) == math.inf
    assert turns(np.empty((0, 2), int)) == 0


def test_converged_at_is_the_first_iteration_with_the_final_best() -> None:
    cells = np.array([(0, 0), (0, 1)])

    def converged(*history: float) -> int:
        return Plan(cells, np.array(history), 0.0).converged_at

    assert converged(math.inf, 9, 7, 7, 7) == 3
    assert converged(7, 7) == 1
    assert converged(9, 8) == 2
    assert converged() == 0
    assert Plan(np.empty((0, 2), np.int64), np.full(3, math.inf), 0.0).converged_at == 0


def test_validate_accepts_a_right_path() -> None:
    validate(shelf_map(), ROUND, (0, 0), (1, 3))
    validate(shelf_map(), [(0, 0)], (0, 0), (0, 0))


@pytest.mark.parametrize(
    ("cells", "says"),
    [
        (np.empty((0, 2), int), "empty"),
        ([(1, 0), (0, 0)], r"starts at \(1, 0\)"),
        ([(0, 0), (0, 1), (0, 2)], r"ends at \(0, 2\)"),
        ([(0, 0), (1, 1), (1, 2), (1, 3)], r"shelf at \(1, 1\)"),
        ([(0, 0), (0, 1), (1, 2), (1, 3)], r"cuts a shelf corner from \(0, 1\) to \(1, 2\)"),
        ([(0, 0), (0, 2), (1, 3)], r"jumps from \(0, 0\) to \(0, 2\)"),
        ([(0, 0), (0, 0), (1, 3)], r"jumps from \(0, 0\) to \(0, 0\)"),
        ([(0, 0), (-1, 1), (1, 3)], r"leaves the map at \(-1, 1\)"),
        ([(0.0, 0.0), (1.0, 3.0)], "whole numbers"),
        ([0, 0, 1, 3], "shape"),
    ],
)
def test_validate_names_the_fault(cells: object, says: str) -> None:
    with pytest.raises(PlanError, match=says):
        validate(shelf_map(), cells, (0, 0), (1, 3))  # type: ignore[arg-type]


def test_unknown_names_are_refused_with_near_matches() -> None:
    with pytest.raises(ConfigError, match="pf_aco"):
        make_planner("pf-aco")
    with pytest.raises(ConfigError, match="evaporation"):
        make_planner("pf_aco", evaporatoin=0.2)
    with pytest.raises(ConfigError, match="takes no parameters"):
        make_planner("astar", ants=3)


@pytest.mark.parametrize(
    ("parameter", "value"),
    [
        ("ants", 0),
        ("ants", 2.5),
        ("iterations", -1),
        ("exponent", True),
        ("evaporation", 1.5),
        ("evaporation", -0.1),
        ("strength", math.nan),
        ("strength", math.inf),
        ("dead_end", "stop"),
        ("local_search", 1),
        ("strength", "much"),
    ],
)
@pytest.mark.parametrize("name", ["aco", "pf_aco"])
def test_bad_parameters_are_refused_by_name(name: str, parameter: str, value: object) -> None:
    with pytest.raises(ConfigError, match=f"{name} parameter {parameter}="):
        make_planner(name, **{parameter: value})


def test_keys_tell_planners_and_parameters_apart() -> None:
    keys = [make_planner(name).key for name in PLANNERS]
    keys += [make_planner("pf_aco", ants=7).key, make_planner("pf_aco", local_search=False).key]
    assert len(set(keys)) == len(keys)
    assert make_planner("pf_aco").key == make_planner("pf_aco").key
    for name in PLANNERS:
        assert make_planner(name).name == name
