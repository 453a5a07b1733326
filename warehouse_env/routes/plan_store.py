"""Plans on disk, shared by processes and threads. A store that is damaged or cannot be opened is ignored."""

from __future__ import annotations

import contextlib
import os
import sqlite3
import weakref
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from platformdirs import user_cache_dir

CACHE_FORMAT = 3  # raise it when a planner's result changes for the same key, or the files' form
LARGEST_STORE = 256 * 2**20  # [bytes] of plans on disk, about 200,000; the oldest quarter is then dropped
PENDING = 64  # plans written to disk at once
_TROUBLE = (OSError, ValueError, TypeError, sqlite3.Error)  # ValueError: an error of SQLite that is no UTF-8


def cache_directory() -> Path:
    """Return the folder of the plan cache: $WAREHOUSE_CACHE_DIR, or the user's cache folder."""
    return Path(os.environ.get("WAREHOUSE_CACHE_DIR") or user_cache_dir("warehouse_env"))


class PlanStore:
    """The store in a folder. Each call opens the file, so threads and forks share nothing."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / f"plans-{CACHE_FORMAT}.sqlite"
        self._pending: list[tuple[str, bytes]] = []
        weakref.finalize(self, _write, self._file, self._pending)  # also at the interpreter's exit

    def get(self, key: str) -> NDArray[np.int64] | None:
        """Return the cells int64[L, 2] kept under a key, or None."""
        with contextlib.suppress(*_TROUBLE), contextlib.closing(sqlite3.connect(self._file, timeout=5.0)) as connection:
            row = connection.execute("SELECT cells FROM plan WHERE key = ?", (key,)).fetchone()
            return None if row is None else np.frombuffer(row[0], dtype="<i4").reshape(-1, 2).astype(np.int64)
        return None

    def put(self, key: str, cells: NDArray[np.int64]) -> None:
        """Keep cells under a key."""
        self._pending.append((key, cells.astype("<i4").tobytes()))
        if len(self._pending) >= PENDING:
            self.flush()

    def flush(self) -> None:
        """Write what is pending."""
        _write(self._file, self._pending)


def _write(file: Path, pending: list[tuple[str, bytes]]) -> None:
    plans = pending[:]
    del pending[: len(plans)]  # what another thread adds meanwhile stays
    if not plans:
        return
    with contextlib.suppress(*_TROUBLE):
        file.parent.mkdir(parents=True, exist_ok=True)
        for former in set(file.parent.glob("plans-*.sqlite")) - {file}:
            former.unlink(missing_ok=True)
        with contextlib.closing(sqlite3.connect(file, timeout=5.0)) as connection, connection:
            connection.execute("PRAGMA synchronous=OFF")
            connection.execute("CREATE TABLE IF NOT EXISTS plan (age INTEGER PRIMARY KEY, key TEXT UNIQUE, cells BLOB)")
            connection.executemany("INSERT OR REPLACE INTO plan (key, cells) VALUES (?, ?)", plans)
            _evict(connection)


def _evict(connection: sqlite3.Connection) -> None:
    """Drop the oldest plans of a store that is too large; later plans reuse their place in the file."""
    pages, free, size = (
        connection.execute(f"PRAGMA {what}").fetchone()[0] for what in ("page_count", "freelist_count", "page_size")
    )
    if (pages - free) * size > LARGEST_STORE:
        connection.execute("DELETE FROM plan WHERE age <= (SELECT min(age) + (max(age) - min(age)) / 4 FROM plan)")
