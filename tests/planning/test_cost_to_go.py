"""Exact costs to go on: against another algorithm, in boxes, and with tolls."""

from __future__ import annotations

import hypothesis.strategies as st
import numpy as np
from hypothesis import given, settings

from warehouse_env.maps.grid_map import MOVES, GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.planning.cost_to_go import UNIT, UNREACHABLE, Box, CostToGo, cost_field


def relaxed(steps: np.ndarray, goal: tuple[int, int]) -> np.ndarray:
    """The same costs by relaxing all moves of all cells until nothing changes (Bellman and Ford)."""
    rows, columns, _ = steps.shape
    cost = np.full((rows + 2, columns + 2), np.inf)
    cost[goal[0] + 1, goal[1] + 1] = 0
    while True:
        before = cost.copy()
        for move, (d_row, d_column) in enumerate(MOVES):
            there = cost[1 + d_row : rows + 1 + d_row, 1 + d_column : columns + 1 + d_column]
            through = np.where(steps[:, :, move] > 0, steps[:, :, move] + there, np.inf)
            cost[1:-1, 1:-1] = np.minimum(cost[1:-1, 1:-1], through)
        if np.array_equal(cost, before):
            return cost[1:-1, 1:-1]


def as_costs(field: np.ndarray) -> np.ndarray:
    return np.where(field == UNREACHABLE, np.inf, field)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 14), st.integers(2, 14), st.sampled_from([0.0, 0.2, 0.5]))
def test_fields_are_exact_whatever_moves_are_legal_and_cost(seed: int, rows: int, columns: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    open_floor = GridMap(np.zeros((rows, columns), bool), picks=[(0, 0)], stations=[(0, 1)])
    legal = open_floor.legal_moves & (rng.random((rows, columns, 8)) >= share)
    steps = np.where(legal, rng.integers(UNIT, 4 * UNIT, legal.shape), 0).astype(np.int32)
    goal = int(rng.integers(rows)), int(rng.integers(columns))
    field = cost_field(steps, int(steps.max(initial=UNIT)), *goal, 0, 0, rows, columns)
    np.testing.assert_array_equal(as_costs(field), relaxed(steps, goal))


def test_a_box_knows_only_what_is_in_it_and_is_never_cheaper_than_the_floor() -> None:
    floor = CostToGo(make_layout("aisles:seed=3"))
    goal = tuple(floor.grid.stations[0].tolist())
    whole, box = floor.field(goal, floor.whole()), Box(0, 0, 24, 30)
    if not (goal[0] < 24 and goal[1] < 30):
        box = Box(goal[0] // 2, goal[1] // 2, *floor.grid.shape)
    part = floor.field(goal, box)
    assert part.shape == (box.bottom - box.top, box.right - box.left)
    np.testing.assert_array_less(whole[box.top : box.bottom, box.left : box.right], part.astype(np.int64) + 1)


def test_around_a_cell_is_the_whole_floor_where_its_way_leads_out_of_the_box() -> None:
    occupied = np.zeros((300, 200), bool)
    occupied[:250, 105] = True
    floor = CostToGo(GridMap(occupied, picks=[(0, 0)], stations=[(0, 1)], one_way=np.eye(300, 200, -250, np.uint8)))
    assert ((floor.steps > 0) == floor.grid.legal_moves).all()
    assert floor.around((10, 100), (30, 100))[1] == floor.box((10, 100), (30, 100)) == Box(0, 0, 128, 192)
    field, box = floor.around((10, 100), (10, 110))
    assert box == floor.whole()
    assert field[10, 100] < UNREACHABLE
