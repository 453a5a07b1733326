"""The step beside fixed work: that work by hand, ratios by a fake clock, and the check against the reference."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from train.benchmarks import reference
from train.benchmarks.fixed_work import FixedWork, compiler
from train.benchmarks.reference import ROOT, Size, reference_table
from train.benchmarks.timing import Timed, in_turns
from train.cli import main
from train.commands.bench import tables
from train.reporting.rows import Row, read_rows, write_rows
from warehouse_env.errors import WarehouseError

pytestmark = pytest.mark.skipif(compiler() is None, reason="there is no C compiler")


RUNS = ("same work", "random commands", "full speed", "training")


def test_the_work_is_the_same_each_time(tmp_path: Path) -> None:
    ends = []
    for _ in range(2):
        work = FixedWork(2, 8, tmp_path)
        for k in range(40):
            work(k)
        ends.append(work.seen)
    assert np.array_equal(ends[0], ends[1])
    assert np.isfinite(ends[0]).all()
    assert ends[0].std() > 0.3


def test_ratios_by_a_clock_in_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0

    def takes(seconds: float) -> Any:
        def call(_: int) -> None:
            nonlocal now
            now += seconds

        return call

    monkeypatch.setattr(reference, "time", SimpleNamespace(process_time=lambda: now))
    ours, theirs = Timed(takes(3.0), rows=2, steps=5), Timed(takes(1.0), rows=4, steps=7)
    assert in_turns([ours, theirs], 3, lambda: now) == [pytest.approx([1.5e6] * 3), pytest.approx([0.25e6] * 3)]
    row = reference._ratio(ours, theirs, 4)
    assert (row["ratio"], row["low"], row["high"]) == pytest.approx((1 / 6,) * 3)
    assert (row["us_a_robot"], row["reference_us"]) == pytest.approx((1.5e6, 0.25e6))


def test_every_row_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reference, "SIZES", (Size(2, 4, 2, 2, 2, 1),))
    monkeypatch.setattr(reference, "DECISIONS", {8: 2})
    rows = [{"what": "reference", "commit": "c", "date": "d", **row} for row in reference.reference(2, 0)]
    assert [row["run"] for row in rows] == [*RUNS, "greedy's decision"]
    assert all(min(row["ratio"], row["us_a_robot"], row["reference_us"]) > 0 for row in rows)
    (table,) = tables(rows)
    assert [line[0] for line in table.cells] == [*RUNS, "greedy's decision"]
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(WarehouseError, match="no C compiler"):
        next(reference.reference(2, 0))


def row(ratio: float, run: str = "random commands") -> Row:
    return {
        "what": "reference", "run": run, "envs": 64, "agents": 16, "ratio": ratio, "commit": "abc1234",
        "date": "2026-07-01",
    }  # fmt: skip


def test_a_third_below_the_release_fails(tmp_path: Path) -> None:
    path = tmp_path / "release.jsonl"
    reference.write_release([row(0.9), row(0.6, "full speed"), {"what": "plan"}], path)
    assert len(read_rows(path)) == 2
    reference.judge([row(0.61), row(0.41, "full speed")], path)
    with pytest.raises(WarehouseError) as told:
        reference.judge([row(0.6), row(0.41, "full speed")], path)
    for part in ("random commands at 64 x 16 fell from 0.9 of the speed of C to 0.6", "abc1234", reference.RENEW):
        assert part in str(told.value)
    assert "full speed" not in str(told.value)
    with pytest.raises(WarehouseError, match=r"no ratio for parked at 64 x 16: .*--write-release"):
        reference.judge([row(0.9), row(0.9, "parked")], path)


def test_the_release_has_every_ratio() -> None:
    rows = read_rows(reference.RELEASE)
    wanted = [(run, size.worlds, size.robots) for size in reference.SIZES for run in RUNS]
    wanted += [("greedy's decision", 1, robots) for robots in reference.DECISIONS]
    assert [(one["run"], one["envs"], one["agents"]) for one in rows] == wanted
    assert all(one["chunks"] == 9 for one in rows)  # as long as the check measures


def test_the_command_checks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(reference, "SIZES", (Size(1, 2, 1, 1, 1, 1),))
    monkeypatch.setattr(reference, "DECISIONS", {})
    path = tmp_path / "release.jsonl"
    for function in (reference.judge, reference.write_release):
        monkeypatch.setattr(function, "__defaults__", (path,))
    json = tmp_path / "rows.jsonl"
    bench = ["bench", "--only", "reference", "--seconds", "0.6"]
    assert main([*bench, "--write-release", "--json", str(json)]) == 0
    written = read_rows(path)
    assert written == read_rows(json)
    assert {"commit", "date", "ratio", "version"} <= set(written[0])
    write_rows(path, [{**one, "ratio": one["ratio"] / 1e3} for one in written])
    assert main([*bench, "--check", "--json", str(json), "--append"]) == 0
    assert len(read_rows(json)) > len(written)
    write_rows(path, [{**one, "ratio": one["ratio"] * 1e3} for one in written])
    capsys.readouterr()
    assert main([*bench, "--check"]) == 2
    assert "the step has lost a third of its speed" in capsys.readouterr().err
    assert main(["bench", "--only", "simulator", "--check"]) == 2
    assert main(["bench", "--rows", str(json)]) == 0
    assert "| same work | 1 x 2 | " in capsys.readouterr().out


def test_the_page_has_the_releases_table() -> None:
    page = (ROOT / "docs/measured/speed.md").read_text(encoding="utf-8")
    shown = f"warehouse bench --rows {reference.RELEASE.relative_to(ROOT).as_posix()}"
    assert shown in page
    _, table = reference_table(read_rows(reference.RELEASE)).markdown().split("\n", 1)
    assert table.strip() in page, f"put into the page what `{shown}` prints"
