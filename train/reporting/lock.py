"""One command at a time writes a file of rows, or trains in a folder."""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from warehouse_env.errors import WarehouseError

_NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP)  # of a file system without locks, as some clusters have


@contextmanager
def held(lock: Path, what: Path) -> Iterator[None]:
    """Hold the file `lock`, made with its folders where missing; it is removed at the end, as are folders left empty.

    The lock ends with its process, even a killed one. A file system without locks gives none, and is written to all the
    same. WarehouseError names the process that holds `what`, or says that no file can be written.
    """
    missing = [folder for folder in lock.parents if not folder.exists()]
    mutex = FileLock(lock)
    try:
        lock.parent.mkdir(parents=True, exist_ok=True)
        mutex.acquire(blocking=False)
    except Timeout:
        holder = _content(lock) or "another process"
        raise WarehouseError(f"{what} is in use by {holder}: wait for its end, or name another place") from None
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise WarehouseError(f"cannot write {what}: {error.strerror or error}") from None
    try:
        lock.write_text(f"process {os.getpid()}, since {time.strftime('%Y-%m-%d %H:%M:%S')}", encoding="utf-8")
        yield
    finally:
        lock.unlink(missing_ok=True)  # before the release: a process that has opened it meanwhile notices
        mutex.release()
        with suppress(OSError):  # where something has been written
            for folder in missing:
                folder.rmdir()


def _content(lock: Path) -> str:
    """Return what the holder has written, nothing if it has just gone."""
    with suppress(OSError):
        return lock.read_text(encoding="utf-8")
    return ""
