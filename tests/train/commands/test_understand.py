"""`warehouse understand` and `warehouse curves`: pictures and rows of policies and of runs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from agents import POLICIES
from train.cli import main
from train.commands import understand
from train.evaluation import telling
from train.evaluation.scenes import SCENES
from train.evaluation.telling import MOMENTS
from train.reporting.rows import read_rows, write_rows

pytest.importorskip("matplotlib")


def made_up(folder: Path, algorithm: str, seed: int, goals: list[float | None]) -> Path:
    """A run whose rows have these goals per robot-hour at 1, 2, 3 ... million steps."""
    shipped = POLICIES["ppo"].weights
    assert shipped is not None
    record = json.loads((shipped / "config.json").read_text())
    record["algorithm"], record["training"]["config"]["seed"] = algorithm, seed
    folder.mkdir(parents=True)
    (folder / "config.json").write_text(json.dumps(record))
    write_rows(
        folder / "progress.jsonl",
        (
            {
                "steps": (k + 1) * 1_000_000,
                "goals_per_robot_hour": g,
                "collisions_per_km": 2.0 / (k + 1),
                "entropy": 1.0,
            }
            for k, g in enumerate(goals)
        ),
    )
    return folder


def test_curves_of_two_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = [made_up(tmp_path / "a", "ppo", 0, [10.0, None, 30.0]), made_up(tmp_path / "b", "reinforce", 1, [5.0, 7.0])]
    picture, rows = tmp_path / "curves.png", tmp_path / "rows.jsonl"
    assert main(["curves", *map(str, runs), "--out", str(picture), "--json", str(rows)]) == 0
    assert "2 runs" in capsys.readouterr().out
    assert picture.read_bytes()[1:4] == b"PNG"
    found = [(row["run"], row["algorithm"], row["steps"], row["goals_per_robot_hour"]) for row in read_rows(rows)]
    assert found == [
        ("a", "ppo", 1e6, 10.0), ("a", "ppo", 2e6, None), ("a", "ppo", 3e6, 30.0),
        ("b", "reinforce", 1e6, 5.0), ("b", "reinforce", 2e6, 7.0),
    ]  # fmt: skip
    assert main(["curves", *map(str, runs), "--seed", "1", "--out", str(picture), "--json", str(rows)]) == 0
    assert {row["seed"] for row in read_rows(rows)} == {1}
    capsys.readouterr()
    assert main(["curves", *map(str, runs), "--seed", "2", "--out", str(picture)]) == 2
    assert "no run was trained with --seed 2" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("rows", "part"),
    [("", "no rows"), ('{"steps": 2}\n{"steps": 1}\n', "steps grow"), ('{"seed": 2}\n', "none of a training")],
)
def test_damaged_runs_are_named(rows: str, part: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = made_up(tmp_path / "run", "ppo", 0, [1.0])
    (run / "progress.jsonl").write_text(rows)
    assert main(["curves", str(run), "--out", str(tmp_path / "c.png")]) == 2
    said = capsys.readouterr().err
    assert "progress.jsonl" in said
    assert part in said
    (run / "progress.jsonl").unlink()
    assert main(["curves", str(run), "--out", str(tmp_path / "c.png")]) == 2
    assert "it has no progress.jsonl" in capsys.readouterr().err
    assert not (tmp_path / "c.png").exists()


def test_pictures_and_rows_of_a_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(understand, "MOMENTS", {"leaving": MOMENTS["leaving"]})
    monkeypatch.setattr(telling, "SCENES", {"crossing": SCENES["crossing"]})
    run = made_up(tmp_path / "run", "ppo", 0, [10.0, 20.0])
    options = f"--policy ppo --planner astar --seed 3 --runs {run} --out {tmp_path / 'out'}"
    assert main(["understand", *options.split()]) == 0
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"leaving_ppo.png", "jam_ppo.png", "overview_ppo.png", "rows.jsonl"}
    rows = read_rows(tmp_path / "out" / "rows.jsonl")
    assert {row["scene"] for row in rows} == {"leaving", "crossing"}
    assert all(0 <= row[name] <= 1 for row in rows for name in ("stop", "slow", "right", "left"))
    assert {(row["policy"], row["seed"]) for row in rows} == {("ppo", 3)}
    assert sum(row["scene"] == "crossing" for row in rows) == 16  # four robots in four moments
    assert main(["understand", *options.split(), "--seconds", "1", "--overwrite"]) == 0
    assert "no jam" in capsys.readouterr().out
