"""The command `robust`: a row for each disturbance and policy, resumable, and the same from several processes."""

from __future__ import annotations

from pathlib import Path

import pytest

from train.cli import main
from train.reporting.rows import read_rows

COMMON = "robust --policy follow brake --layout open --robots 2 --episodes 2 --seconds 5 --planner astar --seed 700"


def test_one_command_makes_one_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = [*COMMON.split(), "--disturbance", "delay", "long", "--out", str(tmp_path)]
    assert main(command) == 0
    printed = capsys.readouterr().out
    lines = [line for line in (tmp_path / "table.md").read_text().splitlines() if line.startswith("| ")]
    named = [tuple(cell.strip() for cell in line.split("|")[1:3]) for line in lines[2:]]
    summaries = ("undisturbed", "seen 0.2 s late", "body 1.2 m long")
    assert named == [(summary, policy) for summary in summaries for policy in ("follow", "brake")]
    assert all(summary in printed for summary in summaries)
    rows = read_rows(tmp_path / "rows.jsonl")
    assert len(rows) == 3 * 2 * 2
    assert {row["seed"] for row in rows} == {700, 701}
    assert {row["config"]["robot"]["length"] for row in rows if row["disturbance"] == "long"} == {1.2}

    kept = (tmp_path / "rows.jsonl").read_text().splitlines()
    (tmp_path / "rows.jsonl").write_text("\n".join(kept[:5]) + "\n")
    assert main([*command, "--resume"]) == 0
    again = read_rows(tmp_path / "rows.jsonl")
    assert again[:5] == rows[:5]
    timeless = [[{**row, "ms_per_step": 0} for row in found] for found in (rows, again)]
    assert timeless[0] == timeless[1]
