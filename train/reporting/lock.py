"""One command at a time writes a file of rows, or trains in a folder."""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from warehouse_env.errors import WarehouseError


@contextmanager
def held(lock: Path, what: Path) -> Iterator[None]:
    """Hold the file `lock`, made with its folders where missing; it is gone at the end, as are folders without content.

    The kernel lets go of it when the process ends, however it ends; what a kill leaves there hinders nobody.
    Raises WarehouseError, which says who holds `what`, where another process or an earlier call does, or where no file
    can be written.
    """
    missing = [folder for folder in lock.parents if not folder.exists()]
    handle = _taken(lock, what)
    try:
        os.write(handle, f"process {os.getpid()}, since {time.strftime('%Y-%m-%d %H:%M:%S')}".encode())
        yield
    finally:
        lock.unlink(missing_ok=True)  # before letting go: who opened it meanwhile notices in _taken
        os.close(handle)
        with suppress(OSError):  # where something has been written
            for folder in missing:
                folder.rmdir()


def _taken(lock: Path, what: Path) -> int:
    """Return the open file, empty."""
    while True:
        try:
            lock.parent.mkdir(parents=True, exist_ok=True)
            handle = os.open(lock, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            raise WarehouseError(f"cannot write {what}: {error.strerror or error}") from None
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(handle, 100).decode(errors="replace") or "another process"
            os.close(handle)
            raise WarehouseError(f"{what} is in use by {holder}: wait for its end, or name another place") from None
        except OSError:  # a file system without locks
            return handle
        if _is_open_at(handle, lock):
            os.ftruncate(handle, 0)
            return handle
        os.close(handle)


def _is_open_at(handle: int, path: Path) -> bool:
    """Tell whether a path still leads to an open file: its last holder may have removed it in between."""
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path))
    except FileNotFoundError:
        return False
