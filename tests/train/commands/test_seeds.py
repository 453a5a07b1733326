"""The same training under several seeds: a folder for each, and a table."""

from __future__ import annotations

from pathlib import Path

import pytest

from train.cli import main
from train.reporting.rows import read_rows

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


def test_wrong_options_are_said_in_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for options, sentence in (
        (("--seeds", "0"), "--seeds 0 must lie between 1 and 10,000"),
        (("--seeds", "2", "--resume", str(tmp_path)), "--resume must be left out with --seeds 2"),
    ):
        assert main([*SHORT, *options]) == 2
        assert sentence in capsys.readouterr().err
