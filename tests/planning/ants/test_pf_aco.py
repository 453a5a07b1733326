"""The potential-field colony: every equation against numbers worked out by hand, and what it reaches."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.planning.ants.colonies import EAST, SOUTH, SOUTH_EAST, WEST, search, walked
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import NAMED_TASKS, make_layout
from warehouse_env.planning import climb, path_length, turns
from warehouse_env.planning.ants.floor import make_floor
from warehouse_env.planning.ants.pf_aco import PfAco, gentle_share, initial_pheromone


def test_initial_pheromone_eq_17() -> None:
    floor = make_floor(GridMap(np.zeros((4, 4), dtype=bool)), (1, 2))
    table = initial_pheromone(floor, 2 * 4 + 1, 1.5).reshape(4, 4, 8)
    assert (table[1:3, 1:3] == 1.5).all()
    assert table.sum() == 8 * (16 + 4 * 0.5)


def test_gentle_share_eqs_12_to_14() -> None:
    height = np.array([[0.0, 0.1, 0.0], [0.04, 0.0, 0.0]])
    floor = make_floor(GridMap(np.zeros((2, 3), dtype=bool), height), (1, 2))
    share = gentle_share(floor, 0.001)
    # From (0, 0): east climbs 0.1, south 0.04, south-east 0; h_max 0.1, h_min 0.
    assert share[0, [EAST, SOUTH, SOUTH_EAST]] == pytest.approx([0, 0.06 / 0.101, 0.1 / 0.101])
    assert share[0, WEST] == 0
    flat = make_floor(GridMap(np.zeros((2, 3), dtype=bool)), (1, 2))
    assert (gentle_share(flat, 0.001) == 0).all()


@pytest.mark.parametrize(("iteration", "fr"), [(0, 1.0), (25, 0.75), (99, 0.01)])
def test_heuristic_eq_8_with_eqs_9_to_15(iteration: int, fr: float) -> None:
    grid = GridMap(np.zeros((3, 6), dtype=bool))
    floor = make_floor(grid, (1, 5))
    turning, straight = PfAco().colony(grid, floor, 7).attraction(iteration)
    cell = 1 * 6 + 2  # in the open, 8 legal moves; the goal lies east
    assert straight[cell, EAST] == pytest.approx((fr * 1 + 1 + 0.3 * (0.5 * fr + 0.2)) ** 2)
    assert turning[cell, EAST] == pytest.approx((fr * 1 + 1 + 0.3 * 0.5 * fr / 8) ** 2)
    assert turning[cell, SOUTH_EAST] == pytest.approx((fr * math.sqrt(0.5) + 1 + 0.3 * 0.5 * fr / 8) ** 2)
    assert turning[cell, WEST] == pytest.approx((1 + 0.3 * 0.5 * fr / 8) ** 2)
    corner = 0  # three legal moves
    assert turning[corner, SOUTH] == pytest.approx((fr / math.sqrt(26) + 1 + 0.3 * 0.5 * fr / 3) ** 2)


def test_update_eqs_18_to_25_on_a_flat_floor() -> None:
    grid = GridMap(np.zeros((2, 3), dtype=bool))
    floor = make_floor(grid, (1, 2))
    colony = PfAco().colony(grid, floor, 0)
    pheromone = colony.pheromone.copy()
    assert (pheromone == 1.5).all()
    colony.update(0, pheromone, walked(floor, [EAST, SOUTH_EAST], [EAST, EAST, SOUTH]), walked(floor))
    first = 0.2 * 3 * (1 / (1 + math.sqrt(2)) + 0.2 / 1)
    second = 0.2 * 3 * (1 / 3 + 0.2 / 1)
    assert pheromone[0, EAST] == pytest.approx(0.8 * 1.5 + first + second)
    assert pheromone[1, SOUTH_EAST] == pytest.approx(0.8 * 1.5 + first)
    assert pheromone[5, WEST] == pytest.approx(0.8 * 1.5)


def test_update_eq_21_rewards_even_paths() -> None:
    height = np.zeros((2, 3))
    height[0, 1] = 0.3
    grid = GridMap(np.zeros((2, 3), dtype=bool), height)
    floor = make_floor(grid, (1, 2))
    pheromone = np.ones((6, 8))
    colony = PfAco().colony(grid, floor, 0)
    colony.update(0, pheromone, walked(floor, [EAST, SOUTH_EAST], [SOUTH_EAST, EAST]), walked(floor))
    common = 1 / (1 + math.sqrt(2)) + 0.2
    assert pheromone[0, EAST] == pytest.approx(0.8 + 0.6 * (common + 0.05 / (100 * math.sqrt(0.03))))
    assert pheromone[0, SOUTH_EAST] == pytest.approx(0.8 + 0.6 * (common + 0.05 / (100 * 0.01)))


TURNS_OF_THE_PAPER = {"in_zone": 8, "cross_zone": 18}  # tables 1 and 2 of paper 000


@pytest.mark.parametrize("task", NAMED_TASKS["paper46"])
def test_pf_aco_reaches_the_optimum_with_few_turns_before_the_traditional_colony(task: str) -> None:
    grid = make_layout("paper46")
    start, goal, optimum = NAMED_TASKS["paper46"][task]
    plans = [search("pf_aco", grid, start, goal, seed) for seed in range(4)]
    assert [path_length(plan.cells) for plan in plans] == [optimum] * 4
    assert max(turns(plan.cells) for plan in plans) <= TURNS_OF_THE_PAPER[task[:-2]]
    traditional = search("aco", grid, start, goal)
    assert max(plan.converged_at for plan in plans) < traditional.converged_at


@pytest.mark.parametrize("local_search", [True, False])
@pytest.mark.parametrize("task", NAMED_TASKS["paper46_rough"])
def test_gentle_ground_is_chosen_at_a_small_cost(task: str, local_search: bool) -> None:
    grid = make_layout("paper46_rough")
    start, goal, optimum = NAMED_TASKS["paper46_rough"][task]
    shortest = search("astar_turns", grid, start, goal)
    gentle = search("pf_aco", grid, start, goal, local_search=local_search)
    assert climb(grid, shortest.cells) >= 0.4
    assert climb(grid, gentle.cells) == 0
    assert optimum < path_length(gentle.cells) < 1.08 * optimum
    blind = search("pf_aco", grid, start, goal, gentleness=0.0, b=0.0, a=2.0, height_weight=0.0)
    assert path_length(blind.cells) < path_length(gentle.cells)
