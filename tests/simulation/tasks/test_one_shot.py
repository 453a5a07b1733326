"""Well-formed tasks: no body parked at a goal parts another robot from its own; against a plain search."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.simulation.worlds import drawn
from warehouse_env.config import EnvConfig
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.one_shot import OneShotTasks
from warehouse_env.simulation.tasks.well_formed import cut_off, disc_of

ONE_SHOT = EnvConfig(tasks="one_shot")
DISC = disc_of(ONE_SHOT, 1.0)


def plain_cut_off(grid: GridMap, starts: np.ndarray, goals: np.ndarray) -> list[bool]:
    """For each robot: occupy the discs of all others' goals, and ask the map for the way."""
    result = []
    for k in range(len(goals)):
        occupied = grid.occupied.copy()
        for j, goal in enumerate(goals):
            cells = goal + DISC
            inside = ((cells >= 0) & (cells < grid.shape)).all(axis=1)
            if j != k:
                occupied[tuple(cells[inside].T)] = True
        if occupied[tuple(starts[k])] or occupied[tuple(goals[k])]:
            result.append(True)
            continue
        left = GridMap(occupied)
        result.append(not np.isfinite(left.distance_to(tuple(goals[k].tolist()))[tuple(starts[k])]))
    return result


def test_the_disc_holds_every_parked_body() -> None:
    # 0.5 m of arrival, 0.808 m from the axle to a rear corner, 0.3 m of the passing body and 0.05 m: 1.658 m.
    assert sorted((DISC**2).sum(axis=1).tolist()) == [0, 1, 1, 1, 1, 2, 2, 2, 2]
    assert len(disc_of(ONE_SHOT, 0.5)) == sum(r * r + c * c < 3.316**2 for r in range(-4, 5) for c in range(-4, 5))


@settings(max_examples=60)
@given(st.integers(0, 10**6))
def test_cut_off_is_what_a_plain_search_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = GridMap(rng.random((9, 12)) < 0.3)
    free = grid.free_cells
    chosen = rng.permutation(len(free))
    count = int(rng.integers(2, 5))
    starts, goals = free[chosen[:count]], free[chosen[count : 2 * count]]
    assert cut_off(grid, starts, goals, DISC).tolist() == plain_cut_off(grid, starts, goals)


@pytest.mark.parametrize(("layout", "robots"), [("paper46", 32), ("narrow", 16), ("single_lane", 8), ("open", 16)])
def test_tasks_are_well_formed(layout: str, robots: int) -> None:
    grid = make_layout(layout)
    tasks = OneShotTasks(grid, ONE_SHOT.replace(num_agents=robots))
    for seed in range(3):
        key = np.array([seed, 0, 0], np.uint64)
        tasks.reset(key)
        starts = tasks.starts(key)[:robots]
        goals = tasks.first_goals(starts, key)
        assert len(set(goals)) == robots
        assert all(start != goal for start, goal in zip(starts, goals, strict=True))
        assert tasks.cut_off() == 0
        assert not any(plain_cut_off(grid, np.array(starts), np.array(goals)))


def test_a_floor_too_small_says_so() -> None:
    # Nine goals whose discs cover no other goal are every second cell of 5 x 5; all about the middle one is shared.
    tasks = OneShotTasks(drawn(["....."] * 5), ONE_SHOT.replace(num_agents=9))
    key = np.zeros(3, np.uint64)
    tasks.reset(key)
    goals = tasks.first_goals(tasks.starts(key)[:9], key)
    assert tasks.cut_off() > 0
    assert len(set(goals)) == 9


def test_lifelong_robots_park_nowhere() -> None:
    simulator = Simulator(EnvConfig(num_agents=2, planner="astar"), grid=drawn(["......"] * 6))
    simulator.reset(seed=0)
    assert np.isnan(simulator.episode_metrics()["cut_off"])
