"""Plan, the measures of a path by hand-computed numbers, and a validator that finds every kind of fault."""

from __future__ import annotations

import math

import numpy as np
import pytest

from warehouse_env.errors import ConfigError, PlanError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning import climb, make_planner, path_length, turns, validate
from warehouse_env.planning.plan import edge_cost, validate_line

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


@pytest.mark.parametrize(
    ("line", "clearance", "says"),
    [
        ([(0, 0), (2, 0), (2, 2), (1, 3)], 0.5, None),
        ([(0, 0), (2, 0), (2, 2), (1, 3)], 0.51, "edge"),
        ([(0, 0), (0, 2), (1, 3)], 0.5, None),
        ([(0, 0), (1.2, 2), (1, 3)], 0.0, r"passes through the shelf or edge at \(1, 1\)"),
        ([(0, 0), (0.5, 0.5), (0.5, 1.5), (1, 3)], 0.0, None),  # grazes the shelf
        ([(0, 0), (0.5, 0.5), (0.5, 1.5), (1, 3)], 0.1, r"comes 0\.000 cells"),
        ([(0, 0), (0, 1.5), (1, 3)], 0.42, r"from \(0\.0, 1\.5\) to \(1\.0, 3\.0\)"),  # 0.416 from its corner
        ([(0, 0), (0, 1.5), (1, 3)], 0.41, None),
        ([(0, 1), (1, 3)], 0.0, "starts"),
        ([(0, 0), (1, 2.9)], 0.0, "ends"),
        ([(0, 0), (math.nan, 1), (1, 3)], 0.0, "finite"),
        ([(0, 0), (-0.6, 1), (1, 3)], 0.0, "edge"),
    ],
)
def test_validate_line_measures_whole_segments(line: list[tuple[float, float]], clearance: float, says: str) -> None:
    points = np.array(line, dtype=np.float64)
    if says is None:
        validate_line(shelf_map(), points, (0, 0), (1, 3), clearance)
        return
    with pytest.raises(PlanError, match=says):
        validate_line(shelf_map(), points, (0, 0), (1, 3), clearance)


def test_a_cost_map_by_cell_counts_on_entering() -> None:
    cost = np.zeros((3, 4))
    cost[0, 1] = 2.5
    edges = edge_cost(shelf_map(), cost)
    assert edges[0, 0, 0] == 2.5  # east, from (0, 0)
    assert edges[1, 0, 1] == 2.5  # north-east, from (1, 0)
    assert edges.sum() == 5 * 2.5  # five cells lie around (0, 1)
    assert (edge_cost(shelf_map(), edges) == edges).all()
    for bad, says in ((cost[:2], "shape"), (-cost, "at least 0"), (cost + math.inf, "finite")):
        with pytest.raises(ConfigError, match=says):
            edge_cost(shelf_map(), bad)


def test_a_name_may_carry_parameters() -> None:
    carried = make_planner("pf_aco:ants=20, local_search=false,dead_end=die,patience=null")
    same = make_planner("pf_aco", ants=20, local_search=False, dead_end="die", patience=None)
    assert carried.key == same.key
    assert make_planner("pf_aco:ants=20", ants=30).key == make_planner("pf_aco", ants=30).key
    for text, says in (("pf_aco:ants=", "PARAMETER=VALUE"), ("pf_aco:ants=many", "must be a whole number")):
        with pytest.raises(ConfigError, match=says):
            make_planner(text)


def test_unknown_names_are_refused_with_near_matches() -> None:
    with pytest.raises(ConfigError, match="pf_aco"):
        make_planner("pf-aco")
    with pytest.raises(ConfigError, match="evaporation"):
        make_planner("pf_aco", evaporatoin=0.2)
    with pytest.raises(ConfigError, match="takes no parameters"):
        make_planner("theta_star", ants=3)


@pytest.mark.parametrize(
    ("parameter", "value"),
    [
        ("ants", 0), ("ants", 2.5), ("exponent", True), ("evaporation", 1.5), ("strength", math.nan),
        ("dead_end", "stop"), ("local_search", 1), ("strength", "much"),
    ],
)  # fmt: skip
def test_bad_parameters_are_refused_by_name(parameter: str, value: object) -> None:
    with pytest.raises(ConfigError, match=f"aco parameter {parameter}="):
        make_planner("aco", **{parameter: value})
