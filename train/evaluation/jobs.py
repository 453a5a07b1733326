"""Jobs -> rows: in this process or in several, each job's rows in a file as soon as it ends, so that a stop loses the
jobs at hand at most; what a file holds already is not done again.

What a job gives does not depend on where it is done, nor on what is done beside it.
"""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import random
import signal
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from train.reporting.report import make_progress
from train.reporting.rows import Row, RowFile, whole_rows, write_rows

_WAIT = 0.2  # [s] between two looks at the processes

Tick = Callable[[float], None]
"""Called by a job with how much of its size is done."""

Progress = Callable[[float, str], None]
"""Called with the size that is done in all, and the title of what is at hand."""


class Result(NamedTuple):
    """What a job gives: its rows, and what else it has made, which only this run's caller hears of."""

    rows: list[Row]
    more: Any = None


class Job:
    """A piece of work that can be pickled; a subclass says its title and does it, and how its rows are known again."""

    titled: ClassVar[str]  # with the job's fields in braces

    @property
    def identity(self) -> Row:
        """What its rows have in common and are known by: equal identities mean equal rows, but for the times."""
        return {}

    @property
    def title(self) -> str:
        """What the progress bar says."""
        return self.titled.format(**vars(self))

    @property
    def size(self) -> float:
        """How far it moves the progress bar."""
        return 1.0

    def left(self, rows: Sequence[Row]) -> tuple[Sequence[Row], Job | None]:
        """Return which rows of its identity stand, and the job that is left to be done; None if nothing is."""
        return [], self

    def run(self, tick: Tick) -> Result:
        """Do it."""
        raise NotImplementedError


class Known:
    """Rows by what they have in common, to find those of a job again."""

    def __init__(self, rows: Sequence[Row]) -> None:
        self._rows = list(rows)
        self._found: dict[tuple[str, ...], dict[str, list[Row]]] = {}  # by the names of an identity, then its values

    def add(self, rows: Sequence[Row]) -> None:
        """Take more rows."""
        self._rows += rows
        for names, found in self._found.items():
            self._sort_in(rows, names, found)

    def of(self, job: Job) -> list[Row]:
        """Return the rows with a job's identity."""
        if not self._rows:
            return []
        identity = job.identity
        names = tuple(identity)
        if names not in self._found:
            self._found[names] = {}
            self._sort_in(self._rows, names, self._found[names])
        return self._found[names].get(_key(identity, names), [])

    @staticmethod
    def _sort_in(rows: Sequence[Row], names: tuple[str, ...], found: dict[str, list[Row]]) -> None:
        for row in rows:
            found.setdefault(_key(row, names), []).append(row)


def of_all_runs(rows: Sequence[Row], runs: int) -> list[Row]:
    """Return the row of each run, none at all where one is missing."""
    own = {row["run"]: row for row in rows}
    return [own[run] for run in range(runs)] if all(run in own for run in range(runs)) else []


def _key(row: Row, names: Sequence[str]) -> str:
    return json.dumps([row.get(name) for name in names], sort_keys=True)


def go_on(
    path: Path, jobs: Sequence[Job], ours: Callable[[Row], bool], fresh: bool = False
) -> tuple[RowFile, list[Row]]:
    """Return the file at `path` and its rows that stand, as a `Runner` takes them; say how many jobs are done.

    Rows that are `ours` but of no job, made by other code or from other seeds, are taken out of the file; fresh: all
    that are ours.
    """
    old = whole_rows(path)
    known = Known([] if fresh else old)
    done = [job.left(known.of(job)) for job in jobs]
    kept = [row for rows, _ in done for row in rows]
    good = [*(row for row in old if not ours(row)), *kept]
    if len(good) < len(old):
        write_rows(path, good)
    whole = sum(left is None for _, left in done)
    if whole:
        print(f"{whole} of {len(jobs)} jobs are kept from {path}; --fresh does them again")
    return RowFile(path, keep=True), kept


class Runner:
    """Does jobs whose rows are not there yet, and writes them as each ends; a context, which ends the processes.

    Errors of a job are raised as they are. On Ctrl-C the KeyboardInterrupt says which rows are kept.
    """

    def __init__(
        self, file: RowFile, old: Sequence[Row] = (), processes: int = 1, *, goes_on: str = "", mixed: bool = False,
        progress: Progress | None = None, hear: Callable[[int, Any], None] = lambda number, more: None,
    ) -> None:  # fmt: skip
        """Open with a file for the rows, and the old ones that are there already.

        processes: jobs at a time, each in a process of its own; in this one if it is 1. goes_on: how a stopped command
        goes on, if it does. mixed: do jobs by chance, always the same, so that the time that is left can be told from
        what is done. progress: hears how far the jobs are; a bar on stderr if left out. hear: told a job's number and
        what it made besides rows, after these are written.
        """
        self._file, self._known, self._processes = file, Known(old), processes
        self._goes_on, self._mixed, self._progress, self._hear = goes_on, mixed, progress, hear
        self._pool = contextlib.ExitStack()
        self._workers: _Workers | None = None

    def __enter__(self) -> Runner:
        return self

    def __exit__(self, *error: object) -> None:
        self._pool.close()

    def __call__(self, jobs: Sequence[Job]) -> list[Row]:
        """Return the rows of all jobs, in their order."""
        rows: dict[int, list[Row]] = {}
        missing: list[tuple[int, Job]] = []
        for number, job in enumerate(jobs):
            stand, left = job.left(self._known.of(job))
            rows[number] = list(stand)
            if left is not None:
                missing.append((number, left))
        if self._mixed:
            random.Random(0).shuffle(missing)
        try:
            with _shown(sum(job.size for _, job in missing), self._progress) as moved:
                for number, result in self._done(missing, moved):
                    self._file.add(result.rows)
                    self._known.add(result.rows)
                    self._hear(number, result.more)
                    rows[number] += result.rows
        except KeyboardInterrupt:
            more = [self._goes_on] * bool(self._goes_on and self._file.count)
            raise KeyboardInterrupt(self._file.kept(), *more) from None
        return [row for number in sorted(rows) for row in rows[number]]

    def _done(self, missing: Sequence[tuple[int, Job]], moved: Progress) -> Iterator[tuple[int, Result]]:
        count = min(self._processes, len(missing))
        if count <= 1:
            return _in_turn(missing, moved)
        if self._workers is None or self._workers.processes < count:
            self._pool.close()
            self._workers = self._pool.enter_context(_workers(count))
        return self._workers.each(missing, moved)


@contextlib.contextmanager
def _shown(size: float, progress: Progress | None) -> Iterator[Progress]:
    if progress is not None:
        yield progress
        return
    with make_progress() as bars:
        bar = bars.add_task("", total=size)
        yield lambda done, title: bars.update(bar, completed=done, description=title)


def _in_turn(jobs: Sequence[tuple[int, Job]], moved: Progress) -> Iterator[tuple[int, Result]]:
    done = 0.0
    for number, job in jobs:
        moved(done, job.title)
        yield number, job.run(lambda part, done=done, job=job: moved(done + part, job.title))  # type: ignore[misc]
        done += job.size
        moved(done, job.title)


class _Workers(NamedTuple):
    """A pool of processes, and what they share: the size that is done."""

    pool: Any
    done: Any
    processes: int

    def each(self, jobs: Sequence[tuple[int, Job]], moved: Progress) -> Iterator[tuple[int, Result]]:
        """Yield number and result of each job as it ends."""
        self.done.value = 0.0
        results = self.pool.imap_unordered(_work, jobs)
        titles = {number: job.title for number, job in jobs}
        title = ""
        while True:
            with contextlib.suppress(multiprocessing.TimeoutError):
                try:
                    number, result = results.next(timeout=_WAIT)
                except StopIteration:
                    return
                title = titles[number]
                yield number, result
            moved(self.done.value, f"{self.processes} processes · {title}")


@contextlib.contextmanager
def _workers(count: int) -> Iterator[_Workers]:
    context = multiprocessing.get_context("spawn")  # a fork would inherit locks and threads in an unknown state
    done = context.Value("d", 0.0)
    with context.Pool(count, _set_up, (done,)) as pool:
        yield _Workers(pool, done, count)


_done: Any = None  # of a worker process: the size that is done, shared by all


def _set_up(done: Any) -> None:
    """Begin a worker process: one thread, and Ctrl-C is left to the parent, which then ends all."""
    from warehouse_env.threads import set_num_threads

    global _done
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    set_num_threads(1)
    _done = done


def _work(numbered: tuple[int, Job]) -> tuple[int, Result]:
    number, job = numbered
    counted = 0.0

    def tick(part: float) -> None:
        nonlocal counted
        with _done.get_lock():
            _done.value += part - counted
        counted = part

    result = job.run(tick)
    tick(job.size)
    return number, result
