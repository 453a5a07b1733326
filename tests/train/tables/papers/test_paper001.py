"""The table of paper 001: its maps are as the text says, its figures are the printed ones, its claims can be judged."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np

from train.tables.measures import Figures
from train.tables.papers import paper001
from train.tables.papers.paper001 import BESIDE, IN_BLOCKS, MAPS, SCATTERED, STUDIES
from train.tables.study import OPEN, Setting, Study
from train.tables.verdicts import judge
from warehouse_env.planning import path_length

TABLE, WALKERS, _ = STUDIES


@cache
def settings_of(build: Callable[[], tuple[Setting, ...]]) -> tuple[Setting, ...]:
    return build()


def settings(study: Study = TABLE) -> tuple[Setting, ...]:
    """The maps of a study, built once for all tests."""
    return settings_of(study.settings)


def test_maps_have_the_size_the_share_and_the_corners_of_the_paper() -> None:
    groups = settings()
    assert [setting.name for setting in groups] == [SCATTERED, IN_BLOCKS]
    for setting in groups:
        assert len(setting.tasks) == MAPS
        assert len({task.grid.key for task in setting.tasks}) == MAPS
        for task in setting.tasks:
            assert task.grid.shape == (20, 20)
            assert task.grid.occupied.sum() == 160  # free to occupied as 6 to 4
            assert (task.start, task.goal) == ((0, 0), (19, 19))
            assert math.isfinite(task.grid.distance_to(task.goal)[task.start])


def test_blocks_hang_together_more_than_single_cells() -> None:
    def neighbours(index: int) -> float:
        grids = [task.grid.occupied for task in settings()[index].tasks]
        return float(np.mean([(grid[:, 1:] & grid[:, :-1]).sum() for grid in grids]))

    assert neighbours(1) > 1.4 * neighbours(0)


def test_colonies_have_the_printed_constants() -> None:
    for system in TABLE.systems:
        planner = system.make()
        if "aco" in system.planner:
            assert (planner.ants, planner.iterations, planner.evaporation) == (50, 100, 0.4)
    ours = next(s.make() for s in TABLE.systems if s.label == paper001.OURS)
    traditional = next(s.make() for s in TABLE.systems if s.label == paper001.TRADITIONAL)
    assert traditional.strength == ours.evaporation * ours.strength
    assert (ours.dead_end, traditional.dead_end) == ("die", "die")


def test_a_shelf_stands_behind_the_goal_and_across_the_way() -> None:
    groups = {setting.name: setting for setting in settings(WALKERS)}
    for task in groups[BESIDE].tasks:
        assert task.grid.occupied[task.goal[0] - 1, task.goal[1]]
    for task in groups[paper001.IN_FRONT].tasks:
        assert task.start[1] == task.goal[1]
        assert task.grid.occupied[1:18, task.start[1]].sum() == 1


def test_what_the_paper_leaves_out_stands_open() -> None:
    verdicts = [judge(Figures(TABLE.name, []), claim) for claim in TABLE.claims if claim.check is not None]
    assert [verdict.word for verdict in verdicts] == [OPEN]


def test_the_walkers_on_the_first_maps() -> None:
    made = {system.label: system.make() for system in WALKERS.systems}
    beside = settings(WALKERS)[0].tasks[3]
    rng = np.random.default_rng(0)
    found = {label: planner.plan(beside.grid, beside.start, beside.goal, rng) for label, planner in made.items()}
    assert [label for label, plan in found.items() if not plan.found] == ["apf, strong repulsion"]
    assert path_length(found[paper001.REPAIRED].cells) == 17
