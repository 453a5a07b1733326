"""The fish swarm: its vision and its behaviours by hand, and what it reaches."""

from __future__ import annotations

import numpy as np
import pytest

from tests.planning.swarms.recorder import TARGET, Recorder
from warehouse_env.planning.swarms.fish_swarm import FishSwarm


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
