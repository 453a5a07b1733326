"""Test that only listed modules read files and that every output is whole or absent."""

from __future__ import annotations

import ast
import faulthandler
import os
import stat
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.readers import LOG, READERS
from tests.test_architecture import PACKAGES, ROOT, module_name
from warehouse_env.errors import WarehouseError
from warehouse_env.files import complete_file, write_text

UNKNOWN = ("h.png",)  # has no small valid example here


@pytest.fixture(autouse=True)
def _no_waiting() -> Iterator[None]:
    """End the process if a reader waits for a pipe's writer or fills memory from a device."""
    faulthandler.dump_traceback_later(120, exit=True)
    yield
    faulthandler.cancel_dump_traceback_later()


def sentence(name: str, path: Path) -> str:
    with pytest.raises(READERS[name].error) as raised:
        READERS[name].read(path)
    text = str(raised.value)
    assert "\n" not in text
    assert len(text) < 700
    return text


@pytest.mark.parametrize("name", [name for name in READERS if name not in UNKNOWN])
def test_valid_file_is_read(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(READERS[name].good())
    READERS[name].read(tmp_path / name)


ODD: dict[str, Callable[[Path], object]] = {
    "missing": lambda path: None,
    "folder": Path.mkdir,
    "pipe": os.mkfifo,
    "device": lambda path: path.symlink_to("/dev/zero"),
    "endless": lambda path: os.truncate(os.open(path, os.O_CREAT | os.O_WRONLY), 10**10),
}


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize("name", READERS)
def test_odd_file_is_one_sentence(name: str, odd: str, tmp_path: Path) -> None:
    ODD[odd](tmp_path / name)
    if odd == "missing" and name in ("whole.jsonl", "m.oneway"):
        READERS[name].read(tmp_path / name)
    else:
        assert str(tmp_path) in sentence(name, tmp_path / name)


SAVED: dict[str, Callable[[str], bytes]] = {
    "byte order mark, lines of Windows": lambda text: text.replace("\n", "\r\n").encode("utf-8-sig"),
    "empty lines at the end": lambda text: (text + "\n \n").encode(),
}


@pytest.mark.parametrize("how", SAVED)
@pytest.mark.parametrize("name", [name for name, reader in READERS.items() if reader.text])
def test_text_is_read_with_other_line_ends_and_encoding(name: str, how: str, tmp_path: Path) -> None:
    reader, path, found = READERS[name], tmp_path / name, []
    for content in (reader.good(), SAVED[how](reader.good().decode())):
        path.write_bytes(content)
        found.append(repr(reader.read(path)))
    assert found[0] == found[1]


@pytest.mark.parametrize("name", [name for name, reader in READERS.items() if reader.text and reader.good() != LOG])
def test_text_in_another_encoding_is_named_with_its_line(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(READERS[name].good().partition(b"\n")[0] + b"\n\xe9\n")
    text = sentence(name, tmp_path / name)
    assert "line 2" in text
    assert "UTF-8" in text


FUNCTIONS = {"open", "ZipFile", "load_file"}
READS = {*FUNCTIONS, "read_text", "read_bytes", "fromfile", "loadtxt", "genfromtxt"}
MAY_READ = {
    "warehouse_env.files": "the door",
    "warehouse_env.compiled": "its own cache",
    "warehouse_env.simulation.device.shim": "sources of this package",
    "warehouse_env.simulation.record.recording": "members of what the door opened",
    "warehouse_env.maps.halls.map_server": "bytes that the door read",
    "train.evaluation.jobs": "sources of this package",
    "warehouse_env.render.pages": "ships with the package",
    "train.reporting.page": "ships with the package",
    "train.fleet.check": "ships with the package",
    "train.tables.catalogue": "ships with the package",
    "warehouse_env.render.video": "what it has just written",
    "train.reporting.rows": "counts what its own output replaces, and its own lock",
    "warehouse_env.start": "ships with the package",
    "train.cli": "the null device",
    "train.commands.live": "a page, in the browser",
}


def reads(source: str) -> Iterator[str]:
    """Yield the calls in a source that may read a file."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call):
            method, name = getattr(node.func, "attr", ""), getattr(node.func, "id", "")
            words = {word.value for word in node.args if isinstance(word, ast.Constant) and isinstance(word.value, str)}
            if (method in READS or name in FUNCTIONS) and not words & {"w", "wb", "a", "x"}:
                yield ast.unparse(node)


def test_only_listed_modules_read_files() -> None:
    assert list(reads("Path(x).read_text()\nopen(p)\np.open('rb')\np.open('w')\nf.read()")) == [
        "Path(x).read_text()", "open(p)", "p.open('rb')"
    ]  # fmt: skip
    found = {
        module_name(path): calls
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        if (calls := list(reads(path.read_text(encoding="utf-8"))))
    }
    assert not {module: calls for module, calls in found.items() if module not in MAY_READ}


def test_only_leftovers_of_killed_writers_are_removed(tmp_path: Path) -> None:
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
    """Return a folder with a file, a link to it, a link to a missing file, and a pipe."""
    (tmp_path / "old").write_text("old")
    (tmp_path / "old").chmod(0o640)
    (tmp_path / "link").symlink_to("old")
    (tmp_path / "new link").symlink_to("new")
    os.mkfifo(tmp_path / "pipe")
    return tmp_path


@pytest.mark.parametrize(("name", "file"), [("link", "old"), ("new link", "new"), ("old", "old")])
def test_writing_keeps_links_and_permissions(folder: Path, name: str, file: str) -> None:
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
    """Root cannot replace them either."""
    (folder / "old").chmod(0o444)
    for name in ("old", "link"):
        with pytest.raises(WarehouseError, match="read-only"):
            write_text(folder / name, "text")
    assert (folder / "old").read_text() == "old"


def test_failed_output_leaves_no_file(tmp_path: Path) -> None:
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
