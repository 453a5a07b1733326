"""Test that commands never overwrite their inputs or merge two outputs, and that jobs carry their files."""

from __future__ import annotations

import dataclasses
import itertools
import shutil
import sys
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest

from agents import WEIGHTS_FOLDER, make_policy, policy_config
from train.cli import COMMANDS, main, options_of
from train.job_files import OUTPUTS, checked, pack, take_in, unpacked, versions
from warehouse_env import EnvConfig, make_layout
from warehouse_env.errors import MapError, WarehouseError, WeightsError
from warehouse_env.files import complete_file, write_text
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.movingai import write_map

INPUTS = {
    "check", "delays", "draw", "episode", "episodes", "files", "fleet", "folder", "listen",
    "map", "maps", "orders", "plan", "rows", "runs", "scen", "solutions",
}  # fmt: skip


FOLDERS = {"out", "report", "resume"}
"""Outputs that are folders in some commands; these are checked only when files are written."""


def paths_of(name: str) -> dict[str, bool]:
    """Return the path options of a command, and whether each takes several."""
    options = options_of(name)
    kinds = get_type_hints(options)
    if "config" in kinds:
        kinds |= get_type_hints(kinds["config"])
    chosen = {key: kind for key, kind in kinds.items() if Path in (kind, *get_args(kind)) or key == "draw"}
    return {key: "tuple" in str(kind) for key, kind in chosen.items()}


def options_with(name: str, values: dict[str, Any]) -> Any:
    """Return a command's path options with some values; the others are None."""
    fields = [(key, Any, dataclasses.field(default=None)) for key in paths_of(name)]
    return dataclasses.make_dataclass("Options", fields)(**values)


@pytest.mark.parametrize("name", COMMANDS)
def test_each_path_option_is_an_input_or_an_output(name: str) -> None:
    assert not [option for option in paths_of(name) if (option in INPUTS) == (option in OUTPUTS)]


@pytest.mark.parametrize("name", COMMANDS)
def test_inputs_are_not_overwritten(name: str, tmp_path: Path) -> None:
    """Another name of the same file is refused, too."""
    (tmp_path / "a.map").write_text("content")
    (tmp_path / "b.map").hardlink_to(tmp_path / "a.map")
    several = paths_of(name)
    for read, written in itertools.product(INPUTS & several.keys(), OUTPUTS):
        if written in several:
            given = (tmp_path / "a.map",) if several[read] else tmp_path / "a.map"
            options = options_with(name, {read: given, written: tmp_path / "b.map"})
            with pytest.raises(WarehouseError, match="this command reads it"), checked(options):
                write_text(tmp_path / "b.map", "")  # as a file in an output folder
    assert (tmp_path / "a.map").read_text() == "content"


@pytest.mark.parametrize("name", COMMANDS)
def test_outputs_are_different_files(name: str, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "a")
    for one, other in itertools.combinations(paths_of(name).keys() & OUTPUTS - FOLDERS, 2):
        options = options_with(name, {one: tmp_path / "a", other: tmp_path / "link"})
        with pytest.raises(WarehouseError, match="name the same file"), checked(options):
            pass


def test_saved_floor_does_not_overwrite_its_source(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """hall.yml is a new file, but its picture would overwrite the picture that is read."""
    hall = tmp_path / "hall.yaml"
    assert main(["layouts", "--draw", "open", "--save", str(hall)]) == 0
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    for target in (hall, hall.with_suffix(".yml")):
        assert main(["layouts", "--draw", str(hall), "--save", str(target)]) == 2
        assert "this command reads it" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.iterdir() if path in before} == before


def test_table_does_not_overwrite_the_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    where = ["--json", str(tmp_path / "table.md"), "--out", str(tmp_path)]
    assert main(["evaluate", "--policy", "brake", "--layout", "open", *where]) == 2
    assert "the rows go there" in capsys.readouterr().err


WRITERS = {"warehouse_env/files.py", "train/reporting/rows.py"}


def test_only_listed_modules_write_files() -> None:
    """Row files have their own writer, since rows are appended; all others go through files.py."""
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


def test_jobs_carry_maps_directions_and_policies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    occupied = np.zeros((6, 8), bool)
    occupied[2, 2] = True
    one_way = np.zeros((6, 8), np.uint8)
    one_way[3, 3] = 1
    Path("halls").mkdir()
    write_map(GridMap(occupied, one_way=one_way), "halls/mine.map")
    shutil.copytree(WEIGHTS_FOLDER / "ppo", "runs/mine")
    names = ("halls/mine.map", "runs/mine", "greedy", "pf_aco", "")
    digest, files = versions("runs/mine", "pf_aco", "paper46"), pack(names)
    assert list(files) == ["halls/mine.map", "runs/mine"]
    shutil.rmtree("halls")
    shutil.rmtree("runs")
    with unpacked(files):
        grid = make_layout("halls/mine.map")
        assert grid.name == "mine"
        assert grid.one_way[3, 3] == 1
        config = policy_config("runs/mine", EnvConfig())
        assert make_policy("runs/mine", config) is not None
        assert versions("runs/mine", "pf_aco", "paper46") == digest
    with pytest.raises(MapError):
        make_layout("halls/mine.map")
    with pytest.raises(WeightsError):
        make_policy("runs/mine", config)


@pytest.mark.usefixtures("registries")
@pytest.mark.parametrize("name", ["mine.py:Mine", "mine:Mine"])
def test_jobs_carry_user_code(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from agents import POLICIES
    from warehouse_env.plugins import LOADED

    monkeypatch.chdir(tmp_path)
    home, _, _ = name.partition(":")
    beside = f"beside_{home.replace('.', '_')}"  # one module per case: imports persist between cases
    Path("mine.py").write_text(f"from {beside} import Mine\n")
    Path(f"{beside}.py").write_text("from agents.rules import Follow as Mine\n")
    take_in([("policy", name)])
    files = pack(())
    assert {one: list(own) for one, own in files.items()} == {home: ["mine.py", f"{beside}.py"]}
    for module in ("mine", beside):
        Path(f"{module}.py").unlink()
        sys.modules.pop(module, None)
    del LOADED[name], POLICIES[name]
    with unpacked(files):
        take_in([("policy", name)])
        assert make_policy(name, EnvConfig())
