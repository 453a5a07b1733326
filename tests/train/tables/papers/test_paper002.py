"""What paper 002 compares: its maps and constants are those of the text, and each claim can be judged."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from train.tables.papers.paper002 import MAPS, SHARES, STUDIES
from train.tables.study import Setting, Study

COMPARISON, WALKERS, _ = STUDIES


@cache
def settings_of(build: Callable[[], tuple[Setting, ...]]) -> tuple[Setting, ...]:
    return build()


def settings(study: Study = COMPARISON) -> tuple[Setting, ...]:
    """The maps of a study, built once for all tests."""
    return settings_of(study.settings)


def test_maps_have_the_size_and_the_ends_of_the_paper() -> None:
    groups = settings()
    assert len(groups) == len(SHARES)
    for setting, share in zip(groups, SHARES, strict=True):
        assert len(setting.tasks) == MAPS
        for task in setting.tasks:
            assert task.grid.shape == (30, 30)
            assert task.grid.occupied.mean() == pytest.approx(share)
            assert (task.start, task.goal) == ((0, 0), (29, 27))  # (1, 1) and (30, 28), counted from 1
            assert math.isfinite(task.grid.distance_to(task.goal)[task.start])


def test_colonies_have_the_printed_constants() -> None:
    for system in COMPARISON.systems:
        planner = system.make()
        if "aco" in system.planner:
            assert (planner.ants, planner.exponent, planner.evaporation, planner.strength) == (100, 3, 0.5, 1.0)
        if system.planner == "fusion_aco":
            assert planner.trail_exponent == 1.5


def test_only_the_intermediate_point_leads_round_a_shelf() -> None:
    task = settings(WALKERS)[1].tasks[4]
    rng = np.random.default_rng(0)
    found = {s.label: s.make().plan(task.grid, task.start, task.goal, rng).found for s in WALKERS.systems}
    assert [label for label, arrived in found.items() if arrived] == [
        "apf_improved, intermediate point only",
        "apf_improved (002)",
        "dijkstra",
    ]
