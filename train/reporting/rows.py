"""Rows of results: JSON lines in and out, safe files, means with intervals.

A row is a flat dict of JSON values, one episode or one run each. Every table and picture is made from rows alone.
"""

import errno
import json
import math
import os
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple, Self, TextIO

import numpy as np
from filelock import FileLock, Timeout

from warehouse_env.errors import WarehouseError
from warehouse_env.files import MOST, check_writable, is_special, read_bytes, text_lines, write_text

Row = dict[str, Any]
_LONGEST = 64_000_000  # characters of a row
_NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP)  # of a file system without locks, as some clusters have


def plain(value: Any) -> Any:
    """Return `value` in JSON types; numbers that are not finite become None."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


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


class RowFile:
    """A JSON-lines file that grows by whole rows; it is opened at the first row, so bad input leaves it unchanged.

    With `path` None rows are only counted. Existing rows are kept with `keep`, else replaced; with `instead`, the text
    of an advice, they are refused. In its context no other command can write the file: WarehouseError names the other.
    """

    def __init__(self, path: Path | None, keep: bool = False, instead: str = "") -> None:
        self.path = path
        self.count = 0
        self._keep, self._instead = keep, "" if keep else instead
        self._lock = ExitStack()
        self._stream: TextIO | None = None  # stays open for a device or pipe
        if path is not None:
            check_writable(path, rows=True)

    def __enter__(self) -> Self:
        if self.path is not None and not is_special(self.path):
            self._lock.enter_context(held(self.path.with_name(f".{self.path.name}.lock"), self.path))
            there = self.path.read_bytes().count(b"\n") if self._instead and self.path.is_file() else 0
            if there:
                self._lock.close()
                raise WarehouseError(f"{self.path} holds {there:,} row{'s' * (there > 1)} already: {self._instead}")
        return self

    def __exit__(self, *error: object) -> None:
        self._lock.close()

    def old(self) -> list[Row]:
        """Return the existing rows that are kept (errors: `whole_rows`)."""
        return whole_rows(self.path) if self._keep and self.path is not None else []

    def add(self, rows: Iterable[Row]) -> None:
        """Append `rows` in one write."""
        lines = [json.dumps(plain(row), allow_nan=False) + "\n" for row in rows]
        if self.path is not None and lines and is_special(self.path):
            self._stream = self._stream or self.path.open("w", encoding="utf-8")
            print("".join(lines), end="", file=self._stream, flush=True)
        elif self.path is not None and lines:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            if self._keep and not self.count:
                _cut_torn_line(self.path)  # else its rest and the first row would become one line
            with self.path.open("a" if self._keep or self.count else "w", encoding="utf-8") as file:
                file.write("".join(lines))
        self.count += len(lines)

    def written(self) -> str:
        """Return the last line of a command that writes nothing else."""
        return "wrote no file; --json FILE keeps the rows" if self.path is None else f"wrote the rows to {self.path}"

    def kept(self) -> str:
        """Return what an interrupted command leaves behind, in a few words."""
        if self.path is None or not self.count:
            return "no rows were kept"
        return f"{self.count} rows are kept in {self.path}"


def read_rows(path: Path) -> list[Row]:
    """Return the rows of a JSON-lines file; raises WarehouseError naming the file and line of a damaged one."""
    rows = []
    for number, line in text_lines(path, "file of rows", MOST, _LONGEST):
        if not line.strip():
            continue
        try:
            row = json.loads(line.encode())
        except (ValueError, RecursionError) as error:
            row = error
        if not isinstance(row, dict):
            what = "UTF-8" if isinstance(row, UnicodeError) else "a JSON object"
            raise WarehouseError(f"{path}, line {number}: not {what}; delete the line or the file")
        rows.append(row)
    return rows


def whole_rows(path: Path) -> list[Row]:
    """Return the rows of a file, none if there is no file; cut off an unfinished last line."""
    if not path.exists():
        return []
    _cut_torn_line(path)
    return read_rows(path)


def _cut_torn_line(path: Path) -> None:
    if path.is_file():
        content = read_bytes(path, "file of rows", MOST, WarehouseError)
        if not content.endswith(b"\n"):
            os.truncate(path, content.rfind(b"\n") + 1)


def write_rows(path: Path, rows: Iterable[Row]) -> None:
    """Write a JSON-lines file, all of it or nothing."""
    write_text(path, "".join(json.dumps(plain(row), allow_nan=False) + "\n" for row in rows), rows=True)


class Interval(NamedTuple):
    """A mean over independent samples and its 95% interval; `low` and `high` are NaN below two samples."""

    mean: float
    low: float
    high: float
    samples: int

    def times(self, factor: float) -> Self:
        """Return it with mean and limits times a factor."""
        return self._replace(mean=factor * self.mean, low=factor * self.low, high=factor * self.high)

    def cut(self, most: float = math.inf) -> Self:
        """Return it with the limits cut to the values that are possible, 0 to `most`; NaN stays NaN."""
        return self._replace(low=max(self.low, 0.0), high=min(self.high, most))


def mean_interval(values: Iterable[float | None], coverage: float = 0.95) -> Interval:
    """Return the mean with its interval (95% unless `coverage` says otherwise) by Student's t, without None and NaN.

    The samples are whole episodes (or runs): robots of one episode hinder each other, so they are not independent.
    """
    sample = np.array([value for value in values if value is not None and math.isfinite(value)], dtype=np.float64)
    count = len(sample)
    if count == 0:
        return Interval(math.nan, math.nan, math.nan, 0)
    mean = float(sample.mean())
    if count == 1:
        return Interval(mean, math.nan, math.nan, 1)
    half = t_quantile(count - 1, coverage) * float(sample.std(ddof=1)) / math.sqrt(count)
    return Interval(mean, mean - half, mean + half, count)


def short_names(names: set[str]) -> dict[str, str]:
    """Return the last part of each path, or the whole name if the last parts are not unique."""
    last = {name: Path(name).name or name for name in names}
    counts = Counter(last.values())
    return {name: short if counts[short] == 1 else name for name, short in last.items()}


def values_of(row: Row, names: Sequence[str]) -> tuple[object, ...]:
    """Return the values of some fields of a row, None for missing ones."""
    return tuple(row.get(name) for name in names)


def is_significant(difference: Interval) -> bool:
    """Return whether the interval of a difference excludes 0."""
    return difference.low > 0 or difference.high < 0


def stratified_interval(strata: Sequence[Sequence[float]]) -> Interval:
    """Return the mean of the strata's means, equally weighted, with its 95% interval.

    The interval is Student's t over the samples within strata, with the degrees of freedom of Welch (1947) rounded
    down; differences between strata are not chance. `low` and `high` are NaN if a stratum has fewer than two samples.
    """
    count, samples = len(strata), sum(map(len, strata))
    mean = float(np.mean([np.mean(values) for values in strata]))
    if min(map(len, strata)) < 2:
        return Interval(mean, math.nan, math.nan, samples)
    errors = [float(np.var(values, ddof=1)) / len(values) for values in strata]
    if not sum(errors) > 0:
        return Interval(mean, mean, mean, samples)
    least = sum(error**2 / (len(values) - 1) for error, values in zip(errors, strata, strict=True))
    half = t_quantile(max(1, int(sum(errors) ** 2 / least + 1e-9))) * math.sqrt(sum(errors)) / count
    return Interval(mean, mean - half, mean + half, samples)


def wilson_interval(successes: int, trials: int) -> Interval:
    """Return a share with its 95% interval by Wilson's score (1927), good near 0 and 1 as well; trials: at least 1."""
    from scipy.stats import binomtest  # imported late: it takes a second

    found = binomtest(successes, trials).proportion_ci(method="wilson")
    return Interval(successes / trials, float(found.low), float(found.high), trials)


def t_quantile(freedom: float, coverage: float = 0.95) -> float:
    """Return the t that Student's distribution keeps within +-t with probability `coverage`."""
    from scipy.special import stdtrit  # imported late: it takes a third of a second

    return float(stdtrit(freedom, 0.5 + 0.5 * coverage))


def select(rows: Sequence[Row], **values: Any) -> list[Row]:
    """Return the rows whose named fields have these values."""
    return [row for row in rows if all(row.get(name) == value for name, value in values.items())]
