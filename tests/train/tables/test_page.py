"""The page of all planners: what is worth using, the points of the picture, a file that needs no other."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.train.tables.toy import STUDY, row
from train.tables.all_planners import family
from train.tables.figures import Figures
from train.tables.page import study_table, write_pages
from train.tables.pictures import points_of, study_pictures
from train.tables.study import FAILS, HOLDS, IN_PART, OPEN, Claim, Study, System, Verdict
from train.tables.verdicts import judge
from train.tables.worth import summaries, verdict_counts, worth_using
from warehouse_env.planning import PLANNERS

NAMES = ("astar", "astar_turns", "theta_star", "pf_aco", "aco", "apf")
EVERYONE = dataclasses.replace(
    STUDY, systems=tuple(System(name, name) for name in NAMES), published=(), claims=(), measures=("gap", "turns", "ms")
)


def planner_rows() -> list[dict[str, Any]]:
    """Two tasks: exact searches at 10, theta* with a line of 9.5, pf_aco at 10, aco at 11, apf lost on one of two."""
    rows = []
    for number in (0, 1):
        rows += [
            row("open", "astar", 10.0, number=number, turns=4, cpu_ms=0.1),
            row("open", "astar_turns", 10.0, number=number, turns=2, cpu_ms=0.2),
            row("open", "theta_star", 10.0, number=number, turns=4, cpu_ms=0.3, line_length=9.5),
            row("open", "pf_aco", 10.0, number=number, turns=2, cpu_ms=10.0),
            row("open", "aco", 11.0, number=number, turns=8, cpu_ms=30.0),
            row("open", "apf", 12.0 if number else None, number=number, turns=3, cpu_ms=0.4),
        ]
    return rows


def test_what_is_worth_using() -> None:
    text = worth_using(EVERYONE, Figures(EVERYONE.name, planner_rows()))
    assert text == (
        "For a shortest path take `astar` (0.10 ms, 0% over the shortest, 2 times the fewest turns): nothing that "
        "always finds one is as quick. For few turns on a path as short take `astar_turns` (0.20 ms, 0% over the "
        "shortest, 1 times the fewest turns). `theta_star` (0.30 ms) leaves the grid: its lines are 5% shorter than "
        "the shortest path of cells, and pass close to the shelves' corners. Of the ant colonies the best is `pf_aco` "
        "(10 ms, 0% over the shortest, 1 times the fewest turns). It takes 50 times the time of `astar_turns` and adds "
        "nothing to it here. `aco`: another colony is both quicker and shorter; they are here to compare with. Not to "
        "be relied on, since some of their runs find no path at all: `apf` (50%)."
    )


def test_summaries_and_points_agree_with_the_rows() -> None:
    figures = Figures(EVERYONE.name, planner_rows())
    aco = next(one for one in summaries(EVERYONE, figures) if one.name == "aco")
    assert (aco.gap, aco.optimal, aco.turns, aco.found) == (pytest.approx(10.0), 0.0, 4.0, 1.0)
    points = {point.name: point for point in points_of(EVERYONE, figures, ["open"])}
    assert (points["aco"].ms, points["aco"].family) == (30.0, "ant colony")
    assert points["aco"].gap == pytest.approx(10.0)
    assert (points["apf"].failed, points["apf"].gap) == (0.5, pytest.approx(20.0))


def test_every_planner_has_a_family() -> None:
    assert all(family(name) != "other" for name in PLANNERS)


def test_count_of_verdicts() -> None:
    words = (HOLDS, HOLDS, IN_PART, FAILS, OPEN)
    text = verdict_counts([Verdict(word, "") for word in words])
    assert text == "Of 5 claims 2 hold, 1 hold in part and 1 do not hold; 1 cannot be told."


def test_claims_on_milliseconds_are_counted_apart() -> None:
    """The totals of a quick and of a slow machine are the same, whatever becomes of the claim on time."""
    claims = (Claim("shorter", "ants", "dijkstra", "mean"), Claim("quicker", "ants", "dijkstra", "ms"))

    def judged(ms: float) -> list[Verdict]:
        rows = [row("open", "ants", 9.0, cpu_ms=ms), row("open", "dijkstra", 10.0, cpu_ms=2.0)]
        return [judge(Figures(STUDY.name, rows), claim) for claim in claims]

    quick, slow = judged(1.0), judged(3.0)
    assert [[verdict.word for verdict in verdicts] for verdicts in (quick, slow)] == [[HOLDS, HOLDS], [HOLDS, FAILS]]
    assert verdict_counts(quick) == verdict_counts(slow)
    assert verdict_counts(quick) == (
        "Of 1 claims 1 hold, 0 hold in part and 0 do not hold. Judged apart by this machine's clock, not counted: 1."
    )


def test_a_verdict_by_the_clock_is_marked_on_the_pages(tmp_path: Path) -> None:
    timed = dataclasses.replace(STUDY, claims=(Claim("quicker", "ants", "dijkstra", "ms"), *STUDY.claims))
    rows = [row("open", "ants", 10.0, cpu_ms=1.0), row("open", "dijkstra", 10.0, cpu_ms=2.0)]
    write_pages([timed], rows, [], tmp_path, pictures=False)
    page, index = (tmp_path / "toy.md").read_text(), (tmp_path / "README.md").read_text()
    assert "| **holds**, by this machine's clock | quicker | open: 1 against 2, -50.0% |" in page
    assert "| quicker | **holds**, by this machine's clock |" in index
    assert "| ants are as good | **does not hold** |" in index
    assert "Of 1 claims 0 hold, 0 hold in part and 1 do not hold. Judged apart" in index


def test_table_puts_print_beside_ours() -> None:
    table = study_table(STUDY, Figures(STUDY.name, [row("open", "ants", 10.0), row("open", "dijkstra", 10.0)]))
    assert [line[1] for line in table.cells] == [
        "ants", "*in print: theirs*", "dijkstra", "*in print: another*",
    ]  # fmt: skip
    mean = table.header.index("mean length")
    assert [line[mean] for line in table.cells] == ["10", "*6*", "10", ""]
    assert table.cells[0][0] == "**open** (optimum 10, 2 turns)"


def test_convergence_of_runs_that_fell_at_their_own_times() -> None:
    rows = [
        row("open", "ants", 10.0, 0, iterations=4, curve=[[2, 12.0], [4, 10.0]], cells=[[0, 0], [1, 1]]),
        row("open", "ants", 11.0, 1, iterations=2, curve=[[1, 11.0]]),
    ]
    pictures = study_pictures(STUDY, Figures(STUDY.name, rows), Path("out"))
    curves = pictures[1].arguments[0]["ants"]
    inf = np.inf
    assert curves.tolist() == [[inf, 12.0, 12.0, 10.0], [11.0, 11.0, 11.0, 11.0]]
    assert pictures[0].arguments[1]["ants"].tolist() == [[0.0, 0.0], [1.0, 1.0]]


def test_page_of_all_planners_needs_no_other_file(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    everyone: Study = dataclasses.replace(EVERYONE, name="all_planners")
    rows = [{**one, "study": "all_planners"} for one in planner_rows()]
    write_pages([everyone], rows, [], tmp_path, pictures=True)
    page = (tmp_path / "all_planners.html").read_text()
    assert page.count("data:image/png;base64,") == 2
    assert not re.search(r'(src|href)="(?!data:)', page)
    assert "<code>pf_aco</code>" in page
    assert (tmp_path / "all_planners_pareto.png").stat().st_size > 5000
    assert "## What is worth using" in (tmp_path / "README.md").read_text()
