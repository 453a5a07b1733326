"""Forces on hand-drawn maps: size, sign and direction. Vectors are (d_row, d_col)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning.potential_field import (
    alignment,
    descent_length,
    force_at,
    improved_potential,
    intermediate_point,
    repulsion,
    repulsive_potential,
)

GAIN, REACH = 0.02, 1.5


def one_shelf() -> np.ndarray:
    occupied = np.zeros((5, 5), dtype=bool)
    occupied[2, 2] = True
    return occupied


def test_repulsion_points_away_with_the_strength_of_the_formula() -> None:
    push = repulsion(one_shelf(), GAIN, REACH)
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
    assert alignment(force)[0, 0] == pytest.approx((1, half, 0, -half, -1, -half, 0, half))
    assert alignment(force)[0, 1] == pytest.approx(np.zeros(8))


def test_repulsive_potential_by_hand() -> None:
    energy = repulsive_potential(one_shelf(), 3.0, 2.0)
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
def test_the_improved_force_is_the_gradient_of_its_potential(
    row: float, col: float, exponent: float, gain: float, strength: float
) -> None:
    """One shelf at the origin, the goal at (-1, 2), any point of the plane; central differences."""
    goal, reach = (-1.0, 2.0), 10.0

    def potential(r: float, c: float) -> float:
        to_goal, away = math.hypot(goal[0] - r, goal[1] - c), math.hypot(r, c)
        return gain / 2 * to_goal**2 + strength / 2 * (1 / away - 1 / reach) ** 2 * to_goal**exponent

    away = math.hypot(row, col)
    push = strength * (1 / away - 1 / reach) / away**3
    energy = strength / 2 * (1 / away - 1 / reach) ** 2
    force = force_at(goal[0] - row, goal[1] - col, push * row, push * col, energy, gain, exponent)
    h = 1e-5
    assert force[0] == pytest.approx((potential(row - h, col) - potential(row + h, col)) / (2 * h), abs=1e-5, rel=1e-5)
    assert force[1] == pytest.approx((potential(row, col - h) - potential(row, col + h)) / (2 * h), abs=1e-5, rel=1e-5)


def test_descent_into_a_local_minimum_pays_the_penalty() -> None:
    occupied = np.zeros((3, 6), dtype=bool)
    occupied[:, 3] = True  # a wall; from the west all ways down end before it
    grid = GridMap(occupied)
    potential = improved_potential(np.zeros((3, 6)), (1, 5), 1.0, 0.5)
    length = descent_length(potential, grid.legal_moves, (1, 5), 4.0)
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
    assert intermediate_point(occupied, (3, 3), (0, 3), none) == (2, 5)
    tried = none.copy()
    tried[2, 5] = True
    assert intermediate_point(occupied, (3, 3), (0, 3), tried) in ((2, 6), (2, 0))
    tried[2] = True
    assert intermediate_point(occupied, (3, 3), (0, 3), tried) == (-1, -1)
