"""The ant colony of paper 001: its heuristic and its wolf-pack rule by hand, and what they are good for."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.planning.ants.colonies import EAST, SOUTH, SOUTH_EAST, WEST, walked
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning.ants.apf_aco import ApfAco
from warehouse_env.planning.ants.floor import make_floor

START, NORTH = 0, 2


def test_heuristic_eq_16_on_an_open_floor() -> None:
    grid = GridMap(np.zeros((4, 5), dtype=bool))
    floor = make_floor(grid, (3, 4))
    turning, straight = ApfAco().colony(grid, floor, START).attraction(0)
    assert turning is straight
    # From (1, 1) to (3, 4): 13^(1/2) straight, 1 + 2 * 2^(1/2) down the field. Of (3, 4) itself: 0.1 + 0.
    assert turning[0, SOUTH_EAST] == pytest.approx((math.sqrt(13) + 1 + 2 * math.sqrt(2)) ** -7)
    assert turning[2 * 5 + 3, SOUTH_EAST] == pytest.approx(0.1**-7)


def test_heuristic_at_a_local_minimum_pays_the_penalty() -> None:
    occupied = np.zeros((3, 7), dtype=bool)
    occupied[0:2, 4] = True
    grid = GridMap(occupied)
    floor = make_floor(grid, (0, 6))
    colony = ApfAco(repulsion_gain=0.0).colony(grid, floor, START)
    # Ways down from the west end on (0, 3), 3 cells before the goal: 3 + 4 * 3, from (0, 2) one more.
    assert colony.attraction(0)[0][2, EAST] == pytest.approx((3 + 12) ** -7)
    assert colony.attraction(0)[0][1, EAST] == pytest.approx((4 + 13) ** -7)


def test_update_eqs_15_and_17_by_hand() -> None:
    floor = make_floor(GridMap(np.zeros((2, 3), dtype=bool)), (1, 2))
    pheromone = np.ones((6, 8))
    short, long = [EAST, SOUTH_EAST], [EAST, EAST, SOUTH]
    walks = walked(floor, short, long, short)
    ApfAco()._update(floor, 0, pheromone, walks, walks)
    a, b = 4 / (1 + math.sqrt(2)), 4 / 3  # rho * Q / L
    assert pheromone[1, SOUTH_EAST] == pytest.approx(0.6 + 2 * a + 2 * (a - b))  # two ants as good as the best
    assert pheromone[1, EAST] == pytest.approx(0.6 + b - 1 * (a - b))
    assert pheromone[0, EAST] == pytest.approx(0.6 + 2 * a + b + 2 * (a - b) - (a - b))
    assert pheromone[4, WEST] == pytest.approx(0.6)
