"""The swarms: their equations and behaviours by hand, against a stand-in for the decoding of codes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning.ants.floor import make_floor
from warehouse_env.planning.swarms.fish_swarm import FishSwarm
from warehouse_env.planning.swarms.particle_swarm import ParticleSwarm
from warehouse_env.planning.swarms.waypoints import Code, Paths

TARGET = (2.0, 3.0)


class Recorder(Paths):
    """Notes the codes that are tried on a map of 11 x 11 cells; a code's cost is its distance from TARGET."""

    def __init__(self) -> None:
        grid = GridMap(np.zeros((11, 11), dtype=bool))
        super().__init__(grid, make_floor(grid, (10, 10)), 0)
        self.tried: list[Code] = []

    def cost(self, code: Code) -> NDArray[np.float64]:
        """Sum of the coordinates' distances from TARGET, over all points."""
        self.tried.append(code.copy())
        distance: NDArray[np.float64] = np.abs(code - TARGET).sum(axis=(1, 2))
        return distance


def test_velocity_and_place_by_hand() -> None:
    swarm = ParticleSwarm(iterations=3, particles=2, waypoints=1, speed_limit=0.5, own_pull=1.0, swarm_pull=2.0)
    paths = Recorder()
    swarm.search(paths, np.array([[[2.0, 4.0]], [[6.0, 3.0]]]), np.random.default_rng(1))
    rng = np.random.default_rng(1)
    first, second, third = paths.tried
    # No particle moves of its own at first, and each is at its own best; the first one leads, 1 off against 4.
    pulls = rng.random((2, 2, 1, 2))
    assert (second[0] == first[0]).all()
    assert second[1] == pytest.approx(first[1] + np.clip(2.0 * pulls[1, 1] * (first[0] - first[1]), -5.5, 5.5))
    # Then, with the middle one of three inertias.
    off = [np.abs(code[1] - TARGET).sum() for code in (first, second)]
    own, leads = second[1] if off[1] < off[0] else first[1], second[1] if off[1] < 1.0 else first[0]
    pulls = rng.random((2, 2, 1, 2))
    velocity = 0.65 * (second[1] - first[1]) + pulls[0, 1] * (own - second[1]) + 2.0 * pulls[1, 1] * (leads - second[1])
    assert third[1] == pytest.approx(np.clip(second[1] + np.clip(velocity, -5.5, 5.5), 0, 10))


def met(swarm: FishSwarm, places: list[tuple[float, float]], vision: float) -> tuple[np.ndarray, np.ndarray]:
    """Where fish with one way-point each get to by following and swarming."""
    place, paths = np.array(places)[:, None], Recorder()
    new, cost = swarm._meet(paths, place, paths.cost(place), vision, np.random.default_rng(0))
    return new[:, 0], cost


def test_a_fish_follows_the_best_in_sight() -> None:
    # The third fish is out of sight of the others, and the middle of two is no better than the better one.
    swarm = FishSwarm(waypoints=1, crowding=1.0)
    new, cost = met(swarm, [(2.0, 3.0), (2.0, 7.0), (9.0, 9.0)], 5.0)
    assert cost[0] == cost[2] == np.inf
    assert new[1, 0] == 2.0
    assert 3.0 <= new[1, 1] < 7.0
    assert cost[1] == pytest.approx(new[1, 1] - 3.0)


def test_a_fish_swarms_to_the_middle_where_that_is_better() -> None:
    # Around the target, four corners: nobody is better than anybody, but the middle of the three others is.
    corners = [(0.0, 1.0), (0.0, 5.0), (4.0, 1.0), (4.0, 5.0)]
    new, cost = met(FishSwarm(waypoints=1, crowding=1.0), corners, 6.0)
    for k, corner in enumerate(corners):
        middle = np.mean([c for c in corners if c != corner], axis=0)
        way, all_the_way = new[k] - corner, middle - corner
        assert way[0] * all_the_way[1] == pytest.approx(way[1] * all_the_way[0])
        assert 0 < np.linalg.norm(way) <= np.linalg.norm(all_the_way)
        assert cost[k] == np.abs(new[k] - TARGET).sum() < 4.0
