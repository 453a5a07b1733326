"""Test figures and verdicts against values computed by hand."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from tests.train.tables.conftest import row
from train.tables.catalogue import studies_of
from train.tables.measures import MEASURES, TableFigures
from train.tables.study import FAILS, HOLDS, IN_PART, OPEN, Claim, ClaimVerdict, PrintedLine
from train.tables.verdicts import judge, percent, verdict_counts
from warehouse_env.errors import ConfigError


def figures(*rows: dict[str, Any]) -> TableFigures:
    return TableFigures("toy", rows)


def runs(system: str, lengths: list[float | None], setting: str = "open", number: int = 0) -> list[dict[str, Any]]:
    return [row(setting, system, length, run, number) for run, length in enumerate(lengths)]


def test_interval_of_one_map_is_over_runs() -> None:
    """Lengths 10, 11, 12: mean 11, standard error 1/sqrt 3, t(2) = 4.3027."""
    found = figures(*runs("ants", [10.0, 11.0, 12.0])).figure("open", "ants", "mean")
    assert (found.mean, found.samples) == (11.0, 3)
    assert found.high - found.mean == pytest.approx(4.302653 / math.sqrt(3), rel=1e-5)


def test_interval_of_several_maps_is_over_maps() -> None:
    """Means 11 and 13 of two maps: t(1) = 12.7062 times the standard error 1; never below zero."""
    rows = [*runs("ants", [10.0, 12.0], number=0), *runs("ants", [13.0, 13.0], number=1)]
    found = figures(*rows).figure("open", "ants", "mean")
    assert (found.mean, found.samples) == (12.0, 2)
    assert (found.low, found.high) == (0.0, pytest.approx(12.0 + 12.7062, rel=1e-5))


def test_share_of_all_runs_has_an_interval() -> None:
    """Wilson at 10 of 10: 10 / (10 + 1.96^2) = 0.7225. Runs without a path count in shares, not in means."""
    found = figures(*runs("ants", [10.0] * 10)).figure("open", "ants", "optimal_share")
    assert (found.mean, found.high) == (1.0, 1.0)
    assert found.low == pytest.approx(0.7225, abs=1e-4)
    known = figures(*runs("ants", [10.0, None, 12.0, None]))
    wanted = {"mean": 11.0, "found_share": 0.5, "optimal_share": 0.25}
    assert {name: known.figure("open", "ants", name).mean for name in wanted} == wanted


@pytest.mark.parametrize(
    ("measure", "wanted"),
    [
        ("best", [9.0]),
        ("worst", [14.0]),
        ("best_of_10", [9.0, 10.0]),
        ("best_of_10_turns", [4.0, 3.0]),
        ("sd", [math.sqrt((1.15**2 + 18 * 0.15**2 + 3.85**2) / 19)]),
    ],
)
def test_measures_over_runs(measure: str, wanted: list[float]) -> None:
    """Twenty runs: one of 9 with four turns, one of 14, all others of 10; the mean is 10.15."""
    lengths = [9.0, *[10.0] * 18, 14.0]
    rows = [
        {**row("open", "ants", length, run), "turns": 4 if length == 9.0 else 3} for run, length in enumerate(lengths)
    ]
    assert MEASURES[measure].samples(rows) == pytest.approx(wanted)


def claim(by: float | None = None, measure: str = "mean", **more: Any) -> Claim:
    return Claim("a claim", "ants", "dijkstra", measure, by, **more)


def verdict(ours: list[float | None], other: list[float | None], one: Claim) -> str:
    return judge(figures(*runs("ants", ours), *runs("dijkstra", other)), one).word


NEAR_EIGHT: list[float | None] = [7.9, 8.0, 8.1, 8.0]
NEAR_TEN: list[float | None] = [9.9, 10.0, 10.1, 10.0]


@pytest.mark.parametrize(
    ("ours", "other", "one", "word"),
    [
        (NEAR_EIGHT, NEAR_TEN, claim(), "holds"),
        (NEAR_EIGHT, NEAR_TEN, claim(-0.2), "holds"),
        (NEAR_EIGHT, NEAR_TEN, claim(-0.5), "holds in part"),
        (NEAR_TEN, NEAR_EIGHT, claim(), "does not hold"),
        ([8.0, 12.0], [9.0, 12.0], claim(), "does not hold"),
        ([8.0] * 3, [10.0] * 3, claim(-0.2), "holds"),
        ([10.0] * 3, [10.0] * 3, claim(), "does not hold"),
        ([None] * 3, [10.0] * 3, claim(), "undecided"),
        ([10.0] * 8, [12.0] * 8, claim(measure="optimal_share"), "holds"),
        ([10.0] * 8, [12.0] * 8, claim(0.5, "optimal_share"), "holds"),
        ([12.0] * 8, [10.0] * 8, claim(measure="optimal_share"), "does not hold"),
        ([8.0, 8.0, 8.1, 8.0] * 5, [8.0, 12.0, 16.0, 8.0] * 5, claim(measure="sd"), "holds"),
    ],
)
def test_verdicts_by_hand(ours: list[float | None], other: list[float | None], one: Claim, word: str) -> None:
    assert verdict(ours, other, one) == word


def test_claim_that_holds_in_one_of_two_settings_holds_in_part() -> None:
    rows = [
        *runs("ants", NEAR_EIGHT), *runs("dijkstra", NEAR_TEN),
        *runs("ants", NEAR_TEN, "shelves"), *runs("dijkstra", NEAR_TEN, "shelves"),
    ]  # fmt: skip
    assert judge(figures(*rows), claim()).word == "holds in part"
    assert judge(figures(*rows), claim(settings=("open",))).word == "holds"
    assert judge(figures(*rows), claim(settings=("nowhere",))).word == "undecided"


def test_maps_are_compared_in_pairs() -> None:
    """Maps differ far more than systems, but on each of four maps the difference is 1."""
    rows = []
    for number, length in enumerate((10.0, 20.0, 30.0, 40.0)):
        rows += [*runs("ants", [length - 1], number=number), *runs("dijkstra", [length], number=number)]
    known = figures(*rows)
    assert known.difference("open", "ants", "dijkstra", "mean")[:3] == (-1.0, -1.0, -1.0)
    assert judge(known, claim()).word == "holds"
    assert known.relative("open", "ants", "dijkstra", "mean").mean == pytest.approx(-1 / 25)


def test_claims_on_milliseconds_are_marked_and_counted_apart() -> None:
    claims = (claim(), claim(measure="ms"))

    def judged(ms: float) -> list[ClaimVerdict]:
        known = figures(row("open", "ants", 9.0, cpu_ms=ms), row("open", "dijkstra", 10.0, cpu_ms=2.0))
        return [judge(known, one) for one in claims]

    quick, slow = judged(1.0), judged(3.0)
    assert [[verdict.word for verdict in verdicts] for verdicts in (quick, slow)] == [[HOLDS, HOLDS], [HOLDS, FAILS]]
    assert verdict_counts(quick) == verdict_counts(slow)
    assert verdict_counts(quick).startswith("Of 1 claims 1 hold, 0 hold in part and 0 do not hold.")
    assert quick[1] == ("holds", "open: 1 against 2, -50.0%", True)
    assert quick[1].shown == "**holds**, by this machine's clock"


def test_verdict_states_figures_and_failures() -> None:
    why = judge(figures(*runs("ants", [8.0, 8.0]), *runs("dijkstra", [10.0, None])), claim()).why
    assert why == "open: 8 against 10 (found 50%), -20.0%"


def test_verdict_names_printed_figures_not_reached() -> None:
    printed = (
        PrintedLine("open", "theirs", {"mean": 10.0, "turns": 2, "ms": 0.1}, "ants"),  # ms: from another machine
        PrintedLine("open", "theirs", {"mean": 1.0}),  # no system of ours beside it
    )
    known = figures(*runs("ants", [9.0, 10.99]))
    found = judge(known, Claim("reached", "ants", check="reaches_print"), printed)
    assert found.word == "holds in part"
    assert found.why == "1 of 2 figures reached; not: open, turns: 3 against 2 in print"


def test_best_of_all_runs_must_reach_the_optimum() -> None:
    def found(*lengths: float) -> ClaimVerdict:
        rows = [row("open", "ants", length, run % 2, run // 2) for run, length in enumerate(lengths)]
        return judge(figures(*rows), Claim("finds it", "ants", check="finds_optimum"))

    assert found(10.0, 11.0, 12.0, 10.0).word == HOLDS
    assert found(10.0, 11.0, 12.0, 11.0)[:2] == (FAILS, "open: on 1 of 2 maps")


@pytest.mark.parametrize(("length", "word"), [(2.0, HOLDS), (3.0, IN_PART), (6.0, FAILS)])
def test_figure_is_compared_with_a_share_of_the_printed_one(length: float, word: str) -> None:
    below = Claim("half", "ants", "", "mean", -0.5, ("open",), "below_print", printed=5.0)
    assert judge(figures(*runs("ants", [length] * 4)), below).word == word


def test_a_cost_is_judged_by_the_upper_end_of_its_interval() -> None:
    small = Claim("small", "ants", "dijkstra", "mean", 0.015521, ("open",), "costs_at_most")

    def judged(*costs: float) -> tuple[str, str]:
        rows = [row("open", "dijkstra", 100.0, 0, k) for k in range(len(costs))]
        rows += [row("open", "ants", 100.0 * (1 + cost), 0, k) for k, cost in enumerate(costs)]
        return judge(figures(*rows), small)[:2]

    assert judged(0.015) == (HOLDS, "open: +1.5%")
    assert judged(0.016)[0] == FAILS
    assert judged(0.01, 0.011, 0.012)[0] == HOLDS
    assert judged(0.0, 0.0, 0.03)[0] == FAILS  # mean 1%, but 5% is within the interval
    assert judged()[0] == OPEN


def test_all_robots_must_arrive_untouched() -> None:
    rows = [*runs("ants", [9.0, 9.0]), *runs("ants", [9.0, None], "shelves")]

    def judged(rows: list[dict[str, Any]], *settings: str) -> ClaimVerdict:
        return judge(figures(*rows), Claim("all", "ants", settings=settings, check="resolves_all"))

    assert judged(rows, "open").word == HOLDS
    assert judged(rows, "open", "shelves") == (IN_PART, "open: 2 of 2; shelves: 1 of 2", False)
    assert judged([row("open", "ants", 9.0, contacts=1)], "open").word == FAILS


def test_percent_shows_the_interval() -> None:
    one = figures(*runs("ants", [8.0]), *runs("dijkstra", [10.0])).relative("open", "ants", "dijkstra", "mean")
    assert percent(one) == "-20.0%"
    assert percent(one._replace(low=-0.25, high=-0.15)) == "-20.0% [-25.0, -15.0]"
    assert percent(one._replace(mean=math.nan)) == "no figure"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"dijkstra", planner', '"ants", planner', "two systems have one label"),
        ('"best"', '"lenght"', "measure 'lenght'"),
        ('ours = "ants", figures', 'ours = "nobody", figures', "system 'nobody'"),
        ('other = "dijkstra"', 'other = "nobody"', "system 'nobody'"),
        ("runs = 3", 'runs = "3"', "runs='3' must be a whole number"),
        ("note =", "nota =", "TableStudy parameter 'nota'; did you mean note"),
    ],
)
def test_a_wrong_study_is_refused(toy: Path, old: str, new: str, message: str) -> None:
    toy.write_text(toy.read_text().replace(old, new, 1))
    with pytest.raises(ConfigError, match=message):
        studies_of("toy")


def test_a_system_with_a_wrong_parameter_is_refused(toy: Path) -> None:
    toy.write_text(toy.read_text().replace("ants=8", "ant=8"))
    with pytest.raises(ConfigError):
        studies_of("toy")["toy"].systems[0].make()
