"""The benchmark: rates by a fake clock, ratios by hand, and parts on a tiny budget."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any, get_args

import pytest
import torch

from train.benchmarks import parts
from train.benchmarks.parts import PARTS, Budget, rate
from train.cli import main
from train.commands.bench import What, ratios, tables
from train.learning import recipes
from train.learning.recipes import by_recipe
from train.reporting.rows import read_rows
from warehouse_env.simulation.device import memory, simulator

SMALL: dict[str, Any] = {
    "layouts": ("open",), "robots": (2,), "rows": 8, "planner": "astar", "rollout": 4, "hidden": (20,), "threads": 1,
}  # fmt: skip
TINY = Budget(seconds=0.02, largest=32, threads=(1,), seed=0)


def test_rate_by_a_clock_in_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = itertools.count()
    monkeypatch.setattr(parts.time, "perf_counter", lambda: 0.5 * next(ticks))
    calls: list[int] = []
    measured = rate(calls.append, seconds=9.0)
    # Each chunk is timed by two readings half a second apart, so its rate is twice its calls.
    per_chunk = measured.median / 2
    assert measured.low == measured.median == measured.high
    assert per_chunk == int(per_chunk)
    assert calls == list(range(len(calls)))


def simulator_row(envs: int, agents: int, threads: int, speed: float) -> dict[str, Any]:
    return {"what": "simulator", "envs": envs, "agents": agents, "threads": threads, "agent_steps_per_s": speed}


def test_ratios_by_hand() -> None:
    rows = [
        simulator_row(64, 16, 1, 1000.0), simulator_row(64, 16, 2, 1900.0), simulator_row(1, 32, 1, 800.0),
        simulator_row(1, 1024, 1, 600.0),
    ]  # fmt: skip
    assert ratios(rows) == ["64x16, 2 threads over 1: 1.90", "1x1024 over 1x32: 0.75"]
    trained = [
        {"what": f"train_{name}", "trainer": name, "envs": 1, "agents": "2", "agent_steps_per_s": speed}
        for name, speed in (("reinforce", 300.0), ("ppo", 100.0))
    ]
    assert ratios(trained) == ["train_reinforce over train_ppo: 3.00"]
    (table,) = tables(rows)
    assert table.cells[0][:5] == ("simulator", "64", "16", "1", "1,000")


@pytest.mark.parametrize("what", ["simulator", "vec_env"])
def test_parts_measure(what: str) -> None:
    rows = list(PARTS[what](TINY))
    assert rows
    assert all(row["agent_steps_per_s"] > 0 for row in rows)


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
    assert row["env_steps_per_s"] * 8 == pytest.approx(row["agent_steps_per_s"])
    assert "pettingzoo" in capsys.readouterr().out


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_gpu_that_is_not_there_is_missed_in_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--only", "cuda", "--quick"]) == 2
    assert "device='cuda' needs" in capsys.readouterr().err


def test_worlds_on_a_device_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "_ON_CARD", ((2, 4, False),))
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda device: "a card")
    monkeypatch.setattr(simulator, "memory_of", lambda device: memory.Memory())
    (row,) = parts.cuda(TINY)
    assert (row["envs"], row["agents"], row["shield"], row["card"]) == (2, 4, False, "a card")
    assert 0 < row["low"] <= row["agent_steps_per_s"] <= row["high"]
