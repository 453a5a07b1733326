"""The same training under several seeds: here and on a cluster the same weights, whatever is killed on the way."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from train.cli import main
from train.commands import seeds
from train.evaluation.cluster import connected, streams
from train.learning import away
from train.reporting.rows import read_rows
from warehouse_env.errors import LostError

SHORT = (
    "train", "reinforce", "--layouts", "open", "--robots", "2", "--rows", "8", "--planner", "astar", "--steps", "384",
    "--rollout", "6", "--minibatch", "24", "--hidden", "24", "--episode-seconds", "3", "--evaluation-seconds", "0",
    "--threads", "1", "--no-progress", "--checkpoint-seconds", "0", "--name", "mine",
)  # fmt: skip


def weights(folder: Path) -> list[bytes]:
    return [(folder / f"mine-{seed}" / "weights.safetensors").read_bytes() for seed in (4, 5)]


def test_each_seed_has_its_folder_and_all_have_a_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    line = [*SHORT, "--seed", "4", "--out", "runs", "--json", "rows.jsonl"]
    assert main([*line, "--seeds", "2"]) == 0
    shown = capsys.readouterr().out
    assert shown.count("(best)") == 1
    assert "mean" in shown
    assert {row["run"] for row in read_rows(Path("rows.jsonl"))} == {"mine-4", "mine-5"}
    alone = [*SHORT[:-1], "alone", "--seed", "5", "--out", "runs"]
    assert main(alone) == 0
    first, second = weights(Path("runs"))
    assert first != second == Path("runs/alone/weights.safetensors").read_bytes()
    monkeypatch.setattr("train.reinforce.train", None)  # what has ended is not trained again
    assert main([*line, "--seeds", "2"]) == 0


@pytest.mark.xdist_group("ray")
def test_side_by_side_with_a_worker_killed_they_are_the_same(
    two_nodes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "here").mkdir()
    (tmp_path / "there").mkdir()
    killed: list[int] = []
    write = seeds.write

    def write_and_kill(folder: Path, changes: away.Changes) -> None:
        write(folder, changes)
        if not killed:
            killed.append(_kill_a_training())

    monkeypatch.setattr(seeds, "write", write_and_kill)
    line = [*SHORT, "--seed", "4", "--seeds", "2", "--steps", "3840"]
    monkeypatch.chdir(tmp_path / "there")
    assert main([*line, "--ray", two_nodes.address]) == 0
    monkeypatch.chdir(tmp_path / "here")
    assert main(line) == 0
    assert killed
    assert weights(tmp_path / "here" / "runs") == weights(tmp_path / "there" / "runs")


@pytest.mark.xdist_group("ray")
def test_what_is_lost_again_and_again_is_named_after_all_others(two_nodes: Any, tmp_path: Path) -> None:
    given: list[tuple[int, int]] = []
    with connected(two_nodes.address) as ray:
        names = ["seed 7", "seed 8", "seed 9"]
        streamed = streams(ray, counting, 1, names, lambda number: (number == 1,))
        with pytest.raises(LostError, match="seed 8 lost their worker 4 times"):
            given.extend(streamed)
    assert sorted(given) == [(0, 0), (0, 1), (2, 0), (2, 1)]


def counting(killed: bool) -> Iterator[int]:
    """Give 0 and 1, or kill the process."""
    if killed:
        os.kill(os.getpid(), signal.SIGKILL)
    yield 0
    yield 1


def _kill_a_training() -> int:
    """Kill the process of a node that trains; return its number."""
    deadline = time.monotonic() + 20.0
    while time.monotonic() < deadline:
        for process in _training():
            os.kill(process, signal.SIGKILL)
            return process
    raise AssertionError("nobody trains")


def _training() -> Iterator[int]:
    for folder in Path("/proc").iterdir():
        if folder.name.isdecimal():
            try:
                if b"train_away" in (folder / "cmdline").read_bytes():
                    yield int(folder.name)
            except OSError:
                continue


def test_wrong_options_are_said_in_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for options, sentence in (
        (("--seeds", "0"), "--seeds 0 must lie between 1 and 10,000"),
        (("--seeds", "2", "--resume", str(tmp_path)), "--resume must be left out with --seeds 2"),
        (("--seeds", "2", "--ray", "local", "--out", str(tmp_path)), f"--out {tmp_path} must be relative"),
        (("--ray", "nobody"), "--ray 'nobody' must be auto, local or HOST:PORT"),
    ):
        assert main([*SHORT, *options]) == 2
        assert sentence in capsys.readouterr().err
