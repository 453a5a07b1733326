"""All studies of the papers: their names agree, their maps are the same every time and have a way."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from tests.train.tables.toy import row
from train.tables.command import MODULES, chosen, settings_of
from train.tables.maps import clutter, clutter_task, drawn_map
from train.tables.measures import Figures
from train.tables.study import FAILS, HOLDS, Study, Verdict
from train.tables.verdicts import judge
from warehouse_env.errors import ConfigError

EVERY = chosen((), ())


@pytest.mark.parametrize(("module", "study"), EVERY, ids=[study.name for _, study in EVERY])
def test_study(module: str, study: Study) -> None:
    settings = study.settings()
    names = [setting.name for setting in settings]
    assert len(set(names)) == len(names)
    named = {one.setting for one in study.published} | {name for claim in study.claims for name in claim.settings}
    assert named | set(study.pictured) <= set(names)
    assert study.runs >= 1
    assert study.measures
    for setting, again in zip(settings, settings_of(module, study.name).values(), strict=True):
        assert setting.tasks
        for task, same in zip(setting.tasks, again.tasks, strict=True):
            assert (task.grid.key, task.start, task.goal) == (same.grid.key, same.start, same.goal)
            assert math.isfinite(float(task.grid.distance_to(task.goal)[task.start]))
    for system in study.systems:
        assert system.make().name == system.planner


def verdicts_at(speeds: Sequence[float], module: str, study: Study) -> list[Verdict]:
    """The verdicts on made-up runs of a study, where each system takes its own milliseconds."""
    rng = np.random.default_rng(0)
    rows = [
        row(setting, system.label, rng.uniform(10, 12), run, number, study=study.name, turn_angle=90.0, clearance=1.0,
            gap=rng.choice([0.0, 0.1]), turns=int(rng.integers(3, 9)), converged_at=int(rng.integers(1, 9)),
            cpu_ms=speed * rng.uniform(1, 1.01), last=rng.uniform(10, 12), contacts=0.0, apart=rng.uniform(1, 2))
        for setting in settings_of(module, study.name)
        for system, speed in zip(study.systems, speeds, strict=True)
        for number in range(2)
        for run in range(3)
    ]  # fmt: skip
    return [judge(Figures(study.name, rows), claim) for claim in study.claims]


def test_only_verdicts_that_are_not_counted_differ_between_machines() -> None:
    """Every claim of the papers, judged where the first systems are the quick ones and where they are the slow ones."""
    apart = []
    for module, study in EVERY:
        speeds = np.geomspace(1.0, 1000.0, len(study.systems)).tolist()
        for one, other in zip(
            verdicts_at(speeds, module, study), verdicts_at(speeds[::-1], module, study), strict=True
        ):
            assert one == other or (one.by_clock and other.by_clock)
            apart += [(one.word, other.word)] if one.by_clock else []
    assert apart == [(HOLDS, FAILS)] * 6


def test_names_of_studies_are_unique() -> None:
    names = [study.name for _, study in EVERY]
    assert len(set(names)) == len(names)


def test_choosing() -> None:
    assert {module for module, _ in chosen(("000",), ())} == {MODULES["000"]}
    assert [study.name for _, study in chosen((), ("000_table_2",))] == ["000_table_2"]
    assert [study.name for _, study in chosen(("003",), ("000_table_2",))][::3] == ["000_table_2"]


def test_paper_000_has_the_printed_optima() -> None:
    """Its tasks are chosen by the printed best lengths; path 4's is no lattice length, so ours is shorter."""
    optima = {}
    for module, study in chosen(("000",), ()):
        for name, setting in settings_of(module, study.name).items():
            task = setting.tasks[0]
            optima[study.name, name] = float(task.grid.distance_to(task.goal)[task.start])
    printed = [26.9706, 26.3848, 27.5563, 26.5563, 59.4264, 62.5980]
    assert list(optima.values()) == pytest.approx(printed, abs=5e-5)
    assert 11 + 11 * math.sqrt(2) == pytest.approx(26.5563, abs=5e-5)


def test_clutter_has_the_share_and_a_way() -> None:
    setting = clutter(20, 0.35, 3)
    assert setting.name == "20x20 35%"
    keys = {task.grid.key for task in setting.tasks}
    assert len(keys) == 3
    for task in setting.tasks:
        assert task.grid.occupied.sum() == 140
        assert (task.start, task.goal) == ((0, 0), (19, 19))
        assert math.isfinite(float(task.grid.distance_to(task.goal)[task.start]))
    assert clutter_task(20, 0.35, 1).grid.key == setting.tasks[1].grid.key
    assert clutter_task(9, 0.2, 0, (1, 1), (8, 3)).start == (1, 1)


def test_clutter_that_leaves_no_room_is_refused() -> None:
    with pytest.raises(ConfigError, match="no room"):
        clutter_task(4, 0.95, 0)


def test_drawn_map() -> None:
    grid = drawn_map("""
        ..#
        #..
    """, "drawing")  # fmt: skip
    assert grid.occupied.tolist() == [[False, False, True], [True, False, False]]
    for wrong in ("..\n.", ".x\n..", ""):
        with pytest.raises(ConfigError, match="drawing"):
            drawn_map(wrong, "drawing")
