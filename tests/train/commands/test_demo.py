"""The demo, much shortened: everything it promises is in its folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from train.cli import main
from train.reporting.rows import read_rows


def test_demo_writes_rows_pictures_and_a_video(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for package in ("matplotlib", "pygame", "imageio_ffmpeg"):
        pytest.importorskip(package)
    options = "--policy follow ppo --layout open --robots 2 --episodes 1 --planner astar"
    short = "--seconds 10 --video-seconds 1 --processes 1"
    assert main(["demo", *options.split(), *short.split(), "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "collisions/km" in printed
    assert "all else to" in printed
    assert {path.name for path in tmp_path.iterdir()} == {
        "rows.jsonl", "table.md", "collisions.png", "video.mp4",
    }  # fmt: skip
    assert len(read_rows(tmp_path / "rows.jsonl")) == 2
    assert (tmp_path / "video.mp4").read_bytes()[4:8] == b"ftyp"
