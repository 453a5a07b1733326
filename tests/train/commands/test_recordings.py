"""Test `warehouse record`, `replay` and `audit` on clean and manipulated episodes."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import pytest

from agents import WEIGHTS_FOLDER
from tests.train.test_cli import fails
from train.cli import main
from train.reporting.rows import read_rows
from warehouse_env.simulation.record.recording import Episode


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Record episodes of 6 s of two policies with different decision intervals."""
    folder = tmp_path_factory.mktemp("episodes")
    paths = folder / "ppo.npz", folder / "brake.npz"
    for path in paths:
        options = f"--policy {path.stem} --layout open --robots 3 --planner astar --seconds 6 --seed 4"
        assert main(["record", *options.split(), "--out", str(path)]) == 0
    return paths


def run(capsys: pytest.CaptureFixture[str], *words: str | Path) -> str:
    """Run a replay and return its output."""
    assert main(["replay", *map(str, words)]) == 0
    return capsys.readouterr().out


def refused(capsys: pytest.CaptureFixture[str], *words: str | Path) -> str:
    """Run a replay that is refused and return its error."""
    return fails(capsys, "replay", *map(str, words))


def test_two_episodes_on_one_page(files: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "new" / "page.html"
    run(capsys, *files, "--html", page)
    assert "<title>ppo and brake</title>" in page.read_text(encoding="utf-8")


def test_video_has_the_stated_duration(
    files: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    pytest.importorskip("pygame")
    path = tmp_path / "clip.mp4"
    printed = run(capsys, *files, "--video", path, "--speed", "3")
    assert printed == f"wrote the video to {path}: 2 s at 3 times the speed\n"
    count, seconds = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert count == 61
    assert seconds == pytest.approx(61 / 30, abs=0.11)


def test_bad_options_are_refused(files: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "page.html"
    assert "choose one of --html FILE and --video FILE" in refused(capsys, files[0])
    assert "choose one of" in refused(capsys, files[0], "--html", page, "--video", "a.mp4")
    assert "one episode file, or two" in refused(capsys, *files, files[0], "--html", page)
    assert "nowhere.npz does not exist" in refused(capsys, "nowhere.npz", "--html", page)
    assert "has no world of seed 7; its seeds are 4" in refused(capsys, files[0], "--html", page, "--seed", "7")
    assert "speed=0" in refused(capsys, files[0], "--html", page, "--speed", "0")
    assert "must end in .mp4 or .gif" in refused(capsys, files[0], "--video", tmp_path / "clip.avi")
    assert "is a folder" in refused(capsys, files[0], "--html", tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_replay_ignores_another_policy_of_the_same_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for place, policy in (("here", "ppo"), ("there", "reinforce")):
        shutil.copytree(WEIGHTS_FOLDER / policy, tmp_path / place / "runs/mine")
    monkeypatch.chdir(tmp_path / "here")
    options = "--policy runs/mine --layout open --robots 2 --planner astar --seconds 2 --out one.npz"
    assert main(["record", *options.split()]) == 0
    for place in ("here", "there"):
        monkeypatch.chdir(tmp_path / place)
        assert main(["replay", "../here/one.npz", "--html", "page.html"]) == 0
        note = "without the policy's preferences: runs/mine is not the policy that was recorded"
        assert (note in capsys.readouterr().err) == (place == "there")


DRIVE = "--layout open --robots 4 --planner astar --seconds 5 --seed 4"


def audit(out: Path, *words: str | Path) -> int:
    """Run an audit and return its exit code."""
    return main(["audit", *map(str, words), "--out", str(out)])


def test_audit_passes_a_recording(files: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert audit(tmp_path, files[0]) == 0
    (row,) = read_rows(tmp_path / "rows.jsonl")
    assert (row["policy"], row["robots"], row["seed"], row["steps"]) == ("ppo", 3, 4, 60)
    assert (row["episode"], row["differs_at"], row["faults"]) == (str(files[0]), None, [])
    assert row["robot_km"] > 0.005
    assert "no faults" in capsys.readouterr().out
    assert (tmp_path / "table.md").read_text(encoding="utf-8").startswith("### Audit")


def test_audit_finds_moved_poses(files: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    episode = Episode.load(files[0])
    pose = episode.pose.copy()
    pose[30, 0, 2, 0] += 1e-5
    dataclasses.replace(episode, pose=pose).save(tmp_path / "doctored.npz")
    assert audit(tmp_path, files[0], tmp_path / "doctored.npz") == 1
    printed = capsys.readouterr().out
    assert f"at step 30 {tmp_path}/doctored.npz has other poses than this version drives" in printed
    assert "1 fault;" in printed
    assert [row["differs_at"] for row in read_rows(tmp_path / "rows.jsonl")] == [None, 30]


def test_audit_passes_shipped_policies_and_resumes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--policy", "greedy", "ppo", *DRIVE.split(), "--episodes", "2"]
    assert audit(tmp_path, *words) == 0
    rows = read_rows(tmp_path / "rows.jsonl")
    assert [(row["policy"], row["seed"]) for row in rows] == [("greedy", 4), ("greedy", 5), ("ppo", 4), ("ppo", 5)]
    assert all(row["goals_per_robot_hour"] is not None for row in rows)
    text = (tmp_path / "rows.jsonl").read_text()
    (tmp_path / "rows.jsonl").write_text(text[: len(text) - 5])  # cut within a row, as after a kill
    capsys.readouterr()
    assert audit(tmp_path, *words, "--resume") == 0
    assert len(read_rows(tmp_path / "rows.jsonl")) == 4
    assert "no faults" in capsys.readouterr().out


def test_audit_covers_disturbances(tmp_path: Path) -> None:
    words = ["--policy", "greedy", *DRIVE.split(), "--episodes", "1", "--disturbance", "none", "slow"]
    assert audit(tmp_path, *words) == 0
    undisturbed, disturbed = read_rows(tmp_path / "rows.jsonl")
    assert (undisturbed["disturbance"], disturbed["disturbance"]) == ("none", "slow")
    assert disturbed["config"]["robot"]["max_speed"] == 0.8
    assert disturbed["robot_km"] != undisturbed["robot_km"]
