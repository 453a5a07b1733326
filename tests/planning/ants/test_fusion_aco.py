"""The ant colony of paper 002: its fading field by hand, and the intermediate point as seen by ants."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.planning.ants.colonies import EAST, SOUTH_EAST, WEST
from warehouse_env.maps.grid_map import MOVES, GridMap
from warehouse_env.planning.ants.floor import make_floor
from warehouse_env.planning.ants.fusion_aco import FusionAco

START = 0


@pytest.mark.parametrize(("iteration", "fr"), [(0, 1.0), (25, 0.75), (99, 0.01)])
def test_heuristic_eqs_22_and_23(iteration: int, fr: float) -> None:
    grid = GridMap(np.zeros((4, 9), dtype=bool))
    colony = FusionAco().colony(grid, make_floor(grid, (1, 7)), START)
    turning, straight = colony.attraction(iteration)
    assert turning is straight
    cell = 9 + 3  # the goal lies 4 east
    assert turning[cell, EAST] == pytest.approx(math.exp(fr) / 3**3)
    assert turning[cell, WEST] == pytest.approx(math.exp(-fr) / 5**3)
    assert turning[cell, SOUTH_EAST] == pytest.approx(math.exp(fr * math.sqrt(0.5)) / 10**1.5)
    assert colony.trail_power == 1.5


def test_force_eqs_12_and_17_to_20_by_hand() -> None:
    occupied = np.zeros((3, 6), dtype=bool)
    occupied[2, 1] = True
    force = FusionAco().force(GridMap(occupied), (1, 4))
    # (1, 1), 3 before the goal, the shelf 1 below: it pushes up with 0.3 (1 - 1/2) * 3; the pull is 3 and
    # 1/2 * 0.3 (1 - 1/2)^2 more.
    assert force[1, 1] == pytest.approx((-0.45, 3 + 0.0375))
    assert force[1, 4] == pytest.approx((0, 0))


def wall() -> GridMap:
    occupied = np.zeros((6, 9), dtype=bool)
    occupied[2, 2:7] = True
    return GridMap(occupied)


def test_the_intermediate_point_turns_the_force_round_the_wall() -> None:
    grid, goal = wall(), (0, 4)
    bare = FusionAco(repulsion_gain=0.0).force(grid, goal)
    led = FusionAco(repulsion_gain=0.0, intermediate_point=True).force(grid, goal)
    # Stuck on (3, 4), the point beside the wall is (2, 1) or (2, 7), three columns away and one up.
    side = int(np.sign(led[3, 4, 1]))
    assert led[3, 4] == pytest.approx((-1, 3 * side))
    assert led[3, 4 + side] == pytest.approx((-1, 2 * side))
    assert bare[3, 4] == pytest.approx((-3, 0))
    np.testing.assert_array_equal(led[0], bare[0])
    cosine_to_the_side = MOVES[EAST if side > 0 else WEST] @ led[3, 4] / math.sqrt(10)
    assert cosine_to_the_side == pytest.approx(3 / math.sqrt(10))
