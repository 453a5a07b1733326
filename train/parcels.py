"""Files that jobs read, as bytes that go with them to other machines: maps, policies, code of one's own."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from agents.weights_folder import CONFIG, WEIGHTS
from train.own import taken_in
from warehouse_env.errors import WeightsError
from warehouse_env.files import MOST, STAGED, companion, complete_file, read_bytes, whereabouts
from warehouse_env.maps import discs, one_way
from warehouse_env.maps.halls.hall import files_of, is_hall
from warehouse_env.plugins import loaded_files, split

Parcel = dict[str, dict[str, bytes]]
"""Name as it was typed -> its files, by their names within a folder; the first is what the name stands for, or all lie
in a folder of that name."""

KeptFiles = dict[str, dict[str, str]]
"""Name as it was typed -> its files, as of a Parcel, with a digest of each."""

_BESIDE = {".map": (one_way.SUFFIX, discs.SUFFIX)}  # suffix of a file -> those of files that go with it


def pack(names: Iterable[str]) -> Parcel:
    """Return the content of those names that are files or policy folders, and of all own parts of this process."""
    homes = [part[0].rpartition(":")[0] for _, text in taken_in() if (part := split(text))]
    packed = {name: _content(name) for name in dict.fromkeys([*homes, *names]) if name and not split(name)}
    return {name: content for name, content in packed.items() if content}


def floor_digest(name: str) -> str:
    """Return a digest of all files that the floor of a map's file is read from; "" for other floors."""
    content = _content(name) if name.lower().endswith(".map") or is_hall(name) else {}
    whole = b"".join(f"{file} {len(data)} ".encode() + data for file, data in content.items())
    return _digest(whole) if content else ""


def kept(names: Iterable[str], folder: Path) -> KeptFiles:
    """Write the files of those names that are files of data into a folder; return what `staged` needs to trust them."""
    parcel = {name: content for name in dict.fromkeys(names) if not split(name) and (content := _content(name))}
    _write(parcel, folder)
    return {name: {file: _digest(data) for file, data in content.items()} for name, content in parcel.items()}


def check_kept(files: KeptFiles, folder: Path) -> None:
    """Raise WeightsError for the first file that is no longer in the folder as `kept` wrote it."""
    if not (isinstance(files, dict) and all(isinstance(inner, dict) and inner for inner in files.values())):
        raise WeightsError(f"the list of files in {folder} is damaged: begin anew")
    for name, digests in files.items():
        for file, digest in digests.items():
            path = _home(folder, name) / file
            if not path.is_file() or _digest(read_bytes(path, "file", MOST)) != digest:
                raise WeightsError(f"{path}, kept of {name}, is missing or was changed: put it back, or begin anew")


@contextmanager
def staged(files: Mapping[str, Iterable[str]], folder: Path) -> Iterator[None]:
    """Have names lead to their files in a folder; the first file of each is what it stands for, or lies in that."""
    before = STAGED.copy()
    STAGED.update({name: _home(folder, name) / Path(next(iter(inner))).parts[0] for name, inner in files.items()})
    try:
        yield
    finally:
        STAGED.clear()
        STAGED.update(before)


@contextmanager
def unpacked(parcel: Parcel) -> Iterator[None]:
    """Have the files of a parcel lie in a folder of their own, where their names lead to."""
    with tempfile.TemporaryDirectory(prefix="warehouse-") as folder:
        _write(parcel, Path(folder))
        with staged(parcel, Path(folder)):
            yield


def files_behind(name: str) -> list[Path]:
    """Return the files that a typed name stands for, the one that it names first: a map's, a policy's, own code."""
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


def _write(parcel: Parcel, folder: Path) -> None:
    for name, content in parcel.items():
        for file, data in content.items():
            with complete_file(_home(folder, name) / file) as part:
                part.write_bytes(data)


def _home(folder: Path, name: str) -> Path:
    """Return where the files of a name lie."""
    return folder / hashlib.blake2b(name.encode(), digest_size=8).hexdigest()


def _digest(data: bytes) -> str:
    return hashlib.blake2b(data, digest_size=8).hexdigest()
