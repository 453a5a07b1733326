"""All reading and writing of users' files: inputs are regular files of limited size, outputs complete or absent."""

import contextlib
import functools
import glob
import hashlib
import io
import itertools
import json
import math
import os
import shutil
import stat
import tempfile
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from warehouse_env.errors import MapError, WarehouseError, shown

_LONGEST_NAME, _LONGEST_PATH = 255, 4095  # [bytes]
_CHUNK = 2**20  # [bytes]
MOST = 4_000_000_000  # bytes of a file whose size has no better bound

STAGED: dict[str, Path] = {}
"""Name as typed -> the file or folder that came with a job and replaces it in this process."""


def whereabouts(name: str) -> Path:
    """Return the path of a file or folder by its typed name; ~ is the home directory."""
    return STAGED[name] if name in STAGED else Path(os.path.expanduser(name))


def path_of(given: object, error: type[WarehouseError] = WarehouseError) -> Path:
    """Return a user's file name as a Path in this process; raises `error` for anything else."""
    try:
        path = whereabouts(os.fspath(given))  # type: ignore[call-overload]
        encoded = os.fsencode(path)
        named = not set(encoded) & set(b"\0\r\n") and max(map(len, encoded.split(b"/"))) <= _LONGEST_NAME
        named = named and len(encoded) <= _LONGEST_PATH
    except (TypeError, ValueError):
        named = False
    if not named:
        raise error(f"{shown(given)} is no file name")
    return path


@contextlib.contextmanager
def open_regular(given: object, kind: str, most: int, error: type[WarehouseError] = MapError) -> Iterator[BinaryIO]:
    """Yield a regular file of at most `most` bytes, opened for reading.

    Raises `error`, which names the kind of file, for a device, pipe or folder (without waiting for a writer), for a
    larger file, and for one that cannot be read.
    """
    path = path_of(given, error)
    try:
        with open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)) as file:
            about = os.fstat(file.fileno())
            if not stat.S_ISREG(about.st_mode):
                raise error(f"{kind} {path} must be a regular file, not a {_what(about.st_mode)}")
            if about.st_size > most:
                raise error(f"{kind} {path} has {about.st_size:,} bytes; at most {most:,} are read")
            yield file
    except FileNotFoundError:
        raise error(f"{kind} {path} does not exist") from None
    except IsADirectoryError:  # raised by open() itself
        raise error(f"{kind} {path} must be a regular file, not a folder") from None
    except OSError as failed:
        raise error(f"{kind} {path} cannot be read: {failed.strerror or failed}") from None


def read_bytes(given: object, kind: str, most: int, error: type[WarehouseError] = MapError) -> bytes:
    """Return the content of a regular file of at most `most` bytes; raises `error` as `open_regular` does."""
    with open_regular(given, kind, most, error) as file:
        chunks = iter(functools.partial(file.read, _CHUNK), b"")  # reading `most` at once would reserve that much
        content = b"".join(itertools.islice(chunks, most // _CHUNK + 1))
    if len(content) > most:  # it grew, or reports no size, as files in /proc do
        raise error(f"{kind} {given} has more than the {most:,} bytes that are read")
    return content


def decoded(content: bytes, what: str, error: type[WarehouseError] = MapError) -> str:
    """Return text with \\n line ends, decoded as UTF-8 with or without its mark; raises `error` otherwise."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as failed:
        line = failed.object[: failed.start].count(b"\n") + 1
        raise error(f"{what}, line {line}: the text is not UTF-8; save the file as UTF-8") from None
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise error(f"{what}, line {line}: a zero byte, so this is no text; if it is one, save the file as UTF-8")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_text(given: object, kind: str, most: int, error: type[WarehouseError] = MapError) -> str:
    """Return the text of a regular file of at most `most` bytes; raises `error` (`open_regular`, `decoded`)."""
    return decoded(read_bytes(given, kind, most, error), f"{kind} {given}", error)


def text_lines(given: object, kind: str, most: int, longest: int) -> Iterator[tuple[int, str]]:
    """Yield (number from 1, line) of a text that need not fit into memory.

    Bytes that are not UTF-8 come as half characters (surrogateescape). Raises WarehouseError as `open_regular` does,
    and for a line of more than `longest` characters.
    """
    with (
        open_regular(given, kind, most, WarehouseError) as file,
        io.TextIOWrapper(file, "utf-8-sig", "surrogateescape") as text,
    ):
        for number in itertools.count(1):
            line = text.readline(longest + 1)
            if len(line) > longest:
                raise WarehouseError(f"{kind} {given}, line {number} has more than {longest:,} characters")
            if not line:
                return
            yield number, line


def parsed_json(text: str, what: str, error: type[WarehouseError] = MapError) -> Any:
    """Return the value of a JSON text; raises `error`, naming the line."""
    try:
        return json.loads(text)
    except json.JSONDecodeError as failed:
        raise error(f"{what}, line {failed.lineno}: not valid JSON ({failed.msg})") from None
    except (ValueError, RecursionError):  # a number of thousands of digits, or thousands of brackets
        raise error(f"{what}, line 1 or later: not valid JSON (a number or the nesting is too long)") from None


def read_json(given: object, kind: str, most: int, error: type[WarehouseError] = MapError) -> Any:
    """Return the value of a JSON file of at most `most` bytes; raises `error` (`read_text`, `parsed_json`)."""
    return parsed_json(read_text(given, kind, most, error), f"{kind} {given}", error)


def as_number(value: Any) -> float:
    """Return a value of a JSON, YAML or CSV file as a number, also if written as text; NaN for anything else."""
    try:
        return math.nan if isinstance(value, bool) or not isinstance(value, (int, float, str)) else float(value)
    except (ValueError, OverflowError):
        return math.nan


def zip_member(archive: zipfile.ZipFile, name: str, most: int) -> bytes:
    """Return the content of a member of a zip file; WarehouseError if it unpacks to more than `most` bytes."""
    with archive.open(name) as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise WarehouseError(f"its {name} holds more than {most:,} bytes")
    return content


def companion(path: Path, suffix: str) -> Path:
    """Return the path of NAME.suffix beside a file NAME.*; with an upper-case suffix if only that exists."""
    usual, large = path.with_suffix(suffix), path.with_suffix(suffix.upper())
    return large if large.exists() and not usual.exists() else usual


def _what(mode: int) -> str:
    kinds = {stat.S_IFIFO: "pipe", stat.S_IFCHR: "device", stat.S_IFBLK: "device"}
    return kinds.get(stat.S_IFMT(mode), "socket")


_inputs: set[tuple[int, int]] = set()  # the files that a command reads
_rows: set[Path] | None = None  # those that it fills row by row; None outside a command


@contextlib.contextmanager
def guarded(inputs: Iterable[Path]) -> Iterator[None]:
    """Inside this context, refuse to overwrite any of these files, under any name, or a file of rows."""
    global _inputs, _rows
    before = _inputs, _rows
    _inputs, _rows = {identity for path in inputs if (identity := _identity(path))}, set()
    try:
        yield
    finally:
        _inputs, _rows = before


def check_writable(given: object, rows: bool = False) -> Path:
    """Return the path of an output, links followed; WarehouseError if it cannot or must not be written.

    Commands check this before they work for hours. rows: the file is filled row by row; no other output may replace it.
    """
    path = path_of(given)
    target = _followed(path)
    if target.is_dir():
        raise WarehouseError(f"{path} is a folder; name a file")
    if target.is_file() and _identity(target) in _inputs:
        raise WarehouseError(f"cannot write {path}: this command reads it; name another file for the output")
    if not rows and target in (_rows or ()):
        raise WarehouseError(f"cannot write {path}: the rows go there; name another file for one of the two")
    if rows and _rows is not None and not is_special(target):
        _rows.add(target)
    there = next(place for place in (target, *target.parents) if place.exists())
    writable = os.access(there, os.W_OK)
    if there == target and not (writable and there.stat().st_mode & 0o222):  # root may write to any
        raise WarehouseError(f"cannot write {path}: it is read-only; name another file or allow writing")
    if there != target and not (there.is_dir() and writable):
        raise WarehouseError(f"cannot write {path}: {there} is no folder that can be written to")
    return target


def _identity(path: Path) -> tuple[int, int] | None:
    try:
        about = path.stat()
    except OSError:
        return None
    return about.st_dev, about.st_ino


def _part_file(path: Path, rows: bool) -> Path:
    """Create an empty file with the suffix of `path` beside the output, in folders made if missing.

    Leftovers of killed processes are removed. Raises WarehouseError if `path` cannot be written. rows: see
    `check_writable`.
    """
    target = check_writable(path, rows)
    try:
        folder = Path(tempfile.gettempdir()) if is_special(target) else target.parent
        folder.mkdir(parents=True, exist_ok=True)
        _sweep(folder, target.stem, path.suffix)
        handle, name = tempfile.mkstemp(prefix=f".{target.stem}-{os.getpid()}-", suffix=path.suffix, dir=folder)
    except OSError as error:
        raise WarehouseError(f"cannot write {path}: {error.strerror or error}") from error
    # mkstemp makes the file private; outputs get the permissions of any other new file
    mask = os.umask(0)
    os.umask(mask)
    os.fchmod(handle, 0o666 & ~mask)
    os.close(handle)
    return Path(name)


def _followed(path: Path) -> Path:
    return path if is_special(path) else Path(os.path.realpath(path))  # a pipe's name in /proc leads nowhere


def is_special(target: Path) -> bool:
    """Whether an output is a device, a pipe or a socket, which must stay what it is."""
    return target.exists() and not target.is_file()


def _sweep(folder: Path, stem: str, suffix: str) -> None:
    """Remove parts of an output whose writing processes are gone."""
    before = f".{stem}-"
    for part in folder.glob(f"{glob.escape(before)}*-*{glob.escape(suffix)}"):
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
def complete_file(given: object, rows: bool = False) -> Iterator[Path]:
    """Yield a part of an output to write; it becomes the output at the end, or is removed on an error.

    A device or pipe gets its bytes, a file keeps its permissions. Raises WarehouseError if the output cannot be
    written, for example on a full disk.
    """
    path = path_of(given)
    part = _part_file(path, rows)
    try:
        yield part
        target = _followed(path)
        if is_special(target):
            with part.open("rb") as source, target.open("wb") as sink:
                shutil.copyfileobj(source, sink)
            return
        if target.exists():
            os.chmod(part, stat.S_IMODE(target.stat().st_mode))
        os.replace(part, target)
    except OSError as error:
        if error.filename not in (None, str(part), str(_followed(path))):  # about another file
            raise
        raise WarehouseError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        part.unlink(missing_ok=True)


def write_text(path: object, text: str, rows: bool = False) -> None:
    """Write a text file, all of it or nothing; rows: see `check_writable`."""
    with complete_file(path, rows) as part:
        part.write_text(text, encoding="utf-8", newline="\n")


def file_digest(path: Path) -> str:
    """Return a digest of a file's content, which tells versions apart."""
    return hashlib.blake2b(read_bytes(path, "file", MOST, WarehouseError), digest_size=8).hexdigest()
