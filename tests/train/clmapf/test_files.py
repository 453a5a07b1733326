"""The benchmark's files and the command: what is read is right, and bad input ends in one sentence."""

from __future__ import annotations

from pathlib import Path

import pytest

from train.cli import main
from train.clmapf.instance import read_instance
from train.reporting.rows import read_rows
from warehouse_env.errors import MapError

TEXT = """agents:
  - start: [5, 15, 0]
    name: agent0
    goal: [22, 15, 1.57]
map:
  dimensions: [30, 40]
  obstacles:
    - [15.5, 1e1]  # a disc
"""


def test_an_instance_is_read_in_our_frame(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(TEXT)
    instance = read_instance(tmp_path / "a.yaml", "a")
    assert (instance.width, instance.height, instance.names) == (30.0, 40.0, ("agent0",))
    assert instance.goals.tolist() == [[22.0, 15.0, -1.57]]  # yaw turns clockwise
    assert instance.discs.tolist() == [[15.5, 10.0]]
    (tmp_path / "b.yaml").write_text(TEXT.replace("[15.5, 1e1]", "[-1, -1]"))
    assert read_instance(tmp_path / "b.yaml", "b").discs.shape == (0, 2)


@pytest.mark.parametrize("written", ["5", "5e0", "+5", "0.5e1"])
def test_numbers_are_read_however_a_program_writes_them(tmp_path: Path, written: str) -> None:
    """YAML 1.1 takes 5e0 for a text, and other programs write such numbers."""
    (tmp_path / "a.yaml").write_text(TEXT.replace("[5, 15, 0]", f"[{written}, 15, 0]"))
    assert read_instance(tmp_path / "a.yaml", "a").starts[0, 0] == 5.0


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("agents:", "robots:", "has no agents"),
        ("[5, 15, 0]", "[5, 15]", "must be 3 numbers"),
        ("[5, 15, 0]", "[5, .nan, 0]", "must be 3 numbers"),
        ("[5, 15, 0]", "[5, 1" + "0" * 400 + ", 0]", "must be 3 numbers"),
        ("[30, 40]", "[30, -40]", "must lie between 0"),
        ("    goal", "  goal", "line 4 is no YAML"),
        ("name: agent0", "start: [1, 2, 3]", "a name is given twice"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    (tmp_path / "a.yaml").write_text(TEXT.replace(old, new))
    with pytest.raises(MapError, match=sentence.replace("[", r"\[")):
        read_instance(tmp_path / "a.yaml", "a")


def test_the_command_solves_and_checks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, out = str(tmp_path / "instances"), str(tmp_path / "out")
    Path(folder).mkdir()
    for number in (1, 2):
        (Path(folder) / f"{number}.yaml").write_text(TEXT.replace("15, 0]", f"{14 + number}, 0]"))
    assert main(["clmapf", folder, "--out", out, "--processes", "1"]) == 0
    shown = capsys.readouterr().out
    assert "2: 100 [34, 100]%" in shown
    assert "impossible as stated: none" in shown
    rows = read_rows(Path(out) / "rows.jsonl")
    assert all(row["solved"] and row["flowtime"] >= row["flowtime_alone"] - 1.0 for row in rows)
    checked = ["clmapf", folder, "--check", "--solutions", f"{out}/solutions", "--out", str(tmp_path / "checked")]
    assert main([*checked, "--processes", "1"]) == 0
    solution = next((Path(out) / "solutions").iterdir())
    lines = solution.read_text().splitlines()
    last = max(k for k, line in enumerate(lines) if line.startswith("    - x:"))
    solution.write_text("\n".join([*lines[:last], "    - x: 1.0", *lines[last + 1 :]]) + "\n")
    assert main([*checked, "--processes", "1"]) == 1
    assert "ends off its goal" in capsys.readouterr().out


def test_the_command_says_what_is_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["clmapf", str(tmp_path)]) == 2
    assert "holds no instances" in capsys.readouterr().err
    (tmp_path / "a.yaml").write_text(TEXT)
    assert main(["clmapf", str(tmp_path), "--check", "--out", str(tmp_path / "out")]) == 2
    assert "no solution named" in capsys.readouterr().err
