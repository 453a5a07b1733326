"""`warehouse audit`: of recordings, clean and doctored, and of what drives; what is refused."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from train.cli import main
from train.reporting.rows import read_rows
from warehouse_env.simulation.record.recording import Episode

DRIVE = "--layout open --robots 4 --planner astar --seconds 5 --seed 4"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An episode of 5 s."""
    path = tmp_path_factory.mktemp("episodes") / "ppo.npz"
    assert main(["record", "--policy", "ppo", *DRIVE.split(), "--out", str(path)]) == 0
    return path


def audit(out: Path, *words: str | Path) -> int:
    """Run an audit and return its exit code."""
    return main(["audit", *map(str, words), "--out", str(out)])


def test_a_recording_is_clean(recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert audit(tmp_path, recorded) == 0
    (row,) = read_rows(tmp_path / "rows.jsonl")
    assert (row["policy"], row["robots"], row["seed"], row["steps"]) == ("ppo", 4, 4, 50)
    assert (row["episode"], row["differs_at"], row["faults"]) == (str(recorded), None, [])
    assert row["robot_km"] > 0.005
    assert "no faults" in capsys.readouterr().out
    assert (tmp_path / "table.md").read_text(encoding="utf-8").startswith("### Audit")


def test_a_doctored_one_is_not(recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    episode = Episode.load(recorded)
    pose = episode.pose.copy()
    pose[30, 0, 2, 0] += 1e-5
    dataclasses.replace(episode, pose=pose).save(tmp_path / "doctored.npz")
    assert audit(tmp_path, recorded, tmp_path / "doctored.npz") == 1
    said = capsys.readouterr().out
    assert f"at step 30 {tmp_path}/doctored.npz has other poses than this version drives" in said
    assert "1 fault;" in said
    assert [row["differs_at"] for row in read_rows(tmp_path / "rows.jsonl")] == [None, 30]


def test_what_is_shipped_is_clean_as_it_drives(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--policy", "greedy", "ppo", *DRIVE.split(), "--episodes", "2"]
    assert audit(tmp_path, *words) == 0
    rows = read_rows(tmp_path / "rows.jsonl")
    assert [(row["policy"], row["seed"]) for row in rows] == [("greedy", 4), ("greedy", 5), ("ppo", 4), ("ppo", 5)]
    assert all(row["goals_per_robot_hour"] is not None for row in rows)
    text = (tmp_path / "rows.jsonl").read_text()
    (tmp_path / "rows.jsonl").write_text(text[: len(text) - 5])  # cut off within a row, as a kill leaves it
    capsys.readouterr()
    assert audit(tmp_path, *words, "--resume") == 0
    assert len(read_rows(tmp_path / "rows.jsonl")) == 4
    assert "no faults" in capsys.readouterr().out


def test_what_is_disturbed_is_audited_as_it_is_then(tmp_path: Path) -> None:
    words = ["--policy", "greedy", *DRIVE.split(), "--episodes", "1", "--disturbance", "none", "slow"]
    assert audit(tmp_path, *words) == 0
    undisturbed, disturbed = read_rows(tmp_path / "rows.jsonl")
    assert (undisturbed["disturbance"], disturbed["disturbance"]) == ("none", "slow")
    assert disturbed["config"]["robot"]["max_speed"] == 0.8
    assert disturbed["robot_km"] != undisturbed["robot_km"]
