"""The benchmark: speeds by a fake clock, and parts on a tiny budget."""

from __future__ import annotations

import os
import re
from functools import partial
from pathlib import Path
from typing import Any, get_args

import pytest
import torch

from train.benchmarks import parts
from train.benchmarks import peers as peers_part
from train.benchmarks.parts import PARTS
from train.benchmarks.timing import speeds
from train.cli import main
from train.commands.bench import What, tables
from train.learning import recipes
from train.learning.recipes import by_recipe
from train.reporting.rows import read_rows
from warehouse_env.simulation.device import memory, simulator
from warehouse_env.threads import get_num_threads, set_num_threads

SMALL: dict[str, Any] = {
    "layouts": ("open",), "robots": (2,), "rows": 8, "planner": "astar", "rollout": 4, "hidden": (20,), "threads": 1,
}  # fmt: skip
TINY = 0.02  # [s]


def test_speeds_by_a_clock_in_hand() -> None:
    now, order = 0.0, ""

    def takes(seconds: float, name: str) -> Any:
        def call(_: int) -> None:
            nonlocal now, order
            now, order = now + seconds, order + name

        return call

    fast, slow = speeds([(takes(0.25, "f"), 8), (takes(1.0, "s"), 8)], 9.0, lambda: now)
    assert [fast[name] for name in ("agent_steps_per_s", "low", "high")] == pytest.approx([32.0] * 3)
    assert slow["agent_steps_per_s"] == pytest.approx(8.0)
    assert order == 5 * "f" + 2 * "s" + 9 * "ffffs"  # the first call may compile, then a second to count, then turns


@pytest.mark.parametrize("what", ["simulator", "vec_env"])
def test_parts_measure(what: str) -> None:
    rows = list(PARTS[what](TINY))
    assert rows
    assert all(row["agent_steps_per_s"] > 0 for row in rows)


def test_a_part_leaves_the_number_of_threads_as_it_was(request: pytest.FixtureRequest) -> None:
    request.addfinalizer(partial(set_num_threads, get_num_threads()))
    set_num_threads(3)
    for _ in PARTS["vec_env"](TINY):
        assert get_num_threads() == 1
    assert get_num_threads() == 3


def test_every_trainer_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recipes, "by_recipe", lambda kind, recipe, **given: by_recipe(kind, recipe, **given | SMALL))
    rows = list(PARTS["training"](TINY))
    assert list(PARTS) == list(get_args(What))
    assert [row["what"] for row in rows] == ["train_reinforce", "train_threaded_ppo", "train_ppo"]
    for row in rows:
        assert row["low"] <= row["agent_steps_per_s"] <= row["high"]
        assert sum(row["shares"].values()) == pytest.approx(1.0)


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "rows.jsonl"
    assert main(["bench", "--only", "pettingzoo", "--seconds", "0.02", "--json", str(path)]) == 0
    (row,) = read_rows(path)
    assert (row["what"], row["envs"], row["agents"], row["threads"]) == ("pettingzoo", 1, 8, 1)
    assert "pettingzoo" in capsys.readouterr().out


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_gpu_that_is_not_there_is_missed_in_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--only", "cuda"]) == 2
    assert re.search("numba-cuda|PyTorch", capsys.readouterr().err)


def test_worlds_on_a_device_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
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
