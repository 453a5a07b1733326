"""The written tables: print beside ours, verdicts that rest on the clock, the curves of the pictures."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from tests.train.tables.toy import STUDY, row
from train.tables.measures import Figures
from train.tables.page import study_pictures, write_pages
from train.tables.study import FAILS, HOLDS, Claim, Verdict
from train.tables.verdicts import judge, verdict_counts


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
