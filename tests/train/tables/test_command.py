"""`warehouse tables`: what it writes, how it goes on after a stop, what it refuses."""

from __future__ import annotations

import csv
import dataclasses
import json
import sys
from pathlib import Path

import pytest

from train.cli import main
from train.evaluation.jobs import Result, Tick
from train.reporting.rows import Row, read_rows
from train.tables.command import Block, blocks_of
from train.tables.study import Study

pytestmark = pytest.mark.usefixtures("toy")


def tables(folder: Path, *options: str) -> int:
    return main(["tables", "papers", "--out", str(folder), "--processes", "1", "--no-pictures", *options])


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[Block]:
    """The blocks that were run, in their order."""
    done: list[Block] = []
    run = Block.run

    def counts(block: Block, tick: Tick) -> Result:
        done.append(block)
        return run(block, tick)

    monkeypatch.setattr(Block, "run", counts)
    return done


def test_rows_tables_and_verdicts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert tables(tmp_path) == 0
    rows = read_rows(tmp_path / "rows.jsonl")
    assert len(rows) == 2 * 3 * 3  # systems, tasks, runs
    for row in rows:
        assert row["length"] >= row["optimal_length"] - 1e-9
        assert row["cpu_ms"] > 0
        assert 0 < row["clearance"] <= 5
        assert {"study", "setting", "number", "system", "map", "code", "version", "seed", "runs"} <= set(row)
    best = [row for row in rows if "cells" in row]
    assert len(best) == 2 * 3  # one of each block
    assert best[0]["cells"][0] == [0, 0]
    assert {path.name for path in tmp_path.iterdir()} == {"README.md", "rows.jsonl", "toy.csv", "toy.md"}
    assert "begin with README.md" in capsys.readouterr().out
    page = (tmp_path / "toy.md").read_text()
    assert "**open** (optimum 5.65685, 0 turns)" in page
    assert "*in print: theirs*" in page
    assert "*in print: another*" in page
    assert "| **does not hold** | ants are as good |" in page
    assert "Of 1 claims 0 hold, 0 hold in part and 1 do not hold." in (tmp_path / "README.md").read_text()
    lines = list(csv.DictReader((tmp_path / "toy.csv").open()))
    assert {line["source"] for line in lines} == {"ours", "paper"}
    assert next(line for line in lines if line["source"] == "paper")["mean"] == "6.0"


def test_goes_on_where_it_stopped(
    tmp_path: Path, counted: list[Block], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Block.run

    def stopped(block: Block, tick: Tick) -> Result:
        if len(counted) == 2:
            raise KeyboardInterrupt
        return run(block, tick)

    with monkeypatch.context() as patch:
        patch.setattr(Block, "run", stopped)
        assert tables(tmp_path) == 130
    assert "6 rows are kept" in capsys.readouterr().err
    counted.clear()
    assert tables(tmp_path) == 0
    assert len(counted) == 6 - 2
    assert "2 of 6 jobs are kept" in capsys.readouterr().out
    assert len(read_rows(tmp_path / "rows.jsonl")) == 18
    assert tables(tmp_path) == 0
    assert len(counted) == 4
    assert tables(tmp_path, "--fresh") == 0
    assert len(counted) == 10
    assert len(read_rows(tmp_path / "rows.jsonl")) == 18


def test_a_line_cut_short_is_dropped(tmp_path: Path, counted: list[Block]) -> None:
    assert tables(tmp_path) == 0
    path = tmp_path / "rows.jsonl"
    path.write_text(path.read_text()[:-30])
    assert tables(tmp_path) == 0
    assert len(counted) == 6 + 1
    assert len(read_rows(path)) == 18


@pytest.mark.parametrize("change", [("code", "older"), ("version", "0"), ("map", "other"), ("parameters", "x")])
def test_rows_of_other_code_maps_or_parameters_are_not_reused(
    tmp_path: Path, counted: list[Block], change: tuple[str, str]
) -> None:
    assert tables(tmp_path) == 0
    path = tmp_path / "rows.jsonl"
    rows = [{**row, change[0]: change[1]} if row["system"] == "ants" else row for row in read_rows(path)]
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    assert tables(tmp_path) == 0
    assert [block.system for block in counted[6:]] == ["ants"] * 3
    assert len(read_rows(path)) == 18  # the old ones are gone


def test_other_runs_and_seeds_are_run_anew(tmp_path: Path, counted: list[Block]) -> None:
    assert tables(tmp_path, "--runs", "2") == 0
    assert tables(tmp_path, "--runs", "2", "--seed", "1") == 0
    assert len(counted) == 12
    assert len(read_rows(tmp_path / "rows.jsonl")) == 12


def timeless(block: Block) -> list[Row]:
    rows = block.run(lambda done: None).rows
    return [{k: v for k, v in row.items() if not k.endswith("ms")} for row in rows]


def test_same_seed_gives_the_same_rows(toy: Study) -> None:
    block = blocks_of("toy_paper", toy, 2, 0)[0]
    same = timeless(block)
    assert same == timeless(block)


def test_pictures(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    assert main(["tables", "papers", "--out", str(tmp_path), "--processes", "1", "--runs", "1"]) == 0
    assert {path.name for path in tmp_path.glob("*.png")} == {
        "toy_paths_open.png", "toy_paths_shelves.png", "toy_convergence_open.png", "toy_convergence_shelves.png",
    }  # fmt: skip
    assert "![open: each system's best run](toy_paths_open.png)" in (tmp_path / "toy.md").read_text()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--runs", "0"), "runs=0"),
        (("--seed", "-1"), "seed=-1"),
        (("--processes", "0"), "processes=0"),
        (("--papers", "999"), "999"),
        (("--tables", "toys"), "toy"),
    ],
)
def test_bad_options(tmp_path: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], words: str) -> None:
    assert main(["tables", "papers", "--out", str(tmp_path / "out"), *options]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_index_names_tables_made_before(tmp_path: Path, toy: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    both = (toy, dataclasses.replace(toy, name="toy_2", title="Another toy"))
    monkeypatch.setattr(sys.modules["toy_paper"], "STUDIES", both)
    assert tables(tmp_path, "--tables", "toy") == 0
    assert "Another toy" not in (tmp_path / "README.md").read_text()
    assert tables(tmp_path, "--tables", "toy_2", "--fresh") == 0
    index = (tmp_path / "README.md").read_text()
    assert "A toy table" in index
    assert "Another toy" in index
    assert len(read_rows(tmp_path / "rows.jsonl")) == 36
