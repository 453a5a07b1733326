"""The traditional ant colony: its equations against numbers worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.planning.ants.colonies import EAST, SOUTH, SOUTH_EAST, WEST, search, walked
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning.ants.aco import Aco
from warehouse_env.planning.ants.floor import make_floor
from warehouse_env.planning.ants.fusion_aco import FusionAco
from warehouse_env.planning.ants.iaco import Iaco
from warehouse_env.planning.ants.system import AntSystem


def test_distance_heuristic_of_the_traditional_colony() -> None:
    grid = GridMap(np.zeros((4, 5), dtype=bool))
    floor, start = make_floor(grid, (3, 4)), 0
    to_goal, straight = Aco(exponent=1).colony(grid, floor, start).attraction(0)
    assert straight is to_goal
    assert to_goal[0, SOUTH_EAST] == pytest.approx(1 / math.sqrt(13))  # from (1, 1) to (3, 4)
    assert to_goal[0, EAST] == pytest.approx(1 / math.sqrt(18))
    assert to_goal[13, SOUTH_EAST] == pytest.approx(10)  # into the goal, whose distance counts as 0.1
    next_cell, _ = Aco(heuristic="next_cell").colony(grid, floor, start).attraction(7)
    assert next_cell[0, [EAST, SOUTH_EAST]] == pytest.approx([1, 1 / 2])  # (1/d)^2


@pytest.mark.parametrize(
    ("system", "kept", "strength"),
    [(Aco(), 0.9, 1.0), (FusionAco(), 0.5, 1.0), (Iaco(), 1 - 0.5 * math.exp(-3 / 400), 100.0)],
)
def test_trails_evaporate_and_all_ants_deposit(system: AntSystem, kept: float, strength: float) -> None:
    """Eq. 3 of paper 004, eqs. 7 to 9 of paper 002."""
    grid = GridMap(np.zeros((2, 3), dtype=bool))
    floor = make_floor(grid, (1, 2))
    colony = system.colony(grid, floor, 0)
    pheromone = colony.pheromone.copy()
    assert (pheromone == 1).all()
    colony.update(0, pheromone, walked(floor, [EAST, SOUTH_EAST], [EAST, EAST, SOUTH]), walked(floor))
    diagonal, straight = strength / (1 + math.sqrt(2)), strength / 3
    assert pheromone[0, EAST] == pytest.approx(kept + diagonal + straight)
    assert pheromone[1, SOUTH_EAST] == pytest.approx(kept + diagonal)
    assert pheromone[1, EAST] == pytest.approx(kept + straight)
    assert pheromone[4, WEST] == pytest.approx(kept)


def test_ants_that_die_may_find_nothing_and_say_so() -> None:
    # A comb of blind alleys: with one ant and one iteration, some seed dies in one.
    drawing = ("." * 9, "#.#.#.#.#", "#.#.#.#.#", "#.#.#.#..")
    grid = GridMap(np.array([[c == "#" for c in row] for row in drawing]))
    ants = {"ants": 1, "iterations": 1}
    dying = [search("aco", grid, (0, 0), (0, 8), seed, dead_end="die", **ants) for seed in range(30)]
    assert any(plan.found for plan in dying)
    assert not all(plan.found for plan in dying)
    assert all(search("aco", grid, (0, 0), (0, 8), seed, **ants).found for seed in range(30))
