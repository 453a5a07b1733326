"""Forces on hand-drawn maps: size, sign and direction. Vectors are (d_row, d_col)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from warehouse_env.planning.potential_field import alignment, attraction, repulsion, resultant

GAIN, REACH = 0.02, 1.5


def one_shelf() -> np.ndarray:
    occupied = np.zeros((5, 5), dtype=bool)
    occupied[2, 2] = True
    return occupied


def test_attraction_is_a_unit_vector_to_the_goal() -> None:
    pull = attraction((5, 6), (1, 1))
    assert pull[1, 5] == pytest.approx((0, -1))
    assert pull[4, 1] == pytest.approx((-1, 0))
    assert pull[4, 5] == pytest.approx((-3 / 5, -4 / 5))
    assert pull[1, 1] == pytest.approx((0, 0))


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


def test_between_two_shelves_the_pushes_cancel() -> None:
    occupied = np.zeros((3, 3), dtype=bool)
    occupied[0, 1] = occupied[2, 1] = True
    assert repulsion(occupied, GAIN, REACH)[1, 1] == pytest.approx((0, 0))


def test_without_force_the_attraction_decides() -> None:
    # Beside a shelf of gain 3 the push of 3 * (1 - 1/1.5) = 1 exactly balances the unit pull through it.
    force = resultant(one_shelf(), (2, 0), 3.0, REACH)
    assert force[2, 3] == pytest.approx((0, -1))
    assert resultant(one_shelf(), (2, 0), 0.0, REACH)[4, 4] == pytest.approx((-2 / math.sqrt(20), -4 / math.sqrt(20)))


def test_alignment_is_the_cosine_to_each_move() -> None:
    force = np.zeros((1, 2, 2))
    force[0, 0] = (0.0, 0.25)  # east, of any size
    half = math.sqrt(0.5)
    assert alignment(force)[0, 0] == pytest.approx((1, half, 0, -half, -1, -half, 0, half))
    assert alignment(force)[0, 1] == pytest.approx(np.zeros(8))
