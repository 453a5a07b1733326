"""The walkers on hand-drawn floors: where the classical field fails, which repair helps, and that every walk ends."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.simulation.worlds import drawn
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning import Plan, path_length, validate
from warehouse_env.planning.field_walkers import Apf, ApfImproved

RNG = np.random.default_rng(0)


def walk(planner: Apf | ApfImproved, grid: GridMap, start: Cell, goal: Cell) -> Plan:
    plan = planner.plan(grid, start, goal, RNG)
    if plan.found:
        validate(grid, plan.cells, start, goal)
    return plan


WALL = drawn([".......", ".......", ".#####.", ".......", "......."])


def test_on_an_empty_floor_the_walk_follows_the_nearest_of_eight_directions() -> None:
    grid = GridMap(np.zeros((6, 9), dtype=bool))
    # From (0, 0) to (2, 5) the force points 22 degrees below east: just nearer to east (0) than to 45.
    plan = walk(Apf(), grid, (0, 0), (2, 5))
    assert plan.cells.tolist() == [[0, 0], [0, 1], [1, 2], [1, 3], [2, 4], [2, 5]]
    assert path_length(walk(Apf(), grid, (5, 0), (0, 8)).cells) == pytest.approx(3 + 5 * 2**0.5)
    assert walk(Apf(), grid, (3, 3), (3, 3)).cells.tolist() == [[3, 3]]


def test_a_shelf_in_front_stops_the_classical_walker_and_no_relative_distance_helps() -> None:
    assert not walk(Apf(), WALL, (4, 3), (0, 3)).found
    assert not walk(ApfImproved(intermediate_point=False), WALL, (4, 3), (0, 3)).found


def test_the_intermediate_point_leads_round_the_shelf() -> None:
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
def test_every_walk_ends_on_a_valid_path_or_with_none(
    seed: int, shape: tuple[int, int], gain: float, reach: float
) -> None:
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
