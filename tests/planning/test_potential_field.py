"""Test forces on hand-drawn maps and the walkers that follow them. Vectors are (d_row, d_col)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.simulation.worlds import drawn
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning import Plan, path_length, potential_field, validate
from warehouse_env.planning.field_walkers import Apf, ApfImproved

GAIN, REACH = 0.02, 1.5


def one_shelf() -> np.ndarray:
    occupied = np.zeros((5, 5), dtype=bool)
    occupied[2, 2] = True
    return occupied


def test_repulsion_points_away_with_the_formulas_strength() -> None:
    push, _ = potential_field.repulsion(one_shelf(), GAIN, REACH)
    beside = GAIN * (1 - 1 / 1.5)  # d = 1
    assert push[2, 3] == pytest.approx((0, beside))
    assert push[2, 1] == pytest.approx((0, -beside))
    assert push[1, 2] == pytest.approx((-beside, 0))
    corner = GAIN * (1 / math.sqrt(2) - 1 / 1.5) / 2  # d = sqrt 2
    assert push[3, 3] == pytest.approx((corner / math.sqrt(2), corner / math.sqrt(2)))
    assert push[0, 2] == pytest.approx((0, 0))  # two cells away, out of reach
    assert push[0, 0] == pytest.approx((0, 0))


def test_alignment_is_the_cosine_to_each_move() -> None:
    force = np.zeros((1, 2, 2))
    force[0, 0] = (0.0, 0.25)  # east, of any size
    half = math.sqrt(0.5)
    assert potential_field.alignment(force)[0, 0] == pytest.approx((1, half, 0, -half, -1, -half, 0, half))
    assert potential_field.alignment(force)[0, 1] == pytest.approx(np.zeros(8))


def test_repulsive_potential_by_hand() -> None:
    _, energy = potential_field.repulsion(one_shelf(), 3.0, 2.0)
    assert energy[2, 1] == pytest.approx(1.5 * 0.5**2)
    assert energy[1, 1] == pytest.approx(1.5 * (1 / math.sqrt(2) - 0.5) ** 2)
    assert energy[0, 2] == 0  # at the reach


@given(
    st.floats(0.3, 3.0),
    st.floats(0.3, 3.0),
    st.sampled_from([0.0, 0.5, 1.0, 2.0]),
    st.floats(0.0, 2.0),
    st.floats(0.1, 5.0),
)
def test_improved_force_is_the_gradient_of_its_potential(
    row: float, col: float, exponent: float, gain: float, strength: float
) -> None:
    """Check by central differences at any point: one shelf at the origin, the goal at (-1, 2)."""
    goal, reach = (-1.0, 2.0), 10.0

    def potential(r: float, c: float) -> float:
        to_goal, away = math.hypot(goal[0] - r, goal[1] - c), math.hypot(r, c)
        return gain / 2 * to_goal**2 + strength / 2 * (1 / away - 1 / reach) ** 2 * to_goal**exponent

    away = math.hypot(row, col)
    push = strength * (1 / away - 1 / reach) / away**3
    energy = strength / 2 * (1 / away - 1 / reach) ** 2
    force = potential_field.force_at(goal[0] - row, goal[1] - col, push * row, push * col, energy, gain, exponent)
    h = 1e-5
    assert force[0] == pytest.approx((potential(row - h, col) - potential(row + h, col)) / (2 * h), abs=1e-5, rel=1e-5)
    assert force[1] == pytest.approx((potential(row, col - h) - potential(row, col + h)) / (2 * h), abs=1e-5, rel=1e-5)


def test_descent_length_penalises_a_local_minimum() -> None:
    occupied = np.zeros((3, 6), dtype=bool)
    occupied[:, 3] = True  # a wall; from the west all ways down end before it
    grid = GridMap(occupied)
    potential = potential_field.improved_potential(np.zeros((3, 6)), (1, 5), 1.0, 0.5)
    length = potential_field.descent_length(potential, grid.legal_moves, (1, 5), 4.0)
    assert length[1, 2] == pytest.approx(4 * 3)
    assert length[1, 0] == pytest.approx(2 + 4 * 3)
    assert length[0, 1] == pytest.approx(2 + 4 * 3)  # east falls by 3.5 a cell, the diagonal by 4 / sqrt 2
    assert length[1, 4] == 1


def test_intermediate_point_of_paper_002_by_hand() -> None:
    occupied = np.zeros((5, 7), dtype=bool)
    occupied[2, 1:5] = True
    none = np.zeros_like(occupied)
    # Stuck on (3, 3) below the wall, the goal straight above: the line is barred by (2, 3), the perpendicular is row
    # 2; its nearest free cells are (2, 5), two to the east, then (2, 0), three to the west.
    assert potential_field.intermediate_point(occupied, (3, 3), (0, 3), none) == (2, 5)
    tried = none.copy()
    tried[2, 5] = True
    assert potential_field.intermediate_point(occupied, (3, 3), (0, 3), tried) in ((2, 6), (2, 0))
    tried[2] = True
    assert potential_field.intermediate_point(occupied, (3, 3), (0, 3), tried) == (-1, -1)


RNG = np.random.default_rng(0)


def walk(planner: Apf | ApfImproved, grid: GridMap, start: Cell, goal: Cell) -> Plan:
    plan = planner.plan(grid, start, goal, RNG)
    if plan.found:
        validate(grid, plan.cells, start, goal)
    return plan


WALL = drawn([".......", ".......", ".#####.", ".......", "......."])


def test_walk_on_empty_floor_follows_the_nearest_direction() -> None:
    grid = GridMap(np.zeros((6, 9), dtype=bool))
    # From (0, 0) to (2, 5) the force points 22 degrees below east: just nearer to east (0) than to 45.
    plan = walk(Apf(), grid, (0, 0), (2, 5))
    assert plan.cells.tolist() == [[0, 0], [0, 1], [1, 2], [1, 3], [2, 4], [2, 5]]
    assert path_length(walk(Apf(), grid, (5, 0), (0, 8)).cells) == pytest.approx(3 + 5 * 2**0.5)
    assert walk(Apf(), grid, (3, 3), (3, 3)).cells.tolist() == [[3, 3]]


def test_shelf_in_front_stops_walkers_without_intermediate_point() -> None:
    assert not walk(Apf(), WALL, (4, 3), (0, 3)).found
    assert not walk(ApfImproved(intermediate_point=False), WALL, (4, 3), (0, 3)).found


def test_intermediate_point_leads_round_the_shelf() -> None:
    for exponent in (0.5, 0.0):
        plan = walk(ApfImproved(exponent=exponent), WALL, (4, 3), (0, 3))
        assert plan.found
        assert (2, 6) in map(tuple, plan.cells) or (2, 0) in map(tuple, plan.cells)


@given(
    st.integers(0, 2**32 - 1),
    st.tuples(st.integers(1, 12), st.integers(1, 12)),
    st.sampled_from([0.0, 0.1, 1.0, 50.0]),
    st.sampled_from([0.0, 1.5, 4.0]),
)
def test_every_walk_gives_a_valid_path_or_none(seed: int, shape: tuple[int, int], gain: float, reach: float) -> None:
    rng = np.random.default_rng(seed)
    occupied = rng.random(shape) < 0.3
    start = (int(rng.integers(shape[0])), int(rng.integers(shape[1])))
    goal = (int(rng.integers(shape[0])), int(rng.integers(shape[1])))
    occupied[start] = occupied[goal] = False
    grid = GridMap(occupied)
    field = {"repulsion_gain": gain, "repulsion_reach": reach}
    classical = walk(Apf(**field), grid, start, goal)
    improved = walk(ApfImproved(**field), grid, start, goal)
    if not np.isfinite(grid.distance_to(goal)[start]):
        assert not classical.found
        assert not improved.found
    assert len(np.unique(classical.cells, axis=0)) == len(classical.cells)
