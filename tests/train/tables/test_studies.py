"""All studies: names agree, maps are the same every time and as the papers describe them, claims can be judged."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from tests.train.tables.toy import row
from train.tables.maps import clutter_task, drawn_map
from train.tables.measures import TableFigures
from train.tables.papers import paper001, paper002, paper003, paper004
from train.tables.runner import PAPERS, PLANNERS_STUDY, PapersTable, settings_of, studies_of
from train.tables.study import (
    FAILS,
    HOLDS,
    IN_PART,
    OPEN,
    ClaimVerdict,
    TableSetting,
    TableStudy,
    TableSystem,
    TableTask,
)
from train.tables.verdicts import judge
from warehouse_env.errors import ConfigError

EVERY = [(module, study) for module in (*PAPERS.values(), PLANNERS_STUDY) for study in studies_of(module).values()]


def shortest(task: TableTask) -> float:
    return float(task.grid.distance_to(task.goal)[task.start])


def settings(paper: str, study: str) -> dict[str, TableSetting]:
    return settings_of(PAPERS[paper], study)


@pytest.mark.parametrize(("module", "study"), EVERY, ids=[study.name for _, study in EVERY])
def test_study(module: str, study: TableStudy) -> None:
    built = study.settings()
    names = [setting.name for setting in built]
    assert len(set(names)) == len(names)
    assert {one.setting for one in study.published} | {name for one in study.claims for name in one.settings} <= set(
        names
    )
    for setting, again in zip(built, settings_of(module, study.name).values(), strict=True):
        assert setting.tasks
        for task, same in zip(setting.tasks, again.tasks, strict=True):
            assert (task.grid.key, task.start, task.goal) == (same.grid.key, same.start, same.goal)
            assert math.isfinite(shortest(task))
    for system in study.systems:
        assert system.make().name == system.planner
    empty = [judge(TableFigures(study.name, []), claim).word for claim in study.claims]
    assert set(empty) <= {OPEN}


def test_choosing() -> None:
    names = [study.name for _, study in EVERY]
    assert len(set(names)) == len(names)
    assert {module for module, _ in PapersTable(papers=("000",)).chosen()} == {PAPERS["000"]}
    both = PapersTable(papers=("003",), tables=("000_table_2",)).chosen()
    assert [study.name for _, study in both] == ["000_table_2", "003_table_5", "003_more_maps"]


def verdicts_at(speeds: Sequence[float], module: str, study: TableStudy) -> list[ClaimVerdict]:
    """The verdicts on made-up runs of a study, where each system takes its own milliseconds."""
    rng = np.random.default_rng(0)
    rows = [
        row(setting, system.label, rng.uniform(10, 12), run, number, study=study.name, turn_angle=90.0, clearance=1.0,
            gap=rng.choice([0.0, 0.1]), turns=int(rng.integers(3, 9)), converged_at=int(rng.integers(1, 9)),
            cpu_ms=speed * rng.uniform(1, 1.01))
        for setting in settings_of(module, study.name)
        for system, speed in zip(study.systems, speeds, strict=True)
        for number in range(2)
        for run in range(3)
    ]  # fmt: skip
    return [judge(TableFigures(study.name, rows), claim) for claim in study.claims]


def test_only_verdicts_that_are_not_counted_differ_between_machines() -> None:
    apart = []
    for module, study in EVERY:
        speeds = np.geomspace(1.0, 1000.0, len(study.systems)).tolist()
        both = (verdicts_at(order, module, study) for order in (speeds, speeds[::-1]))
        for one, other in zip(*both, strict=True):
            assert one == other or (one.by_clock and other.by_clock)
            apart += [(one.word, other.word)] if one.by_clock else []
    assert apart == [(HOLDS, FAILS)] * 6


def test_paper_000_has_the_printed_optima() -> None:
    """Path 4's printed 26.6820 is no lattice length, so ours is shorter."""
    optima = [
        shortest(setting.tasks[0])
        for table in ("000_table_1", "000_table_2")
        for setting in settings("000", table).values()
    ]
    assert optima == pytest.approx([26.9706, 26.3848, 27.5563, 26.5563, 59.4264, 62.5980], abs=5e-5)


@pytest.mark.parametrize(
    ("paper", "study", "maps", "ends", "shares"),
    [
        ("001", "001_table_1", paper001.MAPS, ((0, 0), (19, 19)), {"20x20 40%": 0.4, "20x20 40% in blocks": 0.4}),
        ("002", "002_comparison", paper002.MAPS, (paper002.START, paper002.GOAL), {"30x30 20%": 0.2, "30x30 30%": 0.3}),
        ("004", "004_table_2", paper004.MAPS, None, {name: share for name, (_, share) in paper004.SHARES.items()}),
    ],
)
def test_random_floors_have_the_size_share_and_ends_of_the_paper(
    paper: str, study: str, maps: int, ends: Any, shares: dict[str, float]
) -> None:
    found = settings(paper, study)
    assert list(found) == list(shares)
    for name, share in shares.items():
        side = int(name[:2])
        assert len({task.grid.key for task in found[name].tasks}) == maps
        for grid, start, goal, _ in found[name].tasks:
            assert grid.shape == (side, side)
            assert grid.occupied.sum() == round(share * side * side)
            assert (start, goal) == (ends or ((0, 0), (side - 1, side - 1)))


def test_paper_003_has_obstacles_that_trap_and_other_maps() -> None:
    found = settings("003", "003_table_5")
    for name in paper003.TRAPS:  # some cell inside is nearer to the goal than its neighbours, but far by path
        grid, _, goal, _ = found[name].tasks[0]
        rows, columns = np.indices(grid.shape)
        far = np.where(grid.occupied, np.inf, np.hypot(rows - goal[0], columns - goal[1]))
        row, column = np.unravel_index(np.argmin(far[4:16, 6:13]), (12, 7))
        row, column = row + 4, column + 6
        assert far[row, column] == far[row - 1 : row + 2, column - 1 : column + 2].min()
        assert grid.distance_to(goal)[row, column] > 2 * far[row, column]
    every = (*found.values(), *settings("003", "003_more_maps").values())
    assert len({task.grid.key for setting in every for task in setting.tasks}) == 4 + 24


def test_paper_004_has_floors_of_the_printed_lengths() -> None:
    table = studies_of(PAPERS["004"])["004_table_1"]
    for name, setting in settings("004", table.name).items():
        assert len({task.grid.key for task in setting.tasks}) == paper004.MAPS
        assert [shortest(task) for task in setting.tasks] == pytest.approx([paper004.OPTIMA[name]] * paper004.MAPS)
    printed = {p.setting: p.value for p in table.published if p.measure == "best_line_length" and not p.ours}
    assert {setting: paper004.OPTIMA[setting] for setting in printed} == pytest.approx(printed, abs=5e-3)


def test_paper_004_judges_optima_and_printed_figures() -> None:
    def figures(gaps: list[float], converged: int = 1) -> TableFigures:
        about = {"study": "t", "setting": paper004.BLOCKS_20, "system": paper004.OURS, "success": True}
        return TableFigures(
            "t",
            [about | {"number": k // 2, "run": k % 2, "gap": gap, "converged_at": converged}
             for k, gap in enumerate(gaps)],
        )  # fmt: skip

    assert paper004.finds_optimum(figures([0, 0.1, 0.2, 0]), paper004.OURS).word == HOLDS
    one = paper004.finds_optimum(figures([0, 0.1, 0.2, 0.1]), paper004.OURS)
    assert (one.word, one.why) == (FAILS, f"{paper004.BLOCKS_20}: on 1 of 2 maps")
    words = [
        paper004.below_print(figures([0] * 4, at), paper004.BLOCKS_20, "converged_at", 5.0, -0.5).word
        for at in (2, 3, 6)
    ]
    assert words == [HOLDS, IN_PART, FAILS]


PRINTED_CONSTANTS = {
    "001_table_1": {"ants": 50, "iterations": 100, "evaporation": 0.4},
    "002_comparison": {"ants": 100, "exponent": 3, "evaporation": 0.5, "strength": 1.0},
}


def test_colonies_have_the_printed_constants() -> None:
    systems = {study.name: study.systems for _, study in EVERY}
    made = [(system.make(), PRINTED_CONSTANTS[name]) for name in PRINTED_CONSTANTS for system in systems[name]
            if "aco" in system.planner]  # fmt: skip
    iaco = next(system for system in paper004.SYSTEMS if system.label == paper004.PRINTED)
    constants = {"ants": 20, "iterations": 20, "exponent": 7, "strength": 100.0, "scale": 10.0, "evaporation": 5.0}
    for planner, printed in [*made, (iaco.make(), constants)]:
        assert {name: getattr(planner, name) for name in printed} == printed


@pytest.mark.parametrize(
    ("systems", "setting", "number", "arrive"),
    [
        (paper001.STUDIES[1].systems, paper001.BESIDE, 3, ["apf", "apf_improved (001)",
         "apf_improved (001), strong repulsion", "dijkstra"]),
        (paper002.STUDIES[1].systems, paper001.IN_FRONT, 4, ["apf_improved, intermediate point only",
         "apf_improved (002)", "dijkstra"]),
    ],
)  # fmt: skip
def test_walkers_arrive_where_their_repair_helps(
    systems: tuple[TableSystem, ...], setting: str, number: int, arrive: list[str]
) -> None:
    grid, start, goal, _ = settings("001", "001_walkers")[setting].tasks[number]
    rng = np.random.default_rng(0)
    assert [one.label for one in systems if one.make().plan(grid, start, goal, rng).found] == arrive


def test_the_shipped_shaa_acs_is_optimal_and_the_papers_is_at_the_traps() -> None:
    systems = {system.label: system.make() for system in paper003.SYSTEMS}
    for setting in settings("003", "003_table_5").values():
        task = setting.tasks[0]
        for label in (paper003.SHIPPED, paper003.OURS) if setting.name in paper003.TRAPS else (paper003.SHIPPED,):
            plan = systems[label].plan(task.grid, task.start, task.goal, np.random.default_rng(0))
            assert plan.best_by_iteration[-1] == pytest.approx(shortest(task))


def test_bad_maps_are_refused() -> None:
    with pytest.raises(ConfigError, match="no room"):
        clutter_task(4, 0.95, 0)
    assert drawn_map("..#\n#..", "drawing").occupied.tolist() == [[False, False, True], [True, False, False]]
    for wrong in ("..\n.", ".x\n..", ""):
        with pytest.raises(ConfigError, match="drawing"):
            drawn_map(wrong, "drawing")
