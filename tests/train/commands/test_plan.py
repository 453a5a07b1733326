"""Test `warehouse plan`: complete rows and all kinds of tasks."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from train.cli import main
from train.commands.plan import plan_table
from train.reporting.rows import read_rows
from warehouse_env.maps.movingai import EXAMPLE_SCEN


def plan(tmp_path: Path, *options: str) -> list[dict[str, Any]]:
    json = tmp_path / "rows.jsonl"
    assert main(["plan", "--no-pictures", "--json", str(json), "--out", str(tmp_path / "out"), *options]) == 0
    return read_rows(json)


def test_plan_uses_named_tasks_by_default(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = plan(tmp_path, "--planner", "astar", "astar_turns", "--runs", "2")
    assert len(rows) == 2 * 5 * 2
    for row in rows:
        assert row["success"]
        assert row["gap"] == pytest.approx(0, abs=1e-12)
        assert row["length"] == pytest.approx(row["optimal_length"])
        assert row["turns"] >= row["min_turns"]
        assert (row["converged_at"], row["iterations"]) == (None, 0)
    optima = {row["task"]: row["optimal_length"] for row in rows}
    assert optima["in_zone_1"] == pytest.approx(8 + 13 * math.sqrt(2))
    assert optima["cross_zone_2"] == pytest.approx(23 + 28 * math.sqrt(2))
    assert "| astar |" in (tmp_path / "out" / "table.md").read_text()


def test_colony_reports_convergence_and_is_reproducible(tmp_path: Path) -> None:
    options = ("--planner", "pf_aco", "--start", "22,1", "--goal", "5,18", "--runs", "2", "--seed", "3")
    rows, again = plan(tmp_path / "a", *options), plan(tmp_path / "b", *options)
    assert [(row["start"], row["goal"], row["run"]) for row in rows] == [([22, 1], [5, 18], 0), ([22, 1], [5, 18], 1)]
    timeless = {"ms": 0, "cpu_ms": 0}
    for row, same in zip(rows, again, strict=True):
        assert 1 <= row["converged_at"] <= row["iterations"]
        assert row | timeless == same | timeless


def test_plan_takes_tasks_of_a_scenario_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = plan(tmp_path, "--scen", str(EXAMPLE_SCEN), "--planner", "astar", "--tasks", "2", "--runs", "1")
    assert len(rows) == 2
    assert all(row["task"].startswith("scenario_") for row in rows)
    assert not capsys.readouterr().err


SCEN = "version 1\n0\tm.map\t3\t2\t0\t0\t2\t1\t{}\n"


@pytest.mark.parametrize(
    ("scen", "options", "code", "message"),
    [
        (SCEN.format(3), (), 0, ""),
        (SCEN.format(2.83), (), 0, "1 of 1 lengths are not those of the shortest paths"),
        (SCEN.format(3), ("--layout", "open"), 2, "is for a map of 2 x 3 cells, but the map has 40 x 40"),
        (SCEN.format(3), ("--layout", "open", "--map", "m.map"), 2, "--map is another name of --layout"),
        ("version 1\n", (), 2, "s.scen holds no scenario"),
    ],
)
def test_mismatched_scenario_file_is_reported(
    scen: str, options: tuple[str, ...], code: int, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str], recwarn: pytest.WarningsRecorder,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    Path("s.scen").write_text(scen)
    Path("m.map").write_text("type octile\nheight 2\nwidth 3\nmap\n...\n.@.\n")
    command = ["plan", "--scen", "s.scen", "--planner", "astar", "--runs", "1", "--no-pictures", "--out", "out"]
    assert main([*command, *options]) == code
    messages = [*capsys.readouterr().err.splitlines(), *(str(one.message) for one in recwarn)]
    assert len(messages) == (message != "")
    assert message in "".join(messages)


def test_task_of_length_zero_counts_as_solved(tmp_path: Path) -> None:
    rows = plan(tmp_path, "--layout", "open", "--start", "1,1", "--goal", "1,1", "--planner", "astar", "--runs", "1")
    assert (rows[0]["length"], rows[0]["gap"]) == (0, 0)


def test_plan_writes_pictures(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    options = ["--planner", "pf_aco", "astar", "--tasks", "1", "--runs", "2", "--out", str(tmp_path)]
    assert main(["plan", *options]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {
        "table.md", "paths_random_1.png", "convergence_random_1.png",
    }  # fmt: skip


def row(planner: str, length: float, turns: int, ms: float, iterations: int = 0, climb: float = 0.0) -> dict[str, Any]:
    return {
        "planner": planner, "task": "a", "layout": "floor", "run": 0, "success": True, "length": length,
        "optimal_length": 10.0, "gap": length / 10 - 1, "turns": turns, "min_turns": 2, "ms": ms,
        "iterations": iterations, "converged_at": 1 if iterations else None, "climb_m": climb,
    }  # fmt: skip


def test_planners_with_other_parameters_stay_apart(tmp_path: Path) -> None:
    both = ("astar_turns", "astar_turns:gentleness=10")
    rows = plan(tmp_path, "--layout", "paper46_rough", "--runs", "1", "--planner", *both)
    for task in ("ramp", "broken_corridor"):
        flat, gentle = (next(r for r in rows if (r["planner"], r["task"]) == (name, task)) for name in both)
        assert gentle["climb_m"] == 0 < flat["climb_m"]
        assert gentle["length"] > flat["length"]
    table = (tmp_path / "out" / "table.md").read_text()
    assert all(f"| {name} | ramp |" in table for name in both)


def test_table_counts_failed_runs() -> None:
    lost = {**row("aco", 10, 4, 1, 100), "success": False, "length": None, "gap": None, "turns": None, "climb_m": None}
    line = plan_table([lost, row("aco", 12, 4, 3, 100)]).cells[0]
    assert line[:7] == ("aco", "a", "50%", "12", "10", "20%", "0%")
