"""Files that jobs read, as bytes that go with them to other machines: maps, policies, code of one's own."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from agents.weights_folder import CONFIG, WEIGHTS
from train.own import taken_in
from warehouse_env.files import STAGED, whereabouts
from warehouse_env.maps import discs, one_way
from warehouse_env.maps.halls.hall import files_of, is_hall
from warehouse_env.own_parts import loaded_files, split

Parcel = dict[str, dict[str, bytes]]
"""Name as it was typed -> its files, by their names within a folder; the first is what the name stands for, or all lie
in a folder of that name."""

_BESIDE = {".map": (one_way.SUFFIX, discs.SUFFIX)}  # suffix of a file -> those of files that go with it


def pack(names: Iterable[str]) -> Parcel:
    """Return the content of those names that are files or policy folders, and of all own parts of this process."""
    homes = [part[0].rpartition(":")[0] for _, text in taken_in() if (part := split(text))]
    packed = {name: _content(name) for name in dict.fromkeys([*homes, *names]) if name}
    return {name: content for name, content in packed.items() if content}


def _content(name: str) -> dict[str, bytes]:
    if own := loaded_files(name):
        return {file: path.read_bytes() for file, path in own.items()}
    path = whereabouts(name)
    if is_hall(name):
        found = list(files_of(name))
        path = found[0]
    elif path.is_dir():
        found = [path / file for file in (CONFIG, WEIGHTS)]
    else:
        found = [path, *(path.with_suffix(suffix) for suffix in _BESIDE.get(path.suffix, ()))]
    return {file.relative_to(path.parent).as_posix(): file.read_bytes() for file in found if file.is_file()}


@contextmanager
def unpacked(parcel: Parcel) -> Iterator[None]:
    """Have the files of a parcel lie in a folder of their own, where their names lead to."""
    with tempfile.TemporaryDirectory(prefix="warehouse-") as folder:
        for name, content in parcel.items():
            home = Path(folder) / hashlib.blake2b(name.encode(), digest_size=8).hexdigest()
            for file, data in content.items():
                (home / file).parent.mkdir(parents=True, exist_ok=True)
                (home / file).write_bytes(data)
            STAGED[name] = home / Path(next(iter(content))).parts[0]
        try:
            yield
        finally:
            for name in parcel:
                del STAGED[name]
