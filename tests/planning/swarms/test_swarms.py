"""Test the swarms: way-points as paths, and equations and behaviours by hand on a stand-in cost."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.simulation.worlds import drawn
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning.ants.colony import cells_of
from warehouse_env.planning.ants.walks import make_floor
from warehouse_env.planning.plan import path_length, validate
from warehouse_env.planning.swarms.fish_swarm import FishSwarm
from warehouse_env.planning.swarms.waypoints import Code, ParticleSwarm, Paths


def paths_of(grid: GridMap, start: Cell, goal: Cell, cost: np.ndarray | None = None) -> Paths:
    floor = make_floor(grid, goal, 0.0, cost)
    return Paths(grid, floor, start[0] * floor.columns + start[1])


def decoded(grid: GridMap, start: Cell, goal: Cell, *points: tuple[float, float]) -> list[Cell]:
    paths = paths_of(grid, start, goal)
    paths.cost(np.array(points, dtype=np.float64)[None])
    return [tuple(cell) for cell in cells_of(make_floor(grid, goal), paths.best, 0).tolist()]


OPEN = drawn(["....."] * 4)
WALL = drawn([".....", ".###.", "...#.", "....."])


def test_walk_visits_its_points_diagonals_first() -> None:
    assert decoded(OPEN, (0, 0), (0, 4), (2.4, 1.6)) == [(0, 0), (1, 1), (2, 2), (1, 3), (0, 4)]
    assert decoded(OPEN, (0, 0), (3, 1), (0.0, 0.0)) == [(0, 0), (1, 1), (2, 1), (3, 1)]


def test_unreachable_point_counts_as_the_nearest_reachable_cell() -> None:
    assert decoded(WALL, (0, 0), (0, 4), (1.0, 2.0)) == decoded(WALL, (0, 0), (0, 4), (0.0, 2.0))
    assert decoded(OPEN, (0, 0), (0, 4), (99.0, -7.0)) == decoded(OPEN, (0, 0), (0, 4), (3.0, 0.0))
    island = GridMap(np.array([list("..#."), list("..##"), list("....")]) == "#")
    assert (0, 3) not in decoded(island, (0, 0), (2, 3), (0.0, 3.0))


def test_cost_is_length_plus_tolls_and_the_best_path_is_kept() -> None:
    toll = np.zeros((4, 5))
    toll[0, 2] = 5.0
    paths = paths_of(OPEN, (0, 0), (0, 4), toll)
    straight, around = [(0.0, 2.0)], [(1.0, 2.0)]
    cost = paths.cost(np.array([straight, around], dtype=np.float64))
    assert cost == pytest.approx([4.0 + 5.0, 2.0 + 2.0 * math.sqrt(2.0)])
    assert paths.best.cost[0] == cost[1]
    assert paths.cost(np.array([straight], dtype=np.float64)) == pytest.approx([9.0])
    assert paths.best.cost[0] == cost[1]


@given(seed=st.integers(0, 10_000), share=st.floats(0.0, 0.5), rows=st.integers(1, 9), columns=st.integers(2, 9))
def test_every_code_decodes_to_a_valid_path_without_loops(seed: int, share: float, rows: int, columns: int) -> None:
    rng = np.random.default_rng(seed)
    occupied = rng.random((rows, columns)) < share
    start, goal = (0, 0), (rows - 1, columns - 1)
    occupied[start] = occupied[goal] = False
    grid = GridMap(occupied)
    paths = paths_of(grid, start, goal)
    optimum = float(grid.distance_to(goal)[start])
    assert paths.reachable == math.isfinite(optimum)
    if not paths.reachable:
        return
    codes = rng.uniform(-2.0, 11.0, (4, 3, 2))
    for code in codes:
        cost = paths_of(grid, start, goal).cost(code[None])
        again = paths.cost(code[None])
        assert cost == again >= optimum - 1e-9
    cells = cells_of(make_floor(grid, goal), paths.best, 0)
    validate(grid, cells, start, goal)
    assert len({tuple(cell) for cell in cells.tolist()}) == len(cells)
    assert path_length(cells) == paths.best.length[0] == paths.cost(codes).min()


TARGET = (2.0, 3.0)


class Recorder(Paths):
    """Paths on a map of 11 x 11 cells that record tried codes; a code's cost is its distance from TARGET."""

    def __init__(self) -> None:
        grid = GridMap(np.zeros((11, 11), dtype=bool))
        super().__init__(grid, make_floor(grid, (10, 10)), 0)
        self.tried: list[Code] = []

    def cost(self, code: Code) -> NDArray[np.float64]:
        """Return the sum over all points of the coordinates' distances from TARGET."""
        self.tried.append(code.copy())
        distance: NDArray[np.float64] = np.abs(code - TARGET).sum(axis=(1, 2))
        return distance


def test_particle_velocity_and_place_by_hand() -> None:
    swarm = ParticleSwarm(iterations=3, particles=2, waypoints=1, speed_limit=0.5, own_pull=1.0, swarm_pull=2.0)
    paths = Recorder()
    swarm.search(paths, np.array([[[2.0, 4.0]], [[6.0, 3.0]]]), np.random.default_rng(1))
    rng = np.random.default_rng(1)
    first, second, third = paths.tried
    # Particles start at rest, each at its own best; the first leads at a distance of 1 against 4.
    pulls = rng.random((2, 2, 1, 2))
    assert (second[0] == first[0]).all()
    assert second[1] == pytest.approx(first[1] + np.clip(2.0 * pulls[1, 1] * (first[0] - first[1]), -5.5, 5.5))
    # The second of three inertias follows.
    off = [np.abs(code[1] - TARGET).sum() for code in (first, second)]
    own, leads = second[1] if off[1] < off[0] else first[1], second[1] if off[1] < 1.0 else first[0]
    pulls = rng.random((2, 2, 1, 2))
    velocity = 0.65 * (second[1] - first[1]) + pulls[0, 1] * (own - second[1]) + 2.0 * pulls[1, 1] * (leads - second[1])
    assert third[1] == pytest.approx(np.clip(second[1] + np.clip(velocity, -5.5, 5.5), 0, 10))


def after_meeting(swarm: FishSwarm, places: list[tuple[float, float]], vision: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the new places of fish with one way-point each after following and swarming, and their costs."""
    place, paths = np.array(places)[:, None], Recorder()
    new, cost = swarm._meet(paths, place, paths.cost(place), vision, np.random.default_rng(0))
    return new[:, 0], cost


def test_fish_follows_the_best_in_sight() -> None:
    # The third fish sees no other; the centre of two fish is no better than the better one.
    swarm = FishSwarm(waypoints=1, crowding=1.0)
    new, cost = after_meeting(swarm, [(2.0, 3.0), (2.0, 7.0), (9.0, 9.0)], 5.0)
    assert cost[0] == cost[2] == np.inf
    assert new[1, 0] == 2.0
    assert 3.0 <= new[1, 1] < 7.0
    assert cost[1] == pytest.approx(new[1, 1] - 3.0)


def test_fish_swarms_to_a_better_centre() -> None:
    # At four corners around the target all fish are equal, but the centre of the three others is better.
    corners = [(0.0, 1.0), (0.0, 5.0), (4.0, 1.0), (4.0, 5.0)]
    new, cost = after_meeting(FishSwarm(waypoints=1, crowding=1.0), corners, 6.0)
    for k, corner in enumerate(corners):
        middle = np.mean([c for c in corners if c != corner], axis=0)
        way, all_the_way = new[k] - corner, middle - corner
        assert way[0] * all_the_way[1] == pytest.approx(way[1] * all_the_way[0])
        assert 0 < np.linalg.norm(way) <= np.linalg.norm(all_the_way)
        assert cost[k] == np.abs(new[k] - TARGET).sum() < 4.0
