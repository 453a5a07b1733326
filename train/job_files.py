"""What options name: own parts, loaded once here and in each worker; and files, as bytes that travel to machines."""

import dataclasses
import hashlib
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents import POLICIES, add_policy
from agents.weights_folder import CONFIG, WEIGHTS
from train.execute.lifelong import add_grid_planner
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError, WarehouseError
from warehouse_env.files import (
    MOST,
    STAGED,
    check_writable,
    companion,
    complete_file,
    file_digest,
    guarded,
    is_special,
    read_bytes,
    whereabouts,
)
from warehouse_env.maps import discs, one_way
from warehouse_env.maps.halls.hall import files_of, is_hall
from warehouse_env.maps.layouts import add_layout
from warehouse_env.observation import add_sensor
from warehouse_env.planning import add_planner
from warehouse_env.plugins import LOADED, digests, loaded_files, split
from warehouse_env.simulation.tasks.sampled import add_tasks

Typed = tuple[str, str]
"""A kind of part, and its name as typed."""

_ADD: dict[str, Callable[[str], None]] = {
    "policy": add_policy, "planner": add_planner, "layout": add_layout, "sensor": add_sensor, "tasks": add_tasks,
    "grid_planner": add_grid_planner,
}  # fmt: skip


@dataclass(frozen=True)
class OwnSensors(Checked):
    """The option for sensors."""

    sensor: tuple[str, ...] = ()
    """Your own sensors that the policies need, under the names they were trained with: FILE.py:CLASS or
    MODULE:CLASS."""


def take_in(typed: Iterable[Typed]) -> None:
    """Put each own part into its registry; ConfigError or WeightsError if it cannot be loaded."""
    for kind, text in typed:
        _ADD[kind](text)


def taken_in() -> list[Typed]:
    """Return all own parts in the registries, for `take_in` in another process."""
    return [(part.kind, name) for name, part in LOADED.items()]


def versions(policy: str, *names: str, orders: str = "") -> dict[str, str]:
    """Return name -> digest of what may change under the same name: a policy's weights, plugins (`names`), orders."""
    found = digests(policy, *names)
    if policy not in POLICIES:
        path = whereabouts(policy)
        weights = path / WEIGHTS if path.is_dir() else path
        if weights.is_file():
            found[policy] = file_digest(weights)
    if orders:
        found[orders] = file_digest(whereabouts(orders))
    return found


JobFiles = dict[str, dict[str, bytes]]
"""Name as typed -> its files by their names within a folder; the first is the named file or in the named folder."""

FileDigests = dict[str, dict[str, str]]
"""Name as typed -> its files, with a digest of each."""

_BESIDE = {".map": (one_way.SUFFIX, discs.SUFFIX)}  # suffix of a file -> those of files that go with it


def pack(names: Iterable[str]) -> JobFiles:
    """Return the content of the names that are files or policy folders, and of all own parts of this process."""
    homes = [part[0].rpartition(":")[0] for _, text in taken_in() if (part := split(text))]
    packed = {name: _content(name) for name in dict.fromkeys([*homes, *names]) if name and not split(name)}
    return {name: content for name, content in packed.items() if content}


def floor_digest(name: str) -> str:
    """Return a digest of all files behind a map's name; "" for other floors."""
    content = _content(name) if name.lower().endswith(".map") or is_hall(name) else {}
    whole = b"".join(f"{file} {len(data)} ".encode() + data for file, data in content.items())
    return _digest(whole) if content else ""


def file_digests(names: Iterable[str]) -> FileDigests:
    """Return the digests of the data files behind the names."""
    content = {name: _content(name) for name in dict.fromkeys(names) if not split(name)}
    return {name: {file: _digest(data) for file, data in files.items()} for name, files in content.items() if files}


@contextmanager
def unpacked(files: JobFiles) -> Iterator[None]:
    """Write files to a temporary folder, and let their names lead there."""
    with tempfile.TemporaryDirectory(prefix="warehouse-") as folder:
        homes = {name: Path(folder) / _digest(name.encode()) for name in files}
        for name, content in files.items():
            for file, data in content.items():
                with complete_file(homes[name] / file) as part:
                    part.write_bytes(data)
        before = STAGED.copy()
        STAGED.update({name: homes[name] / Path(next(iter(own))).parts[0] for name, own in files.items()})
        try:
            yield
        finally:
            STAGED.clear()
            STAGED.update(before)


def files_behind(name: str) -> list[Path]:
    """Return the files behind a typed name, a map, a policy or own code; the named file comes first."""
    part = split(name)
    path = whereabouts(part[0].rpartition(":")[0] if part else name)
    if part is None and is_hall(name):
        found = list(files_of(name))
    elif path.is_dir():
        found = [path / file for file in (CONFIG, WEIGHTS)]
    else:
        found = [path, *(companion(path, suffix) for suffix in _BESIDE.get(path.suffix.lower(), ()))]
    return [file for file in found if file.is_file()]


def _content(name: str) -> dict[str, bytes]:
    own = loaded_files(name)
    if not own:
        found = files_behind(name)
        home = (found[0] if found and is_hall(name) else whereabouts(name)).parent
        own = {file.relative_to(home).as_posix(): file for file in found}
    return {file: read_bytes(path, "file", MOST) for file, path in own.items()}


def _digest(data: bytes) -> str:
    return hashlib.blake2b(data, digest_size=8).hexdigest()


OUTPUTS = {"json", "out", "html", "png", "video", "onnx", "report", "save", "resume"}
"""Options that name outputs; any other path is an input."""
_NAMED = {"draw", "layout", "layouts", "map", "planner", "policy", "sensor", "tasks"}  # text that may name files


@contextmanager
def checked(options: Any) -> Iterator[None]:
    """Guard the files of a command that runs within this context.

    ConfigError if two outputs name one file; WarehouseError if an output cannot or must not be written.
    """
    given = _given(options)
    rewrites = getattr(options, "rewrites", ())  # suffixes of inputs that the command may replace
    read = [path for name, value, _ in given if name not in OUTPUTS for path in _files(name, value)]
    with guarded(path for path in read if not path.name.endswith(rewrites)):
        taken: dict[str, str] = {}
        for name, path, is_folder in given:
            if name in OUTPUTS and isinstance(path, Path) and not is_folder:
                place = os.path.realpath(path)
                if place in taken and not is_special(path):
                    raise ConfigError(f"--{taken[place]} and --{name} name the same file {path}; name two")
                taken[place] = name
                check_writable(path, rows=name == "json")
        yield


def _given(options: Any) -> list[tuple[str, Any, bool]]:
    """Return (name, value, whether it is a folder) of all options, those of an inner `config` included."""
    found = []
    for field in dataclasses.fields(options):
        value = getattr(options, field.name)
        if dataclasses.is_dataclass(value):
            found += _given(value)
            continue
        names_file = isinstance(field.default, Path) and field.default.suffix != ""
        found.append((field.name, value, field.name in ("out", "report", "resume") and not names_file))
    return found


def _files(name: str, value: Any) -> Iterator[Path]:
    """Yield the files that the value of an option names."""
    for one in value if isinstance(value, tuple) else (value,):
        if isinstance(one, Path) and one.is_dir():
            yield from one.iterdir()
        elif isinstance(one, Path) or (isinstance(one, str) and name in _NAMED):
            with suppress(WarehouseError):
                yield from files_behind(str(one))
