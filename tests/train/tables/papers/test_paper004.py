"""The tables of paper 004: floors as described, figures as printed, claims that can be judged."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import pytest

from train.tables.measures import Figures
from train.tables.papers.paper004 import (
    BLOCKS_20,
    MAPS,
    OPTIMA,
    OURS,
    PRINTED,
    SHARES,
    STUDIES,
    SYSTEMS,
    below_print,
    finds_optimum,
    literature,
    shares,
)
from train.tables.study import FAILS, HOLDS, IN_PART, OPEN, Setting
from train.tables.verdicts import judge

TABLE_1, *_ = STUDIES


@cache
def floors() -> tuple[Setting, ...]:
    return literature()


def test_floors_of_table_1_have_the_shortest_length_of_the_references() -> None:
    assert [setting.name for setting in floors()] == list(OPTIMA)
    for setting in floors():
        assert len({task.grid.key for task in setting.tasks}) == MAPS
        for task in setting.tasks:
            side = int(setting.name[:2])
            assert task.grid.shape == (side, side)
            assert (task.start, task.goal) == ((0, 0), (side - 1, side - 1))
            assert task.grid.distance_to(task.goal)[task.start] == pytest.approx(OPTIMA[setting.name])
    again = literature()
    assert [t.grid.key for s in again for t in s.tasks] == [t.grid.key for s in floors() for t in s.tasks]


def test_printed_bests_of_the_references_are_those_lengths() -> None:
    printed = {p.setting: p.value for p in TABLE_1.published if p.measure == "best_line_length" and not p.ours}
    assert {setting: OPTIMA[setting] for setting in printed} == pytest.approx(printed, abs=5e-3)


def test_floors_of_tables_2_and_3_have_the_shares() -> None:
    for setting, (name, (size, share)) in zip(shares(), SHARES.items(), strict=True):
        assert setting.name == name
        for task in setting.tasks:
            assert task.grid.occupied.sum() == round(share * size * size)
            assert math.isfinite(task.grid.distance_to(task.goal)[task.start])


def test_the_paper_s_colony_has_its_constants() -> None:
    made = {system.label: system.make() for system in SYSTEMS}
    printed: Any = made[PRINTED]
    assert (printed.ants, printed.iterations, printed.exponent, printed.strength) == (20, 20, 7, 100.0)
    assert (printed.scale, printed.evaporation, printed.deviation, printed.tension) == (10.0, 5.0, 0.5, 0.5)


@pytest.mark.parametrize("study", STUDIES, ids=lambda study: study.name)
def test_claims_of_a_study_without_rows_are_open(study: Any) -> None:
    assert study.claims
    assert all(judge(Figures(study.name, []), claim).word == OPEN for claim in study.claims)


def rows(gaps: list[float], converged: list[int]) -> list[dict[str, Any]]:
    """Rows of our system on two maps of one setting, two runs each."""
    return [
        {
            "study": "004_table_1", "setting": BLOCKS_20, "system": OURS, "number": k // 2, "run": k % 2,
            "success": True, "gap": gap, "converged_at": at,
        }
        for k, (gap, at) in enumerate(zip(gaps, converged, strict=True))
    ]  # fmt: skip


def test_the_optimum_must_be_found_on_every_map() -> None:
    assert finds_optimum(Figures(TABLE_1.name, rows([0, 0.1, 0.2, 0], [1] * 4)), OURS).word == HOLDS
    verdict = finds_optimum(Figures(TABLE_1.name, rows([0, 0.1, 0.2, 0.1], [1] * 4)), OURS)
    assert verdict.word == FAILS
    assert verdict.why == f"{BLOCKS_20}: on 1 of 2 maps"


def test_figures_against_print() -> None:
    def word(converged: list[int], printed: float, by: float) -> str:
        return below_print(Figures(TABLE_1.name, rows([0] * 4, converged)), BLOCKS_20, "converged_at", printed, by).word

    assert word([2, 2, 2, 2], 5.0, -0.5) == HOLDS
    assert word([3, 3, 3, 3], 5.0, -0.5) == IN_PART
    assert word([6, 6, 6, 6], 5.0, -0.5) == FAILS
