"""The benchmark: its maps, what it measures by hand, what it keeps when it was cut, and its report."""

from __future__ import annotations

import json
import math
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from train.cli import main
from train.evaluation.jobs import Known, Result, Tick
from train.evaluation.planning_runs import Task
from train.reporting.rows import Row, read_rows
from train.tables import code
from train.tables.benchmark import command as benchmark
from train.tables.benchmark.figures import anytime_table, csv, summarise, table_of
from train.tables.benchmark.maps import clearance_of, make_map, make_tasks
from train.tables.benchmark.runs import (
    MOMENTS,
    Pair,
    anytime,
    measure,
    pairs_of,
)
from warehouse_env.errors import ConfigError, PlanError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.movingai import write_map
from warehouse_env.planning import PLANNERS, Plan, make_planner

MOVINGAI_KEY = "23e073a1c13935fcceac167ee8febb7e"  # GridMap.key of the file as it is distributed


@pytest.fixture
def small_map(tmp_path: Path) -> str:
    """A floor of 5 x 7 cells with a wall that has one gap, as a MovingAI file."""
    path = tmp_path / "small.map"
    write_map(
        GridMap(np.array([[c == "#" for c in row] for row in ("...#...", "...#...", ".......", "...#...", "...#...")])),
        path,
    )
    return str(path)


def test_the_movingai_map_is_the_distributed_one() -> None:
    grid = make_map("warehouse-10-20-10-2-2")
    assert grid.shape == (84, 170)
    assert grid.key == MOVINGAI_KEY
    assert (
        grid.text()[3].replace("p", ".").replace("s", ".")
        == "#" + "." * 25 + "..".join(["#" * 10] * 10) + "." * 25 + "#"
    )


def test_clutter_has_its_share_and_is_one_region() -> None:
    for name, share in (("clutter20", 0.2), ("clutter35", 0.35)):
        grid = make_map(name)
        assert share <= grid.occupied.mean() < share + 0.05  # what is cut off is filled
        assert len(grid.free_cells) == (~grid.occupied).sum()


@given(st.data())
def test_clearance_is_the_distance_to_the_nearest_square(data: st.DataObject) -> None:
    rows, columns = data.draw(st.integers(1, 6)), data.draw(st.integers(1, 6))
    occupied = np.array(data.draw(st.lists(st.booleans(), min_size=rows * columns, max_size=rows * columns)))
    occupied = occupied.reshape(rows, columns)
    field = clearance_of(occupied)
    for row in range(rows):
        for column in range(columns):
            edge = min(row, column, rows - 1 - row, columns - 1 - column) + 0.5
            gaps = [
                math.hypot(max(abs(row - r) - 0.5, 0), max(abs(column - c) - 0.5, 0)) for r, c in np.argwhere(occupied)
            ]
            assert field[row, column] == pytest.approx(min([edge, *gaps]))


def test_the_first_pairs_are_those_of_any_number() -> None:
    few, many = make_tasks("paper46", 3, 0), make_tasks("paper46", 6, 0)
    assert many[:3] == few
    assert make_tasks("paper46", 3, 1) != few
    for task in many:
        assert task.start != task.goal
        assert task.optimal_length == make_map("paper46").distance_to(task.goal)[task.start]


def test_anytime_by_hand() -> None:
    cells = np.array([[0, 0], [0, 1], [0, 2]])
    plan = Plan(cells, np.array([math.inf, 3.0, 2.0]), 0.004, np.array([0.0001, 0.001, 0.003]))
    gaps = dict(zip(MOMENTS, anytime(plan, 2.0, 0.004), strict=True))
    assert [gaps[ms] for ms in (0.05, 0.5, 1.0, 2.0, 5.0, 5000.0)] == [None, None, 0.5, 0.5, 0.0, 0.0]
    slowed = dict(zip(MOMENTS, anytime(plan._replace(seconds=0.008), 2.0, 0.004), strict=True))
    assert [slowed[ms] for ms in (0.5, 2.0)] == [0.5, 0.0]  # half of the time was others'
    exact = anytime(Plan(cells, np.empty(0), 0.003), 2.0, 0.0015)
    assert exact == [None if ms < 1.5 else 0.0 for ms in MOMENTS]
    assert anytime(Plan(np.empty((0, 2), np.int64), np.empty(0), 0.001), 2.0, 0.001) == [None] * len(MOMENTS)


def test_a_plan_measured_by_hand(small_map: str) -> None:
    task = Task("by hand", (0, 2), (2, 5), 5.0, 1)
    cells = np.array([[0, 2], [1, 1], [2, 2], [2, 3], [2, 4], [2, 5]])
    line = np.array([[0.0, 2.0], [2.0, 2.0], [2.0, 5.0]])
    row = measure(small_map, make_planner("astar"), task, Plan(cells, np.empty(0), 0.003, line=line), 0.002)
    assert row["gap"] == pytest.approx((3 + 2 * math.sqrt(2)) / 5 - 1)
    assert row["line_gap"] == 0
    assert (row["turns"], row["min_turns"], row["ms"]) == (2, 1, 2.0)
    assert row["clearance"] == 0.5
    beside = math.hypot(0.5, 0.5)  # of (2, 2) and (2, 4) from the corners of the wall's two ends
    assert row["mean_clearance"] == pytest.approx((0.5 + 1.5 + beside + 0.5 + beside + 1.5) / 6, abs=1e-4)
    with pytest.raises(PlanError, match="starts at"):
        measure(small_map, make_planner("astar"), task, Plan(cells[1:], np.empty(0), 0.1), 0.1)


def rows_of(pair: Pair) -> list[Row]:
    return pair.run(lambda done: None).rows


def test_a_planner_without_chance_runs_once_a_pair(small_map: str) -> None:
    rows = rows_of(Pair(small_map, "astar", 1, 2, 4, 0))
    assert [(row["pair"], row["run"], row["stands_for"]) for row in rows] == [(1, 0, 4)]
    rows = rows_of(Pair(small_map, "aco", 1, 2, 4, 0))
    assert [(row["run"], row["stands_for"]) for row in rows] == [(run, 1) for run in range(4)]


def test_slow_peers_get_fewer_runs() -> None:
    jobs = pairs_of(["a", "b"], ["astar", "aco-routing"], 25, 3, 0)
    assert Counter((job.map, job.planner, job.runs) for job in jobs) == {
        ("a", "astar", 3): 25, ("a", "aco-routing", 1): 10, ("b", "astar", 3): 25, ("b", "aco-routing", 1): 10,
    }  # fmt: skip


def without_times(row: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in row.items() if key not in ("ms", "anytime")}


def command(tmp_path: Path, small_map: str, *options: str) -> list[dict[str, Any]]:
    """Run `warehouse tables benchmark` in one process; return the rows of its file."""
    out = tmp_path / "out"
    given = {"--pairs": "3", "--runs": "2", "--maps": small_map, "--processes": "1", "--out": str(out)}
    words = [word for pair in given.items() for word in pair]
    assert main(["tables", "benchmark", *words, "--planner", "astar", "aco", *options]) == 0
    return read_rows(out / "benchmark" / "rows.jsonl")


def test_it_goes_on_where_it_was_cut(
    tmp_path: Path, small_map: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = command(tmp_path, small_map, "--no-pictures")
    assert len(whole) == 3 + 3 * 2
    path = tmp_path / "out" / "benchmark" / "rows.jsonl"
    other = {**whole[0], "planner": "gone"}
    aco = sorted((row for row in whole if row["planner"] == "aco"), key=lambda row: (row["pair"], row["run"]))
    left = [other, *aco[:3]]  # one pair of aco, and half a pair
    path.write_text("".join(json.dumps(row) + "\n" for row in left) + '{"map": "torn')
    ran: list[tuple[str, int]] = []
    run = Pair.run

    def watched(job: Pair, tick: Tick) -> Result:
        ran.append((job.planner, job.pair))
        return run(job, tick)

    monkeypatch.setattr(Pair, "run", watched)
    again = command(tmp_path, small_map, "--no-pictures")
    assert sorted(ran) == [("aco", 1), ("aco", 2), ("astar", 0), ("astar", 1), ("astar", 2)]
    assert again[0] == other  # rows that were not asked for stay
    in_order = lambda rows: sorted(json.dumps(without_times(row)) for row in rows)  # noqa: E731
    assert in_order(again[1:]) == in_order(whole)
    assert "1 of 6 jobs are kept" in capsys.readouterr().out
    ran.clear()
    command(tmp_path, small_map, "--no-pictures")
    assert not ran
    command(tmp_path, small_map, "--no-pictures", "--fresh")
    assert len(ran) == 6


def test_rows_of_other_code_or_seeds_are_run_again(small_map: str) -> None:
    job = Pair(small_map, "astar", 0, 2, 2, 0)
    rows = rows_of(job)
    assert job.left(Known(rows).of(job)) == (rows, None)
    other = replace(job, seed=1)
    assert other.left(Known(rows).of(other)) == ([], other)
    assert job.left(Known([{**rows[0], "made": "0" * 16}]).of(job)) == ([], job)


def row(pair: int, gap: float | None, run: int = 0, stands_for: int = 1, **more: Any) -> dict[str, Any]:
    curve = [None] * 8 + [gap] * (len(MOMENTS) - 8)
    base = {"map": "m", "planner": "p", "pair": pair, "run": run, "stands_for": stands_for, "ms": 2.0, "min_turns": 4,
            "success": gap is not None, "anytime": curve}  # fmt: skip
    if gap is None:
        return {**base, **more}
    return {**base, "gap": gap, "line_gap": None, "turns": 5, "clearance": 0.5, "mean_clearance": 1.0, **more}


def test_a_summary_by_hand() -> None:
    rows = [
        row(0, 0.0, stands_for=3, ms=1.0),
        row(1, 0.1, run=0, turns=6, mean_clearance=2.0, clearance=0.7),
        row(1, 0.3, run=1, ms=4.0),
        row(1, None, run=2),
    ]
    (one,) = summarise(rows)
    assert (one.pairs, one.runs) == (2, 6)
    assert one.failed == pytest.approx(1 / 6)
    assert one.optimal == 0.5
    assert one.gap.mean == pytest.approx(0.4 / 5)  # over runs
    assert one.gap.low == 0.0  # of the two pairs' means 0 and .2, cut at what is possible
    assert one.quantiles[0] == 0.0
    assert one.quantiles[1] == pytest.approx(np.quantile([0, 0, 0, 0.1, 0.3], 0.95))
    assert one.quantiles[3] == 0.3
    assert one.turns == pytest.approx((3 * 5 + 6 + 5) / (5 * 4))
    assert (one.clearance, one.mean_clearance) == (0.5, pytest.approx((3 * 1 + 2 + 1) / 5))
    assert one.ms == pytest.approx(1.5)  # of 1, 1, 1, 2, 2, 4
    assert math.isnan(one.line_gap)
    assert np.isnan(one.anytime[:8]).all()
    assert one.anytime[8] == pytest.approx(0.4 / 5)
    assert one.arrived[7:9].tolist() == [0.0, pytest.approx(5 / 6)]
    assert "| p | 2 | 6 | 16.7% | 8 [0, " in table_of("m", [one]).markdown()
    assert "| p | - | - | - | 8 (83.3% have one) |" in anytime_table("m", [one]).markdown()
    header, line = csv([one]).splitlines()
    assert len(header.split(",")) == len(line.split(","))


def test_report_with_pictures(tmp_path: Path, small_map: str) -> None:
    pytest.importorskip("matplotlib")
    command(tmp_path, small_map, "--pairs", "2")
    folder = tmp_path / "out" / "benchmark"
    assert {path.name for path in folder.iterdir()} == {
        "README.md", "figures.csv", "rows.jsonl", "pareto.png", "gaps.png", "anytime.png",
    }  # fmt: skip
    assert "| astar | 2 | 4 | 0% | 0 |" in (folder / "README.md").read_text()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--maps", "paper47"), "did you mean paper46"),
        (("--maps", "no.map"), "no.map does not exist"),
        (("--planner", "asta"), "did you mean astar"),
        (("--planner", "pf_aco:ant=3"), "did you mean ants"),
        (("--pairs", "0"), "pairs=0 must be a whole number from 1 to 1,000,000"),
    ],
)
def test_wrong_options(options: tuple[str, ...], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["tables", "benchmark", "--no-pictures", "--out", str(tmp_path / "o"), *options]) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


def test_a_peer_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(benchmark, "installed", lambda peer: False)
    with pytest.raises(ConfigError, match="pip install pathfinding"):
        benchmark.Benchmark(planner=("pathfinding",)).run()


def test_the_code_key_follows_the_code_a_planner_is_built_on() -> None:
    keys = {name: code.code_key(made) for name, made in PLANNERS.items() if isinstance(made, type)}
    assert keys["astar"] == keys["dijkstra"]  # one module
    assert len({keys["astar"], keys["aco"], keys["pf_aco"], keys["theta_star"]}) == 4
    assert "warehouse_env.planning.ants.walks" in code._closure(["warehouse_env.planning.ants.aco"])
    assert "warehouse_env.planning.ants.pf_aco" not in code._closure(["warehouse_env.planning.ants.aco"])


def test_words_do_not_change_the_code_key() -> None:
    import ast

    def key(source: str) -> str:
        return ast.dump(code._without_docstrings(ast.parse(source)))

    assert key('"""A."""\ndef f():\n    """B."""\n    return 1\n') == key("def f():\n    return 1  # why\n")
    assert key("def f():\n    return 1\n") != key("def f():\n    return 2\n")
