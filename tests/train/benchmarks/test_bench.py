"""Test speeds and ratios with a manual clock, every part on a tiny budget, and the check against the release."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest
import torch

from train.benchmarks import parts, reference
from train.benchmarks import peers as peers_part
from train.benchmarks.fixed_work import FixedWork, compiler
from train.benchmarks.parts import PARTS
from train.benchmarks.reference import ROOT, Size, reference_table
from train.benchmarks.timing import Timed, in_turns, speeds
from train.cli import main
from train.commands.bench import What, tables
from train.learning.recipes import RECIPES
from train.reporting.rows import Row, read_rows, write_rows
from warehouse_env.errors import WarehouseError
from warehouse_env.simulation.device import memory, simulator
from warehouse_env.threads import get_num_threads, set_num_threads

SMALL: dict[str, Any] = {
    "layouts": ("open",), "robots": (2,), "rows": 8, "planner": "astar", "rollout": 4, "hidden": (20,), "threads": 1,
}  # fmt: skip
TINY = 0.02  # [s]


@pytest.fixture(autouse=True)
def same_threads() -> Iterator[None]:
    """Restore the number of threads, which each part sets."""
    before = get_num_threads()
    yield
    set_num_threads(before)


class Clock:
    """Manual clock that records the order of work."""

    def __init__(self) -> None:
        self.now, self.order = 0.0, ""

    def __call__(self) -> float:
        return self.now

    def takes(self, seconds: float, name: str = "") -> Any:
        """Return work that takes `seconds`."""

        def call(_: int) -> None:
            self.now, self.order = self.now + seconds, self.order + name

        return call


def test_speeds_by_a_manual_clock() -> None:
    clock = Clock()
    fast, slow = speeds([(clock.takes(0.25, "f"), 8), (clock.takes(1.0, "s"), 8)], 9.0, clock)
    assert [fast[name] for name in ("agent_steps_per_s", "low", "high")] == pytest.approx([32.0] * 3)
    assert slow["agent_steps_per_s"] == pytest.approx(8.0)
    # one call to compile, calls for a second to count, then turns
    assert clock.order == 5 * "f" + 2 * "s" + 9 * "ffffs"


@pytest.mark.parametrize("what", ["simulator", "vec_env"])
def test_parts_measure_positive_speeds(what: str) -> None:
    rows = list(PARTS[what](TINY))
    assert rows
    assert all(row["agent_steps_per_s"] > 0 for row in rows)


def test_each_part_begins_with_the_number_of_threads_of_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    begins = []

    def part(seconds: float) -> Iterator[Row]:
        begins.append(get_num_threads())
        set_num_threads(1)
        yield from ()

    for name in ("pettingzoo", "vec_env"):
        monkeypatch.setitem(PARTS, name, part)
    set_num_threads(2)
    assert main(["bench", "--only", "pettingzoo", "vec_env"]) == 0
    assert begins == [2, 2]


def test_every_trainer_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, (kind, changes) in list(RECIPES.items()):
        monkeypatch.setitem(RECIPES, name, (kind, changes | SMALL))
    rows = list(PARTS["training"](TINY))
    assert list(PARTS) == list(get_args(What))
    assert [(row["what"], row["trainer"]) for row in rows] == [
        ("train fixed_routes_reinforce", "reinforce (ours)"),
        ("train fixed_routes", "ppo (ours)"),
        ("train fixed_routes_ppo", "ppo (stable-baselines3)"),
    ]
    for row in rows:
        assert row["low"] <= row["agent_steps_per_s"] <= row["high"]
        assert sum(row["shares"].values()) == pytest.approx(1.0)


def test_bench_writes_rows_and_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "rows.jsonl"
    assert main(["bench", "--only", "pettingzoo", "--seconds", "0.02", "--json", str(path)]) == 0
    (row,) = read_rows(path)
    assert (row["what"], row["envs"], row["agents"], row["threads"]) == ("pettingzoo", 1, 8, 1)
    assert "pettingzoo" in capsys.readouterr().out


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_missing_gpu_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--only", "cuda"]) == 2
    assert re.search("numba-cuda|PyTorch", capsys.readouterr().err)


def test_device_worlds_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "_ON_CARD", ((2, 4, "rules:routes=false"),))
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda device: "a card")
    monkeypatch.setattr(simulator, "memory_of", lambda device: memory.Memory())
    (row,) = parts.cuda(TINY)
    assert (row["envs"], row["agents"], row["traffic"], row["card"]) == (2, 4, "rules:routes=false", "a card")
    assert 0 < row["low"] <= row["agent_steps_per_s"] <= row["high"]


def test_peers_are_measured_in_turns(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(peers_part, "SIZES", (2,))
    monkeypatch.setattr(os, "sched_setaffinity", lambda *_: None, raising=False)
    monkeypatch.setattr(peers_part, "PEERS", {"warehouse-env": peers_part._ours, "none-such": peers_part._vmas})
    assert main(["bench", "--only", "peers"]) == 2
    assert "pip install vmas jaxmarl camar" in capsys.readouterr().err
    monkeypatch.setattr(peers_part, "PEERS", {"warehouse-env": peers_part._ours, "numpy": peers_part._ours})
    rows = [{"what": "peers", **row} for row in PARTS["peers"](TINY)]
    assert [row["simulator"].split()[0] for row in rows] == ["warehouse-env", "numpy"]
    (table,) = tables(rows)
    assert [line[:4] for line in table.cells] == [(row["simulator"], "2", "16", "1") for row in rows]


@pytest.mark.parametrize("package", ["vmas", "jaxmarl", "camar"])
def test_a_peer_steps(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip(package)
    monkeypatch.setenv("JAX_PLATFORMS", "cpu")
    call, rows = peers_part.PEERS[package](2, "cpu")
    call(0)
    assert rows % (2 * peers_part.ROBOTS) == 0


needs_compiler = pytest.mark.skipif(compiler() is None, reason="there is no C compiler")


RUNS = ("same work", "random commands", "full speed", "training")


@needs_compiler
def test_fixed_work_is_reproducible(tmp_path: Path) -> None:
    ends = []
    for _ in range(2):
        work = FixedWork(2, 8, tmp_path)
        for k in range(40):
            work(k)
        ends.append(work.seen)
    assert np.array_equal(ends[0], ends[1])
    assert np.isfinite(ends[0]).all()
    assert ends[0].std() > 0.3


def test_ratios_by_a_manual_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    monkeypatch.setattr(reference, "time", SimpleNamespace(process_time=clock))
    ours, theirs = Timed(clock.takes(3.0), rows=2, steps=5), Timed(clock.takes(1.0), rows=4, steps=7)
    assert in_turns([ours, theirs], 3, clock) == [pytest.approx([1.5e6] * 3), pytest.approx([0.25e6] * 3)]
    row = reference._ratio(ours, theirs, 4)
    assert (row["ratio"], row["low"], row["high"]) == pytest.approx((1 / 6,) * 3)
    assert (row["us_a_robot"], row["reference_us"]) == pytest.approx((1.5e6, 0.25e6))


@needs_compiler
def test_every_reference_row_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_drop_by_a_third_below_the_release_fails(tmp_path: Path) -> None:
    path = tmp_path / "release.jsonl"
    write_rows(path, [row(0.9), row(0.6, "full speed")])
    reference.judge([row(0.61), row(0.41, "full speed")], path)
    with pytest.raises(WarehouseError) as error:
        reference.judge([row(0.6), row(0.41, "full speed")], path)
    for part in ("random commands at 64 x 16 fell from 0.9 of the speed of C to 0.6", "abc1234", reference.RENEW):
        assert part in str(error.value)
    assert "full speed" not in str(error.value)
    with pytest.raises(WarehouseError, match=r"no ratio for parked at 64 x 16: .*--json train"):
        reference.judge([row(0.9), row(0.9, "parked")], path)


def test_release_has_every_ratio() -> None:
    rows = read_rows(reference.RELEASE)
    wanted = [(run, size.worlds, size.robots) for size in reference.SIZES for run in RUNS]
    wanted += [("greedy's decision", 1, robots) for robots in reference.DECISIONS]
    assert [(one["run"], one["envs"], one["agents"]) for one in rows] == wanted
    assert all(one["chunks"] == 9 for one in rows)  # the same length as in the check


@needs_compiler
def test_bench_checks_against_the_release(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(reference, "SIZES", (Size(1, 2, 1, 1, 1, 1),))
    monkeypatch.setattr(reference, "DECISIONS", {})
    path = tmp_path / "release.jsonl"
    monkeypatch.setattr(reference.judge, "__defaults__", (path,))
    bench = ["bench", "--only", "reference", "--seconds", "0.6"]
    assert main([*bench, "--json", str(path)]) == 0
    written = read_rows(path)
    assert {"commit", "date", "ratio", "version"} <= set(written[0])
    write_rows(path, [{**one, "ratio": one["ratio"] / 1e3} for one in written])
    assert main([*bench, "--check"]) == 0
    write_rows(path, [{**one, "ratio": one["ratio"] * 1e3} for one in written])
    capsys.readouterr()
    assert main([*bench, "--check"]) == 2
    assert "the step has lost a third of its speed" in capsys.readouterr().err
    assert main(["bench", "--only", "simulator", "--check"]) == 2
    assert main(["bench", "--rows", str(path)]) == 0
    assert "| same work | 1 x 2 | " in capsys.readouterr().out


def test_page_shows_the_releases_table() -> None:
    page = (ROOT / "docs/measured/speed.md").read_text(encoding="utf-8")
    shown = f"warehouse bench --rows {reference.RELEASE.relative_to(ROOT).as_posix()}"
    assert shown in page
    _, table = reference_table(read_rows(reference.RELEASE)).markdown().split("\n", 1)
    assert table.strip() in page, f"put into the page what `{shown}` prints"
