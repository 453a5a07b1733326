"""Every reader of a user's file goes through the one door: what is no such file is one sentence, at once."""

from __future__ import annotations

import ast
import faulthandler
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.readers import LOG, READERS
from tests.test_architecture import PACKAGES, ROOT, module_name

UNKNOWN = ("h.png",)  # of which no small good one is made here


@pytest.fixture(autouse=True)
def _no_waiting() -> Iterator[None]:
    """End the process where a reader waits for a pipe's writer, or fills the memory from a device."""
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
def test_a_good_file_is_read(name: str, tmp_path: Path) -> None:
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
def test_what_is_no_such_file_is_one_sentence(name: str, odd: str, tmp_path: Path) -> None:
    ODD[odd](tmp_path / name)
    if odd == "missing" and name in ("whole.jsonl", "m.oneway"):
        READERS[name].read(tmp_path / name)
    else:
        assert str(tmp_path) in sentence(name, tmp_path / name)


SAVED: dict[str, Callable[[str], bytes]] = {
    "byte order mark, lines of Windows": lambda text: text.replace("\n", "\r\n").encode("utf-8-sig"),
    "UTF-16": lambda text: text.encode("utf-16"),
    "empty lines at the end": lambda text: (text + "\n \n").encode(),
}


@pytest.mark.parametrize("how", SAVED)
@pytest.mark.parametrize("name", [name for name, reader in READERS.items() if reader.text])
def test_a_text_is_read_however_a_program_saved_it(name: str, how: str, tmp_path: Path) -> None:
    reader, path, found = READERS[name], tmp_path / name, []
    for content in (reader.good(), SAVED[how](reader.good().decode())):
        path.write_bytes(content)
        found.append(repr(reader.read(path)))
    assert found[0] == found[1]


@pytest.mark.parametrize("name", [name for name, reader in READERS.items() if reader.text and reader.good() != LOG])
def test_a_text_of_another_code_page_is_named_with_its_line(name: str, tmp_path: Path) -> None:
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
    "train.evaluation.cluster": "sources of this package",
    "warehouse_env.render.page_text": "ships with the package",
    "train.reporting.page": "ships with the package",
    "train.fleet.check": "ships with the package",
    "train.tables.runner": "sources of this package",
    "train.tables.catalogue": "ships with the package",
    "warehouse_env.render.video": "what it has just written",
    "train.reporting.rows": "counts what its own output replaces, and its own lock",
    "warehouse_env.routes.plan_store": "its own cache",
    "warehouse_env.start": "ships with the package",
    "train.cli": "the null device",
    "train.commands.live": "a page, in the browser",
}


def reads(source: str) -> Iterator[str]:
    """Yield the calls of a source that may open a file for reading."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call):
            method, name = getattr(node.func, "attr", ""), getattr(node.func, "id", "")
            words = {word.value for word in node.args if isinstance(word, ast.Constant) and isinstance(word.value, str)}
            if (method in READS or name in FUNCTIONS) and not words & {"w", "wb", "a", "x"}:
                yield ast.unparse(node)


def test_nobody_opens_files_but_the_door() -> None:
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
