"""Files are whole or absent, and what a killed writer leaves is removed by the next one."""

from __future__ import annotations

import os
import stat
import subprocess
from pathlib import Path

import pytest

from warehouse_env.errors import WarehouseError
from warehouse_env.files import complete_file, write_text


def test_what_a_killed_writer_left_goes_and_what_others_write_stays(tmp_path: Path) -> None:
    with subprocess.Popen(["true"]) as gone:
        pass
    left, other = tmp_path / f".a-{gone.pid}-abc.txt", tmp_path / f".ab-{gone.pid}-abc.txt"
    alive, named = tmp_path / f".a-{os.getppid()}-abc.txt", tmp_path / ".a-note-abc.txt"
    for path in (left, other, alive, named):
        path.touch()
    with complete_file(tmp_path / "a.txt") as part:
        part.write_text("new")
    assert {path.name for path in tmp_path.iterdir()} == {"a.txt", other.name, alive.name, named.name}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A file, a link to it, one to a file that is not there yet, and a pipe."""
    (tmp_path / "old").write_text("old")
    (tmp_path / "old").chmod(0o640)
    (tmp_path / "link").symlink_to("old")
    (tmp_path / "new link").symlink_to("new")
    os.mkfifo(tmp_path / "pipe")
    return tmp_path


@pytest.mark.parametrize(("name", "file"), [("link", "old"), ("new link", "new"), ("old", "old")])
def test_a_link_stays_one_and_a_file_keeps_its_permissions(folder: Path, name: str, file: str) -> None:
    write_text(folder / name, "text")
    assert (folder / file).read_text() == "text"
    assert (folder / name).is_symlink() == ("link" in name)
    assert stat.S_IMODE((folder / "old").stat().st_mode) == 0o640


def test_devices_and_pipes_take_the_bytes(folder: Path) -> None:
    write_text("/dev/null", "text")
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)
    with subprocess.Popen(["cat", folder / "pipe"], stdout=subprocess.PIPE, text=True) as reader:
        write_text(folder / "pipe", "text")
        assert reader.communicate()[0] == "text"
    assert (folder / "pipe").is_fifo()
    assert {path.name for path in folder.iterdir()} == {"old", "link", "new link", "pipe"}


def test_read_only_files_are_not_replaced(folder: Path) -> None:
    """Not by root either."""
    (folder / "old").chmod(0o444)
    for name in ("old", "link"):
        with pytest.raises(WarehouseError, match="read-only"):
            write_text(folder / name, "text")
    assert (folder / "old").read_text() == "old"


def test_nothing_is_left_of_a_failed_output(tmp_path: Path) -> None:
    def fail(error: Exception) -> None:
        with complete_file(tmp_path / "x.png") as part:
            part.write_bytes(b"half")
            raise error

    with pytest.raises(RuntimeError, match="meanwhile"):
        fail(RuntimeError("meanwhile"))
    with pytest.raises(WarehouseError, match=r"cannot write .*x\.png: No space left"):
        fail(OSError(28, "No space left on device"))
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "plain").write_text("")
    write_text(tmp_path / "y.txt", "whole")
    assert (tmp_path / "y.txt").stat().st_mode == (tmp_path / "plain").stat().st_mode
    with pytest.raises(WarehouseError, match="is a folder"):
        write_text(tmp_path, "text")
