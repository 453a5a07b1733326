"""Files that are either complete or absent."""

from __future__ import annotations

import contextlib
import glob
import hashlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from warehouse_env.errors import MapError, WarehouseError, shown

_LONGEST_NAME, _LONGEST_PATH = 255, 4095  # [bytes]


STAGED: dict[str, Path] = {}
"""Names as they were typed of files or folders that lie elsewhere in this process: they came here with a job."""


def whereabouts(name: str) -> Path:
    """Return where the file or folder of a name that was typed lies; ~ stands for the home."""
    return (
        STAGED[name] if name in STAGED else Path(os.path.expanduser(name))
    )  # which leaves the home of nobody as it is


def path_of(given: object, error: type[WarehouseError] = WarehouseError) -> Path:
    """Return what a user gives as the name of a file as a Path; raises `error` for what names none."""
    try:
        path = Path(given)  # type: ignore[arg-type]
        encoded = os.fsencode(path)
        named = not set(encoded) & set(b"\0\r\n") and max(map(len, encoded.split(b"/"))) <= _LONGEST_NAME
        named = named and len(encoded) <= _LONGEST_PATH
    except (TypeError, UnicodeEncodeError):
        named = False
    if not named:
        raise error(f"{shown(given)} is no file name")
    return path


def read_bytes(path: Path, kind: str, most: int) -> bytes:
    """Return what a plain file holds; MapError if there is none, or more than `most` bytes in it."""
    try:
        if not path.is_file():
            raise MapError(f"{kind} {path} {'is no plain file' if path.exists() else 'does not exist'}")
        if path.stat().st_size > most:
            raise MapError(f"{kind} {path} has {path.stat().st_size:,} bytes; at most {most:,} are read")
        return path.read_bytes()
    except OSError as error:
        raise MapError(f"{kind} {path} cannot be read: {error.strerror}") from None


def part_file(path: Path) -> Path:
    """Create an empty file beside `path`, with its suffix, to be written and then moved over it.

    Makes missing folders, and removes what a killed process left of an earlier attempt; raises WarehouseError where
    `path` cannot be written.
    """
    try:
        if path.is_dir():
            raise IsADirectoryError(None, "it is a folder")
        path.parent.mkdir(parents=True, exist_ok=True)
        _sweep(path)
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}-{os.getpid()}-", suffix=path.suffix, dir=path.parent)
    except OSError as error:
        raise WarehouseError(f"cannot write {path}: {error.strerror or error}") from error
    # mkstemp makes the file private; a picture gets the rights of any other new file.
    mask = os.umask(0)
    os.umask(mask)
    os.fchmod(handle, 0o666 & ~mask)
    os.close(handle)
    return Path(name)


def _sweep(path: Path) -> None:
    """Remove the parts of `path` whose writers are gone."""
    before, after = f".{path.stem}-", path.suffix
    for part in path.parent.glob(f"{glob.escape(before)}*-*{glob.escape(after)}"):
        writer = part.name.removeprefix(before).partition("-")[0]
        if writer.isdecimal() and not _lives(int(writer)):
            part.unlink(missing_ok=True)


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # of another user
        return True
    return True


@contextlib.contextmanager
def complete_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a file to write beside `path`; it takes that name at the end, or vanishes on an error.

    Raises WarehouseError where it cannot be written, be it that the disk is full.
    """
    target = path_of(path)
    part = part_file(target)
    try:
        yield part
        os.replace(part, target)
    except OSError as error:
        if error.filename not in (None, str(part)):  # about another file
            raise
        raise WarehouseError(f"cannot write {target}: {error.strerror or error}") from error
    finally:
        part.unlink(missing_ok=True)


def file_digest(path: Path) -> str:
    """Return a digest of a file's content, to tell versions apart."""
    return hashlib.blake2b(path.read_bytes(), digest_size=8).hexdigest()
