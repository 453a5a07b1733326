"""Every layout keeps the catalogue's promises, and the named tasks have exactly the lengths of paper 000."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import LAYOUTS, NAMED_TASKS, make_layout


@pytest.fixture(scope="module", params=sorted(LAYOUTS))
def layout(request: pytest.FixtureRequest) -> GridMap:
    return make_layout(request.param)


def near(cells: np.ndarray, others: np.ndarray, distance: int) -> bool:
    """Is any cell closer than `distance` (king's moves) to any of the others, itself left out?"""
    apart = np.abs(cells[:, None] - others[None]).max(axis=2)
    return bool(((apart < distance) & (apart > 0)).any())


# ---- the contract of every layout


def test_the_floor_is_connected_and_its_endpoints_are_distinct_and_enough_for_64_robots(layout: GridMap) -> None:
    assert len(layout.free_cells) == (~layout.occupied).sum()
    endpoints = np.concatenate([layout.picks, layout.stations])
    assert len(np.unique(endpoints, axis=0)) == len(endpoints)
    assert len(layout.picks) >= 64
    assert len(layout.stations) >= 20
    assert np.isfinite(layout.distance_to(tuple(layout.stations[0]))[tuple(endpoints.T)]).all()
    assert not near(layout.stations, layout.stations, 3)
    assert layout.name == "random" or not near(layout.picks, layout.stations, 2)


@pytest.mark.parametrize("name", sorted(LAYOUTS))
def test_names_agree_and_floors_are_reproducible(name: str) -> None:
    first, second = make_layout(name), make_layout(name)
    assert first.name == name
    assert (first.key, first.endpoints) == (second.key, second.endpoints)


# ---- named tasks


@pytest.mark.parametrize(("name", "task"), [(n, t) for n, tasks in NAMED_TASKS.items() for t in tasks])
def test_named_tasks_have_their_length(name: str, task: str) -> None:
    start, goal, length = NAMED_TASKS[name][task]
    grid = make_layout(name)
    assert grid.distance_to(goal)[start] == pytest.approx(length, abs=1e-12)
    assert grid.distance_to(start)[goal] == pytest.approx(length, abs=1e-12)


@pytest.mark.parametrize("task", sorted(NAMED_TASKS["paper46_rough"]))
def test_rough_ground_is_on_the_straight_route_and_a_gentle_one_costs_little(task: str) -> None:
    grid = make_layout("paper46_rough")
    start, goal, length = NAMED_TASKS["paper46_rough"][task]
    straight = np.linspace(start, goal, int(length) + 1).astype(int)
    raised = (grid.height[tuple(straight.T)] > 0).sum()
    assert raised >= 10
    gentle = GridMap(grid.occupied | (grid.height > 0)).distance_to(goal)[start]
    assert length < gentle <= 1.08 * length


# ---- what each layout is


def test_paper46_has_four_zones_wide_corridors_and_aisles_of_at_least_two() -> None:
    grid = make_layout("paper46")
    assert grid.shape == (46, 46)
    assert not grid.height.any()
    assert not grid.occupied[20:26].any()
    assert not grid.occupied[:, 20:26].any()
    for rows, columns in itertools.product((slice(0, 20), slice(26, 46)), repeat=2):
        assert grid.occupied[rows, columns].sum() == 4 * 3 * 6
    assert not (set(free_gaps(grid.occupied)) | set(free_gaps(grid.occupied.T))) & {1}


def free_gaps(occupied: np.ndarray) -> list[int]:
    """The lengths of all runs of free cells along the rows."""
    return [len(run) for row in occupied for run in "".join("#" if o else "." for o in row).split("#") if run]


# ---- bad input


@pytest.mark.parametrize(
    ("name", "parameters", "words"),
    [
        ("papr46", {}, "unknown layout 'papr46'; did you mean paper46"),
        ("", {}, "known: aisles, blocks"),
        ("blocks", {"rowz": 3}, "did you mean rows"),
        ("blocks", {"rows": 2}, "rows=2 must be a whole number of at least 3"),
        ("blocks", {"rows": 20, "columns": 10}, "no room"),
        ("single_lane", {"rim": 2}, "rim=2"),
        ("random", {"share": 0.61}, "share"),
        ("random", {"seed": -1}, "seed=-1"),
    ],
)
def test_bad_parameters_are_named(name: str, parameters: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        make_layout(name, **parameters)
