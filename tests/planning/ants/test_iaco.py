"""The colony of paper 004: its equations against numbers worked out by hand, and its smoothed line."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.planning.ants.colonies import SOUTH_EAST, search
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.planning import path_length
from warehouse_env.planning.ants.floor import make_floor
from warehouse_env.planning.ants.iaco import Iaco
from warehouse_env.planning.plan import validate_line
from warehouse_env.planning.smoothing import smooth


def test_attraction_of_equation_7() -> None:
    floor = make_floor(GridMap(np.zeros((4, 5), dtype=bool)), (3, 4))
    colony = Iaco().colony(GridMap(np.zeros((4, 5), dtype=bool)), floor, 0)
    turning, straight = colony.attraction(3)
    assert turning is straight
    assert turning[0, SOUTH_EAST] == pytest.approx((10 / math.sqrt(13)) ** 7)
    assert turning[13, SOUTH_EAST] == pytest.approx(100.0**7)  # into the goal, whose distance counts as 0.1


def test_greed_of_equation_14() -> None:
    planner = Iaco()
    assert [planner.greedy_share(k) for k in range(20)] == [0.15] * 8 + [0.8] * 3 + [0.1] * 9


def test_evaporation_of_equation_9() -> None:
    scaled, printed = Iaco(), Iaco(schedule="printed", evaporation=5.0)
    assert scaled.evaporated(0) == pytest.approx(0.5 * math.exp(-3 / 400))
    assert scaled.evaporated(9) == pytest.approx(0.5 * math.exp(-0.75))
    assert scaled.evaporated(19) == pytest.approx(0.5 * math.exp(-3))
    assert [printed.evaporated(k) for k in range(3)] == pytest.approx([1.0, 5 * math.exp(-4), 5 * math.exp(-9)])


@pytest.mark.parametrize("norms", ["squared", "printed"])
@pytest.mark.parametrize("where", ["paper46", "random", "single_lane"])
def test_the_line_is_the_smoothed_path(where: str, norms: str) -> None:
    grid = make_layout(where)
    start, goal = (tuple(grid.free_cells[k].tolist()) for k in (10, -30))
    plan = search("iaco", grid, start, goal, norms=norms)
    assert plan.line is not None
    validate_line(grid, plan.line, start, goal, 0.35 - 1e-6)
    np.testing.assert_array_equal(plan.line, smooth(plan.cells, grid.occupied, power=2 if norms == "squared" else 1))
    assert plan.line_length < path_length(plan.cells)
