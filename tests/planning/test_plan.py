"""Test plans, measures and off-grid lines: validation by hand, Theta* by exact geometry, smoothing by eq. 13."""

from __future__ import annotations

import itertools
import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from warehouse_env.errors import ConfigError, PlanError
from warehouse_env.maps.clearance import segment_gap
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning import climb, make_planner, path_length, turns, validate
from warehouse_env.planning.ants.iaco import smooth
from warehouse_env.planning.any_angle import ThetaStar, line_of_sight
from warehouse_env.planning.plan import Plan, edge_cost, validate_line

# Shelf at (1, 1); the path goes round it on the south-west side.
ROUND = [(0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (1, 3)]


def shelf_map() -> GridMap:
    occupied = np.zeros((3, 4), dtype=bool)
    occupied[1, 1] = True
    height = np.zeros((3, 4))
    height[2, 1] = 0.25
    return GridMap(occupied, height)


def test_path_measures_by_hand() -> None:
    assert path_length(ROUND) == 4 + math.sqrt(2)
    assert turns(ROUND) == 2
    assert climb(shelf_map(), ROUND) == 0.5
    assert path_length([(3, 3)]) == 0
    assert turns([(3, 3)]) == 0
    assert path_length(np.empty((0, 2), int)) == math.inf
    assert turns(np.empty((0, 2), int)) == 0


@pytest.mark.parametrize(
    ("cells", "message"),
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
def test_validate_names_the_fault(cells: object, message: str) -> None:
    with pytest.raises(PlanError, match=message):
        validate(shelf_map(), cells, (0, 0), (1, 3))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("line", "clearance", "message"),
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
def test_validate_line_measures_whole_segments(line: list[tuple[float, float]], clearance: float, message: str) -> None:
    points = np.array(line, dtype=np.float64)
    if message is None:
        validate_line(shelf_map(), points, (0, 0), (1, 3), clearance)
        return
    with pytest.raises(PlanError, match=message):
        validate_line(shelf_map(), points, (0, 0), (1, 3), clearance)


def test_cell_costs_are_paid_on_entering() -> None:
    cost = np.zeros((3, 4))
    cost[0, 1] = 2.5
    edges = edge_cost(shelf_map(), cost)
    assert edges[0, 0, 0] == 2.5  # east, from (0, 0)
    assert edges[1, 0, 1] == 2.5  # north-east, from (1, 0)
    assert edges.sum() == 5 * 2.5  # five cells lie around (0, 1)
    assert (edge_cost(shelf_map(), edges) == edges).all()
    for bad, message in ((cost[:2], "shape"), (-cost, "at least 0"), (cost + math.inf, "finite")):
        with pytest.raises(ConfigError, match=message):
            edge_cost(shelf_map(), bad)


def test_planner_name_carries_parameters() -> None:
    carried = make_planner("pf_aco:ants=20, local_search=false,dead_end=die,patience=null")
    same = make_planner("pf_aco", ants=20, local_search=False, dead_end="die", patience=None)
    assert carried.key == same.key
    assert make_planner("pf_aco:ants=20", ants=30).key == make_planner("pf_aco", ants=30).key
    for text, message in (("pf_aco:ants=", "PARAMETER=VALUE"), ("pf_aco:ants=many", "must be a whole number")):
        with pytest.raises(ConfigError, match=message):
            make_planner(text)


def test_unknown_names_suggest_near_matches() -> None:
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


RNG = np.random.default_rng(0)


def plan(grid: GridMap, start: Cell, goal: Cell) -> Plan:
    return ThetaStar().plan(grid, start, goal, RNG)


def touches(a: Cell, b: Cell, square: Cell) -> bool:
    """Return whether a segment between cell centres meets a closed cell, exactly, by separating axes."""
    (r, c), (r2, c2) = ((2 * (p[0] - square[0]), 2 * (p[1] - square[1])) for p in (a, b))  # the square is [-1, 1]^2
    if min(r, r2) > 1 or max(r, r2) < -1 or min(c, c2) > 1 or max(c, c2) < -1:
        return False
    sides = [(r2 - r) * (y - c) - (c2 - c) * (x - r) for x in (-1, 1) for y in (-1, 1)]
    return min(sides) <= 0 <= max(sides)


@given(st.data())
def test_line_of_sight_equals_exact_geometry(data: st.DataObject) -> None:
    rows, cols = data.draw(st.integers(1, 7)), data.draw(st.integers(1, 7))
    shelves = data.draw(st.sets(st.tuples(st.integers(0, rows - 1), st.integers(0, cols - 1)), max_size=6))
    occupied = np.zeros((rows, cols), dtype=bool)
    for cell in shelves:
        occupied[cell] = True
    free = [tuple(cell) for cell in np.argwhere(~occupied).tolist()]
    if not free:
        return
    a, b = data.draw(st.sampled_from(free)), data.draw(st.sampled_from(free))
    assert line_of_sight(occupied, np.zeros(occupied.shape, np.uint8), *a, *b) == (
        not any(touches(a, b, shelf) for shelf in shelves)
    )


def visibility_length(grid: GridMap, start: Cell, goal: Cell) -> float:
    """Return the shortest any-angle length between cell centres, by Dijkstra on all visible pairs."""
    cells = [tuple(cell) for cell in np.argwhere(~grid.occupied).tolist()]
    length = dict.fromkeys(cells, math.inf)
    length[start] = 0.0
    while cells:
        here = min(cells, key=length.__getitem__)
        cells.remove(here)
        for other in cells:
            if math.isfinite(length[here]) and line_of_sight(grid.occupied, grid.one_way, *here, *other):
                length[other] = min(length[other], length[here] + math.dist(here, other))
    return length[goal]


def test_theta_star_lies_between_shortest_line_and_lattice() -> None:
    rng = np.random.default_rng(5)
    excess, saved = [], []
    for _ in range(60):
        occupied = rng.random((8, 10)) < rng.choice([0.1, 0.25, 0.4])
        occupied[0, 0] = occupied[7, 9] = False
        grid = GridMap(occupied)
        found = plan(grid, (0, 0), (7, 9))
        shortest, lattice = visibility_length(grid, (0, 0), (7, 9)), float(grid.distance_to((7, 9))[0, 0])
        assert found.found == math.isfinite(lattice) == math.isfinite(shortest)
        if not found.found:
            assert found.line is None
            continue
        assert found.line is not None
        validate_line(grid, found.line, (0, 0), (7, 9))
        vertices = found.line.astype(int).tolist()
        assert all(
            line_of_sight(occupied, np.zeros(occupied.shape, np.uint8), *a, *b) for a, b in itertools.pairwise(vertices)
        )
        assert shortest - 1e-9 <= found.line_length <= lattice + 1e-9
        validate(grid, found.cells, (0, 0), (7, 9))
        excess.append(found.line_length / shortest - 1)
        saved.append(lattice / shortest - 1)
    assert len(excess) > 30
    assert np.mean(excess) < 0.5 * np.mean(saved)  # at least half of the possible saving


OPEN = np.zeros((8, 8), dtype=bool)


def objective(line: NDArray[np.float64], cells: NDArray[np.int64], power: int, share: float = 0.5) -> float:
    """Return the objective of eq. 13 with lambda = mu = share."""
    return share * float(
        (np.hypot(*(line - cells).T) ** power).sum() + (np.hypot(*np.diff(line, axis=0).T) ** power).sum()
    )


def length(line: NDArray[Any]) -> float:
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def test_printed_norms_cannot_move_a_corner_of_45_degrees() -> None:
    cells = np.array([(3, 0), (3, 1), (3, 2), (2, 3), (1, 4), (0, 5)])
    np.testing.assert_array_equal(smooth(cells, OPEN, power=1), cells)
    assert length(smooth(cells, OPEN, power=2)) < length(cells) - 0.2


def test_printed_norms_move_a_right_angle_to_its_fermat_point() -> None:
    # Equal weights: the point from which the corners of the triangle (legs 1) are seen 120 degrees apart.
    cells = np.array([(0, 0), (0, 1), (1, 1)])
    off = (3 - math.sqrt(3)) / 6
    np.testing.assert_allclose(smooth(cells, OPEN, power=1)[1], [off, 1 - off], atol=1e-4)


def test_smoothing_keeps_whole_segments_off_shelves() -> None:
    occupied = OPEN.copy()
    occupied[2, 2] = True
    cells = np.array([(3, 2), (3, 1), (2, 1), (1, 1), (1, 2)])
    free = smooth(cells, occupied, deviation=0.01, clearance=0.0)
    line = smooth(cells, occupied, deviation=0.01, clearance=0.35)
    grid = GridMap(occupied)
    validate_line(grid, line, (3, 2), (1, 2), 0.35 - 1e-6)
    assert length(free) < length(line) < length(cells)
    # the line is taut: it touches the clearance
    solid = np.pad(occupied, 1, constant_values=True).astype(np.uint8)
    gaps = [segment_gap(solid, *(a[::-1] + 0.5), *(b[::-1] + 0.5), 1.0, 2.0) for a, b in pairwise(line)]
    assert min(gaps) == pytest.approx(0.35, abs=2e-3)


def some_path(seed: int, share: float, rows: int = 9, columns: int = 12) -> tuple[GridMap, NDArray[np.int64]]:
    """Return a random map and a winding path, the cheapest one under random costs."""
    rng = np.random.default_rng(seed)
    occupied = rng.random((rows, columns)) < share
    occupied[0, 0] = False
    grid = GridMap(occupied)
    start, goal = (tuple(grid.free_cells[k].tolist()) for k in rng.integers(0, len(grid.free_cells), 2))
    cost = rng.exponential(1.0, (rows, columns))
    return grid, make_planner("astar").plan(grid, start, goal, rng, cost).cells


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    share=st.floats(0, 0.45),
    clearance=st.floats(0, 0.8),
    power=st.sampled_from([1, 2]),
)
def test_smoothing_keeps_lines_valid_and_never_raises_the_objective(
    seed: int, share: float, clearance: float, power: int
) -> None:
    grid, cells = some_path(seed, share)
    line = smooth(cells, grid.occupied, clearance=clearance, power=power)
    assert line.shape == cells.shape
    start, goal = tuple(cells[0].tolist()), tuple(cells[-1].tolist())
    validate_line(grid, line, start, goal, min(clearance, 0.5) - 1e-6)
    assert objective(line, cells, power) <= objective(cells.astype(np.float64), cells, power) + 1e-9
    if power == 2:
        assert length(line) <= length(cells) + 1e-9
