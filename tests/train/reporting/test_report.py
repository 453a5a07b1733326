"""Test means, intervals and tables by hand, row files and their locks, and pages."""

from __future__ import annotations

import errno
import io
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from train.evaluation.workers import RowOptions
from train.reporting.page import Link, Page, PagePart, Shown, made_by
from train.reporting.report import Table, evaluation_table, number, summarise, with_interval
from train.reporting.rows import (
    Interval,
    RowFile,
    held,
    mean_interval,
    read_rows,
    t_quantile,
    whole_rows,
    wilson_interval,
)
from warehouse_env.errors import WarehouseError
from warehouse_env.traffic_spec import TrafficSpec


def test_wilson_interval_by_hand() -> None:
    # Newcombe (1998), table I: 81 of 263, 15 of 148, 0 of 20, 1 of 29.
    for successes, trials, low, high in ((81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611)):
        found = wilson_interval(successes, trials)
        assert (found.low, found.high) == pytest.approx((low, high), abs=5e-5)
    assert wilson_interval(1000, 1000).high == 1.0


def test_mean_interval_ignores_missing_values() -> None:
    # mean 2, standard deviation 1, half width 4.3027 / sqrt(3) = 2.4841
    assert mean_interval([1, None, 2, math.nan, 3]) == pytest.approx((2.0, -0.4841, 4.4841, 3), abs=1e-4)
    one = mean_interval([5.0, None])
    assert (one.mean, one.samples) == (5.0, 1)
    assert math.isnan(one.low)
    assert math.isnan(mean_interval([]).mean)
    assert t_quantile(29) == pytest.approx(2.0452, abs=5e-5)


@pytest.mark.parametrize(
    ("value", "text"),
    [(0, "0"), (12.345, "12.3"), (2835.4, "2835"), (0.01234, "0.0123"), (7.0, "7"), (math.nan, "-"), (-1.5, "-1.50")],
)
def test_number_keeps_three_figures(value: float, text: str) -> None:
    assert number(value) == text


def test_intervals_are_shown_only_where_there_is_spread() -> None:
    assert with_interval(Interval(2.0, 1.5, 2.5, 3)) == "2.00 [1.50, 2.50]"
    assert with_interval(Interval(0.25, 0.125, 0.5, 3), factor=100) == "25.0 [12.5, 50.0]"
    assert with_interval(Interval(2.0, 2.0, 2.0, 3)) == "2"
    assert with_interval(Interval(2.0, math.nan, math.nan, 1)) == "2"


def row(policy: str, collisions: float, **changes: object) -> dict[str, object]:
    """Return an episode of 2 km with one shelf contact; all other contacts are with robots."""
    return {
        "policy": policy, "layout": "paper46", "robots": 16, "tasks": "lifelong", "planner": "astar", "episode": 0,
        "robot_km": 2.0, "collisions_robot": collisions - 1, "collisions_shelf": 1.0, "near_misses": 4.0,
        "collisions_per_km": collisions / 2, "goals_per_robot_hour": 100.0, "stuck": 0.25, "success_rate": 1.0,
        "makespan_s": None, "ms_per_step": 0.5, **changes,
    }  # fmt: skip


def test_summary_by_hand() -> None:
    rows = [row("follow", 20), row("follow", 22), row("follow", 24), row("brake", 2)]
    follow, brake = summarise(rows)
    assert (follow["policy"], follow["episodes"], brake["policy"]) == ("follow", 3, "brake")
    # Rates 10, 11, 12 per km: mean 11, half width 2.4841. Shelves: always half a contact per km.
    assert follow["collisions_per_km"] == pytest.approx((11, 8.5159, 13.4841, 3), abs=1e-4)
    assert follow["shelf_collisions_per_km"] == pytest.approx((0.5, 0.5, 0.5, 3))
    assert follow["robot_collisions_per_km"] == pytest.approx((10.5, 8.0159, 12.9841, 3), abs=1e-4)
    assert follow["near_misses_per_km"] == pytest.approx((2, 2, 2, 3))
    (line,) = summarise([row("follow", 2, stuck=0.5), row("follow", 20, stuck=1.0)])
    assert (line["collisions_per_km"].low, line["stuck"].high) == (0.0, 1.0)  # clipped at the possible range


def test_table_has_success_only_where_tasks_end() -> None:
    assert not any("success" in name for name in evaluation_table([row("follow", 2)]).header)
    table = evaluation_table([row("follow", 2, tasks="one_shot", success_rate=0.75, makespan_s=50.0)])
    assert "75" in table.cells[0][table.header.index("success %")]
    assert "one_shot" in table.title


def test_table_note_states_each_policys_traffic() -> None:
    rules, shield = {"config": {"traffic": "rules"}}, {"config": {"traffic": {**vars(TrafficSpec(shield=True))}}}
    note = evaluation_table([row("follow", 2, **shield), row("runs/mine", 2, **rules), row("greedy", 0, **rules)]).note
    assert "traffic none:shield=true (follow), rules (mine, greedy); planner pf_aco; decision interval" in note
    assert "due to the traffic." in note
    assert "due to" not in evaluation_table([row("follow", 2, **rules), row("greedy", 0, **rules)]).note
    assert "traffic" not in evaluation_table([row("follow", 2)]).note


def test_table_note_states_the_longest_standing_robot() -> None:
    waits = "robot 3 waits for 1, which drives"
    short, long = row("greedy", 0) | {"longest_standing_s": 59.0}, row("follow", 2) | {"longest_standing_s": 534.4}
    long |= {"longest_standing_why": waits, "robots": 64, "seed": 9}
    assert f"534 s (follow on paper46, 64 robots, seed 9): {waits}." in evaluation_table([short, long]).note
    assert "Longest of all" not in evaluation_table([short | {"longest_standing_why": waits}]).note


def test_markdown_and_print(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table("Speeds", ("what", "rate"), (("simulator", "10.0"), ("<img>|b & c", "-")), "A note.")
    assert table.markdown() == (
        "### Speeds\n\n| what | rate |\n| --- | --: |\n| simulator | 10.0 |\n| &lt;img>\\|b &amp; c | - |\n\nA note.\n"
    )
    table.print()
    printed = capsys.readouterr().out
    assert all(text in printed for text in ("Speeds", "simulator", "10.0", "A note."))


def test_rows_round_trip_through_the_file(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "rows.jsonl"
    file = RowFile(path)
    assert not path.exists()  # no file before the first row
    file.add([{"a": np.float32(0.5), "b": np.arange(2), "c": math.nan, "d": path, "e": (1, math.inf)}])
    file.add([{"a": 2}])
    assert read_rows(path) == [{"a": 0.5, "b": [0, 1], "c": None, "d": str(path), "e": [1, None]}, {"a": 2}]
    assert file.kept() == f"2 rows are kept in {path}"
    RowFile(path).add([{"a": 3}])  # a new file replaces the old one
    RowFile(path, keep=True).add([{"a": 4}])
    assert [one["a"] for one in read_rows(path)] == [3, 4]


def test_share_of_free_flow_by_hand() -> None:
    rows = [row("follow", 2, robots=1, late_goals_per_robot_hour=late) for late in (100.0, 100.0)]
    rows += [row("follow", 2, robots=8, late_goals_per_robot_hour=late) for late in (70.0, 80.0)]
    rows += [row("brake", 2, robots=8, late_goals_per_robot_hour=50.0)]
    alone, together, other = summarise(rows)
    # 75 +- 12.706 * 5 of 100 +- 0
    assert together["free_flow_share"] == pytest.approx((0.75, 0.114690, 1.385310, 2), abs=1e-4)
    assert alone["free_flow_share"] == pytest.approx((1, 1, 1, 2))
    assert "free_flow_share" not in other  # no row of brake with one robot
    table = evaluation_table(rows)
    column = table.header.index("free flow %")
    assert [line[column].split(" ")[0] for line in table.cells] == ["100", "75", "-"]
    assert "free flow %" not in evaluation_table(rows[2:]).header


class Terminal(io.StringIO):
    """Stream that Table.print takes for a terminal of COLUMNS characters."""

    def isatty(self) -> bool:
        return True


def plain(terminal: Terminal) -> str:
    """Return the shown text without control sequences."""
    return re.sub(r"\x1b\[[\d;]*m", "", terminal.getvalue())


@pytest.mark.parametrize("width", [60, 120])
def test_no_cell_is_cut_at_any_width(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [
        row(policy, collisions, layout=layout, late_goals_per_robot_hour=88.8, longest_standing_s=123.0, seed=seed)
        for seed, collisions in enumerate((2.0, 3.0, 4.0))
        for policy in ("shielded", "my_policy.py:Mine")
        for layout in ("paper46_rough", "blocks:rows=92,columns=92")
    ]
    table = evaluation_table(rows)
    monkeypatch.setenv("COLUMNS", str(width))
    monkeypatch.setenv("TERM", "xterm")
    table.print(terminal := Terminal())
    lines = plain(terminal).splitlines()
    assert max(map(len, lines)) <= width
    shown = [[cell.strip() for cell in line.split("\N{BOX DRAWINGS LIGHT VERTICAL}")[1:-1]] for line in lines]
    whole = {cell for line in shown for cell in line} | {line.partition(": ")[2] for line in lines}  # a list's lines
    for cells in table.cells:
        for index, cell in enumerate(cells):
            numeric = table.numeric(index) or len(cell) < 13
            assert cell in whole if numeric else set(cell.split()) <= {word for one in whole for word in one.split()}


def test_rows_are_replaced_only_on_request(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    RowFile(path).add([{"a": 1}, {"a": 2}])
    with pytest.raises(WarehouseError, match=r"rows.jsonl holds 2 rows already: --resume .* --overwrite"):
        RowOptions(json=path).file().__enter__()
    assert [one["a"] for one in read_rows(path)] == [1, 2]
    assert {one.name for one in tmp_path.iterdir()} == {"rows.jsonl"}  # and the lock is gone
    with RowOptions(json=path, resume=True).file() as file:
        file.add([{"a": 3}])
    with RowOptions(json=path, overwrite=True).file() as file:
        file.add([{"a": 4}])
    assert [one["a"] for one in read_rows(path)] == [4]


def test_torn_last_line_is_dropped_before_new_rows(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    path.write_text('{"a": 1}\n{"a": 2')
    RowFile(path, keep=True).add([{"a": 3}])
    assert read_rows(path) == [{"a": 1}, {"a": 3}]


def test_damaged_line_is_named_and_kept(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    path.write_text('{"a": 1}\n[1]\n')
    with pytest.raises(WarehouseError, match="line 2"):
        whole_rows(path)
    assert path.read_text() == '{"a": 1}\n[1]\n'


ROOT = Path(__file__).parents[3]


def test_held_lock_names_its_process_and_is_removed_on_release(tmp_path: Path) -> None:
    lock = tmp_path / "new" / ".lock"
    with held(lock, tmp_path):
        with pytest.raises(WarehouseError, match=rf"{tmp_path} is in use by process {os.getpid()}, since 2\d\d\d-"):
            held(lock, tmp_path).__enter__()
        assert lock.exists()  # the refused process keeps the lock file
    assert not lock.exists()
    assert not lock.parent.exists()
    with held(lock, tmp_path):
        (tmp_path / "new" / "file").touch()
    assert [path.name for path in lock.parent.iterdir()] == ["file"]


def test_row_file_has_one_writer(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    with RowFile(path), pytest.raises(WarehouseError, match=rf"{path} is in use by process {os.getpid()}, since"):
        RowFile(path, keep=True).__enter__()


def test_killed_process_releases_its_lock(tmp_path: Path) -> None:
    lock = tmp_path / ".lock"
    body = "import os, sys; from pathlib import Path; from train.reporting.rows import held\n"
    body += "with held(Path(sys.argv[1]), Path('it')): os.kill(os.getpid(), 9)"
    subprocess.run([sys.executable, "-c", body, lock], cwd=ROOT, check=False)
    assert lock.exists()
    with held(lock, tmp_path):
        assert lock.read_text().startswith(f"process {os.getpid()},")


def test_file_system_without_locks_is_accepted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.flock", refuse)
    with RowFile(tmp_path / "rows.jsonl") as file:
        file.add([{"a": 1}])
    assert (tmp_path / "rows.jsonl").read_text() == '{"a": 1}\n'


def test_page_holds_all_parts(tmp_path: Path) -> None:
    table = Table(
        "T", ("name", "figure", "verdict"), (("a<b", "1.5", "better"), ("c", "-2", "may be chance")), "a note"
    )
    part = PagePart(
        "Part", "some *text*", [Shown("<svg></svg>", "a `caption`")], [table], [Link("a b.html", "L", "why")]
    )
    Page("A & B", "sub", ["**bold** <i>"], [part, PagePart(facts=made_by(Seeds="1"))]).write(tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    for text in (
        "<title>A &amp; B</title>", "<p><b>bold</b> &lt;i&gt;</p>", "<p>some <i>text</i></p>", "<svg></svg>",
        "a <code>caption</code>", "<td>a&lt;b</td>", '<td class="number">-2</td>', '<a href="a%20b.html">', "a note",
        "default-src 'none'; style-src 'unsafe-inline'; img-src data:",
        '<span class="better">better</span>', "<dt>Seeds</dt><dd>1</dd>", "prefers-color-scheme: dark",
    ):  # fmt: skip
        assert text in page, text
    assert not re.search(r'src=|href="(?!a%20b)|url\(|@import|<script', page)
