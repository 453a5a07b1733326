"""No command writes over what it reads, or two outputs into one file; every path option is known to be one or other."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest

from train.cli import COMMANDS, main, options_of
from train.doors import OUTPUTS, checked
from warehouse_env.errors import WarehouseError
from warehouse_env.files import complete_file, write_text

INPUTS = {
    "check", "draw", "episode", "episodes", "files", "fleet", "folder", "listen",
    "map", "maps", "orders", "rows", "runs", "scen", "solutions",
}  # fmt: skip


FOLDERS = {"out", "report", "resume"}
"""Outputs that are folders in some commands: what is written there is refused when it is written."""


def paths_of(name: str) -> dict[str, bool]:
    """Return the path options of a command, and whether each takes several."""
    options = options_of(name)
    kinds = get_type_hints(options)
    if "config" in kinds:
        kinds |= get_type_hints(kinds["config"])
    chosen = {key: kind for key, kind in kinds.items() if Path in (kind, *get_args(kind)) or key == "draw"}
    return {key: "tuple" in str(kind) for key, kind in chosen.items()}


def options_with(name: str, values: dict[str, Any]) -> Any:
    """Return a command's path options with some values, the others left out."""
    fields = [(key, Any, dataclasses.field(default=None)) for key in paths_of(name)]
    return dataclasses.make_dataclass("Options", fields)(**values)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_path_option_is_read_or_written(name: str) -> None:
    assert not [option for option in paths_of(name) if (option in INPUTS) == (option in OUTPUTS)]


@pytest.mark.parametrize("name", COMMANDS)
def test_what_a_command_reads_is_not_written_over(name: str, tmp_path: Path) -> None:
    """Under another name either."""
    (tmp_path / "a.map").write_text("content")
    (tmp_path / "b.map").hardlink_to(tmp_path / "a.map")
    several = paths_of(name)
    for read, written in itertools.product(INPUTS & several.keys(), OUTPUTS):
        if written in several:
            given = (tmp_path / "a.map",) if several[read] else tmp_path / "a.map"
            options = options_with(name, {read: given, written: tmp_path / "b.map"})
            with pytest.raises(WarehouseError, match="this command reads it"), checked(options):
                write_text(tmp_path / "b.map", "")  # in a folder, say
    assert (tmp_path / "a.map").read_text() == "content"


@pytest.mark.parametrize("name", COMMANDS)
def test_two_outputs_are_two_files(name: str, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "a")
    for one, other in itertools.combinations(paths_of(name).keys() & OUTPUTS - FOLDERS, 2):
        options = options_with(name, {one: tmp_path / "a", other: tmp_path / "link"})
        with pytest.raises(WarehouseError, match="name the same file"), checked(options):
            pass


def test_a_floor_is_not_written_over_by_what_is_made_of_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its picture, that is: hall.yml is another name, but its picture would be the one that is read."""
    hall = tmp_path / "hall.yaml"
    assert main(["layouts", "--draw", "open", "--save", str(hall)]) == 0
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    for target in (hall, hall.with_suffix(".yml")):
        assert main(["layouts", "--draw", str(hall), "--save", str(target)]) == 2
        assert "this command reads it" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.iterdir() if path in before} == before


def test_rows_are_not_replaced_by_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    where = ["--json", str(tmp_path / "table.md"), "--out", str(tmp_path)]
    assert main(["evaluate", "--policy", "brake", "--layout", "open", *where]) == 2
    assert "the rows go there" in capsys.readouterr().err


WRITERS = {"warehouse_env/files.py", "train/reporting/rows.py"}


def test_outputs_are_written_through_one_door() -> None:
    """Rows are appended, and jobs' files go to a folder of their own."""
    root = Path(__file__).parents[2]
    own = [path for folder in ("warehouse_env", "agents", "train") for path in (root / folder).rglob("*.py")]
    words = (".write_text(", ".write_bytes(", 'open("w', 'open("a', 'open("x', "os.replace(")
    found = {
        path.relative_to(root).as_posix()
        for path in own
        for line in path.read_text(encoding="utf-8").splitlines()
        if any(word in line for word in words) and "part." not in line
    }
    assert found == WRITERS
    assert complete_file.__module__ == "warehouse_env.files"
