"""Every reader of a user's file goes through the one door: what is no such file is one sentence, at once."""

from __future__ import annotations

import ast
import faulthandler
import io
import json
import os
import re
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from agents.learned import read_policy
from agents.weights_folder import read_record, read_tensors
from tests.hostile import targets
from tests.test_architecture import PACKAGES, ROOT, module_name
from train.clmapf.instance import read_instance
from train.clmapf.solution import read_solution
from train.commands.kinds import read_fleet
from train.fleet.check import check_log
from train.fleet.driven import load_episode
from train.fleet.listen import hear_log
from train.fleet.secure import secure_context
from train.leaderboard.entry import SHIPPED, read_entry
from train.learning import checkpoint
from train.learning.curves import read_run
from train.reporting.comparison import read_runs
from train.reporting.rows import read_rows, whole_rows
from warehouse_env.errors import ConfigError, MapError, WarehouseError, WeightsError
from warehouse_env.files import file_digest
from warehouse_env.maps.discs import read_discs
from warehouse_env.maps.halls.lif import read_lif
from warehouse_env.maps.halls.map_server import read_occupancy
from warehouse_env.maps.halls.picture import read_picture
from warehouse_env.maps.halls.places import read_places
from warehouse_env.maps.halls.route_graph import read_route_graph
from warehouse_env.maps.movingai import read_map, read_scen
from warehouse_env.simulation.record.recording import Episode
from warehouse_env.simulation.tasks.orders import read_orders


class Reader(NamedTuple):
    """How a file is read, what a small good one holds, and what is raised."""

    read: Callable[[Path], Any]
    good: Callable[[], bytes]
    error: type[WarehouseError] = MapError
    text: bool = False  # which other programs may have saved otherwise


def of_text(read: Callable[[Path], Any], good: bytes, error: type[WarehouseError] = MapError) -> Reader:
    return Reader(read, lambda: good, error, text=True)


def hall(name: str) -> bytes:
    return targets.HALL[name]


def rows(listed: list[dict[str, Any]]) -> bytes:
    return "\n".join(map(json.dumps, listed)).encode() + b"\n"


def with_one_way(path: Path) -> Any:
    path.with_suffix(".map").write_bytes(targets.MAP.replace(b"@", b"."))
    return read_map(path.with_suffix(".map")).one_way.tolist()


def with_picture(path: Path) -> Any:
    path.with_name("h.pgm").write_bytes(hall("h.pgm"))
    return read_occupancy(path).values.tolist()


def with_other_rows(path: Path) -> Any:
    path.with_name("other.jsonl").write_bytes(rows(targets.EVALUATED))
    return read_runs([path.with_name("other.jsonl"), path])[1].rows


def of_training(path: Path) -> Any:
    path.with_name("config.json").write_text(json.dumps(targets.RECORD))
    return read_run(path.parent).rows()


def of_checkpoint(path: Path) -> Any:
    for name, content in targets._state().items():
        if name != path.name:
            path.with_name(name).write_bytes(content)
    return checkpoint.read(path.parent)


def model(data: bytes, weights: bytes) -> bytes:
    with zipfile.ZipFile(file := io.BytesIO(), "w") as archive:
        archive.writestr("data", data)
        archive.writestr("policy.pth", weights)
    return file.getvalue()


LOG = rows(targets._fleet_entries())
READERS: dict[str, Reader] = {
    "m.map": of_text(lambda path: read_map(path).key, targets.MAP),
    "m.oneway": of_text(with_one_way, targets.ONE_WAY),
    "m.scen": of_text(read_scen, b"version 1\n3\tm.map\t5\t4\t1\t0\t3\t2\t4.5\n"),
    "d.json": of_text(lambda path: read_discs(path).tolist(), hall("h.discs.json")),
    "d.csv": of_text(lambda path: read_discs(path).tolist(), b"x,y,radius\n1.5,2,0.25\n"),
    "h.places.json": of_text(read_places, hall("h.places.json")),
    "l.json": of_text(lambda path: sorted(read_lif(path).nodes), hall("l.json")),
    "l.geojson": of_text(lambda path: sorted(read_route_graph(path).nodes), hall("l.geojson")),
    "h.yaml": of_text(with_picture, hall("h.yaml")),
    "h.pgm": Reader(read_picture, lambda: hall("h.pgm")),
    "h.png": Reader(read_picture, lambda: hall("h.png")),
    "o.csv": of_text(read_orders, targets.ORDERS["o.csv"], ConfigError),
    "o.jsonl": of_text(read_orders, targets.ORDERS["o.jsonl"], ConfigError),
    "fleet.json": of_text(read_fleet, json.dumps(targets.FLEETS[0]).encode(), ConfigError),
    "e.npz": Reader(Episode.load, targets.an_episode, WarehouseError),
    "driven.npz": Reader(load_episode, targets.an_episode, WarehouseError),
    "config.json": of_text(lambda path: read_record(path.parent), json.dumps(targets.RECORD).encode(), WeightsError),
    "weights.safetensors": Reader(
        lambda path: read_tensors(path.parent, targets.NETWORK), targets._weights, WeightsError
    ),
    "model.zip": Reader(read_policy, lambda: model(*targets._model()), WeightsError),
    "state.json": of_text(of_checkpoint, targets._state()["state.json"], WeightsError),
    "arrays-1.safetensors": Reader(of_checkpoint, lambda: targets._state()["arrays-1.safetensors"], WeightsError),
    "rows.jsonl": of_text(read_rows, rows([{"a": "é"}, {"a": 2}]), WarehouseError),
    "whole.jsonl": Reader(whole_rows, lambda: rows([{"a": 1}]), WarehouseError),
    "run.jsonl": of_text(with_other_rows, rows(targets.EVALUATED), WarehouseError),
    "progress.jsonl": of_text(of_training, rows(targets.PROGRESS), WarehouseError),
    "entry.json": of_text(read_entry, next(SHIPPED.glob("*.json")).read_bytes(), WarehouseError),
    "instance.yaml": of_text(lambda path: repr(read_instance(path, "i")), targets.CLMAPF),
    "solution.yaml": of_text(lambda path: repr(read_solution(path)), targets.CLMAPF_SOLUTION),
    "log.jsonl": of_text(lambda path: check_log(path).messages, LOG, WarehouseError),
    "heard.jsonl": of_text(lambda path: hear_log(path).fleet.messages, LOG, WarehouseError),
    "cafile.pem": Reader(lambda path: secure_context(path, None, None), bytes, ConfigError),
    "cert.pem": Reader(lambda path: secure_context(None, path, path), bytes, ConfigError),
    "digest": Reader(file_digest, lambda: b"any", WarehouseError),
}  # fmt: skip
UNKNOWN = ("h.png", "cafile.pem", "cert.pem")  # of which no small good one is made here
ANYTHING = ("whole.jsonl", "digest", "heard.jsonl")  # to which some damage is none


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


@pytest.mark.parametrize("name", [name for name in READERS if name not in ANYTHING])
def test_garbage_is_one_sentence(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(bytes(range(256)) * 20)
    sentence(name, tmp_path / name)


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


def test_members_of_a_model_are_not_inflated_without_end(tmp_path: Path) -> None:
    data, weights = targets._model()
    with zipfile.ZipFile(file := io.BytesIO(weights), "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("much", bytes(2**28))
    (tmp_path / "model.zip").write_bytes(model(data, file.getvalue()))
    with pytest.raises(WeightsError, match="would fill more than 256 MB"):
        read_policy(tmp_path / "model.zip")


READS = re.compile(
    r".*\.(open|read_text|read_bytes|fromfile|loadtxt|genfromtxt)|sqlite3.connect|open|(.*\.)?(ZipFile|load_file)"
)
MAY_READ = {
    "warehouse_env.files": "the door",
    "warehouse_env.simulation.record.recording": "members of what the door opened",
    "agents.sb3_model": "members of what the door opened",
    "warehouse_env.maps.halls.picture": "bytes that the door read",
    "train.evaluation.nodes": "sources of this package",
    "warehouse_env.render.page_text": "ships with the package",
    "train.reporting.page": "ships with the package",
    "train.fleet.check": "ships with the package",
    "train.tables.code": "sources of this package",
    "warehouse_env.render.video": "what it has just written",
    "train.learning.away": "what the training beside it has just written",
    "train.reporting.rows": "counts what its own output replaces",
    "train.reporting.lock": "its own lock",
    "warehouse_env.routes.plan_store": "its own cache",
    "warehouse_env.start": "ships with the package",
    "train.cli": "the null device",
    "train.commands.live": "a page, in the browser",
}


def reads(source: str) -> Iterator[str]:
    """Yield the calls of a source that may open a file for reading."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call):
            words = {word.value for word in node.args if isinstance(word, ast.Constant) and isinstance(word.value, str)}
            if READS.fullmatch(ast.unparse(node.func)) and not words & {"w", "wb", "a", "x"}:
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
