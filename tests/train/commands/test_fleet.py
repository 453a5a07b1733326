"""`warehouse fleet`: from an episode to messages and back, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.render.episodes import driven
from tests.train.fleet.stories import lines, write_lines
from train.cli import main


def test_there_and_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    episode, folder = tmp_path / "e.npz", tmp_path / "fleet"
    driven().save(episode)
    assert main(["fleet", str(episode), "--out", str(folder), "--json", str(tmp_path / "w.jsonl")]) == 0
    assert lines(tmp_path / "w.jsonl")[0]["robots"] == 7
    assert main(["fleet", "--check", str(folder)]) == 0
    assert "no faults" in capsys.readouterr().out
    command = ["fleet", "--listen", str(folder), "--map", str(folder / "floor.yaml")]
    assert main([*command, "--out", str(folder), "--json", str(tmp_path / "rows.jsonl")]) == 0
    (real,) = lines(tmp_path / "rows.jsonl")
    assert (real["policy"], real["robots"]) == ("fleet", 7)
    assert real["goals"] > 0
    assert real["reroutes"] is None
    assert len(real["vehicles"]) == 7
    page = tmp_path / "page.html"
    assert main(["replay", str(folder / "episode.npz"), "--html", str(page)]) == 0
    assert '"idle":"says nothing"' in page.read_text()
    assert "wrote the episode" in capsys.readouterr().out
    assert main(["audit", str(folder / "episode.npz"), "--out", str(tmp_path)]) == 2
    assert "cannot be run again" in capsys.readouterr().err


def test_a_fault_is_an_exit_code(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = write_lines(tmp_path / "log.jsonl", [{"topic": "uagv/v2/A/1/state", "payload": {}}])
    assert main(["fleet", "--check", str(log), "--json", str(tmp_path / "c.jsonl")]) == 1
    assert "line 1, A/1: schema: in this state" in capsys.readouterr().out
    assert json.loads((tmp_path / "c.jsonl").read_text())["faults"] == 1
