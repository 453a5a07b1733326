"""Jobs -> rows: in this process or in several, each job's rows in a file as soon as it ends, so that a stop loses the
jobs at hand at most; what a file holds already is not done again.

What a job gives does not depend on where it is done, nor on what is done beside it.
"""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import random
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import Connection
from typing import Any, ClassVar, NamedTuple

from train.evaluation.own import Typed, take_in, taken_in
from train.reporting.report import make_progress
from train.reporting.rows import Row, RowFile, write_rows
from warehouse_env.errors import LostError

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


_Numbered = tuple[int, Job]


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
    own = {row["run"]: row for row in rows if isinstance(row.get("run"), int)}
    return [own[run] for run in range(runs)] if all(run in own for run in range(runs)) else []


def _key(row: Row, names: Sequence[str]) -> str:
    return json.dumps([row.get(name) for name in names], sort_keys=True)


def go_on(file: RowFile, jobs: Sequence[Job], ours: Callable[[Row], bool], fresh: bool = False) -> list[Row]:
    """Return the rows of a file that stand, as a `Runner` takes them; say how many jobs are done.

    Rows that are `ours` but of no job, made by other code or from other seeds, are taken out of the file; fresh: all
    that are ours.
    """
    old = file.old()
    known = Known([] if fresh else old)
    done = [job.left(known.of(job)) for job in jobs]
    kept = [row for rows, _ in done for row in rows]
    good = [*(row for row in old if not ours(row)), *kept]
    if file.path is not None and len(good) < len(old):
        write_rows(file.path, good)
    whole = sum(left is None for _, left in done)
    if whole:
        print(f"{whole} of {len(jobs)} jobs are kept from {file.path}; --fresh does them again")
    return kept


class Runner:
    """Does jobs whose rows are not there yet, and writes them as each ends; a context, which ends the processes.

    Errors of a job are raised as they are. On Ctrl-C the KeyboardInterrupt says which rows are kept. A job whose
    process is killed, say for its memory, is done once more with nothing beside it; if that is killed as well,
    LostError names it, after all other jobs.
    """

    def __init__(
        self, file: RowFile, old: Sequence[Row] = (), processes: int = 1, *, goes_on: str = "", mixed: bool = False,
        progress: Progress | None = None, hear: Callable[[int, Any], None] = lambda number, more: None,
    ) -> None:  # fmt: skip
        """Open with a file for the rows, and the old ones that are there already.

        processes: jobs at a time, each in a process of its own; in this one if it is 1. goes_on: how a stopped command
        goes on, if it does. mixed: do jobs by chance, always the same, so that the time that is left can be told from
        what is done. progress: hears how far the jobs are; a bar on stderr if left out. hear: told a job's number and
        what it made besides rows, before these are written, so that no rows stand without it.
        """
        self._file, self._known, self._processes = file, Known(old), processes
        self._goes_on, self._mixed, self._progress, self._hear = goes_on, mixed, progress, hear
        self._workers = _Workers(processes)

    def __enter__(self) -> Runner:
        return self

    def __exit__(self, *error: object) -> None:
        self._workers.close()

    def __call__(self, jobs: Sequence[Job]) -> list[Row]:
        """Return the rows of all jobs, in their order."""
        rows: dict[int, list[Row]] = {}
        missing: list[_Numbered] = []
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
                    self._hear(number, result.more)
                    self._file.add(result.rows)
                    self._known.add(result.rows)
                    rows[number] += result.rows
        except KeyboardInterrupt as stop:
            raise type(stop)(*self._left_behind()) from None
        except LostError as error:
            raise LostError("; ".join([str(error), *self._left_behind()])) from None
        return [row for number in sorted(rows) for row in rows[number]]

    def _left_behind(self) -> list[str]:
        return [self._file.kept(), *([self._goes_on] if self._goes_on and self._file.count else [])]

    def _done(self, missing: Sequence[_Numbered], moved: Progress) -> Iterator[tuple[int, Result]]:
        return _in_turn(missing, moved) if self._processes == 1 else self._workers.each(missing, moved)


@contextlib.contextmanager
def _shown(size: float, progress: Progress | None) -> Iterator[Progress]:
    if progress is not None:
        yield progress
        return
    with make_progress() as bars:
        bar = bars.add_task("", total=size)
        yield lambda done, title: bars.update(bar, completed=done, description=title)


def _in_turn(jobs: Sequence[_Numbered], moved: Progress) -> Iterator[tuple[int, Result]]:
    done = 0.0
    for number, job in jobs:
        moved(done, job.title)
        yield number, job.run(lambda part, done=done, job=job: moved(done + part, job.title))  # type: ignore[misc]
        done += job.size
        moved(done, job.title)


class _Workers:
    """Processes that do jobs, begun when they are needed, and anew after one was killed, which ends the others, too."""

    def __init__(self, processes: int) -> None:
        self._processes = processes
        self._done = 0.0  # size of the jobs that are over
        self._parts: Any = None  # how much of its job each has done, shared with them
        self._pool: ProcessPoolExecutor | None = None
        self._opened = contextlib.ExitStack()

    def close(self) -> None:
        """End all processes, whatever they are at."""
        self._pool = None
        self._opened.close()

    def each(self, jobs: Sequence[_Numbered], moved: Progress) -> Iterator[tuple[int, Result]]:
        """Yield number and result of each job as it ends; after all, LostError names those that killed a process."""
        waiting, lost = deque(jobs), list[_Numbered]()
        self._done = 0.0
        while waiting:
            suspects = yield from self._together(waiting, self._processes, moved)
            for suspect in suspects:
                lost += yield from self._together(deque([suspect]), 1, moved)
        if lost:
            named = "; ".join(job.title for _, job in lost)
            raise LostError(f"{len(lost)} of {len(jobs)} jobs killed their process twice, at last done alone: {named}")

    def _together(
        self, waiting: deque[_Numbered], most: int, moved: Progress
    ) -> Generator[tuple[int, Result], None, list[_Numbered]]:
        """Do what waits, up to `most` at a time, until a process is killed; return what was under way then."""
        free, broken = list(range(most)), list[_Numbered]()
        under_way: dict[Future[Result], tuple[int, _Numbered]] = {}
        title = ""
        while under_way or (waiting and not broken):
            while free and waiting and not broken:
                slot, one = free.pop(), waiting.popleft()
                try:
                    under_way[self._begun().submit(_work, one[1], slot)] = slot, one
                except BrokenProcessPool:
                    broken.append(one)
            for future in wait(under_way, _WAIT, FIRST_COMPLETED).done:
                slot, (number, job) = under_way.pop(future)
                self._parts[slot] = 0.0
                try:
                    result = future.result()
                except BrokenProcessPool:
                    broken.append((number, job))
                    continue
                free.append(slot)
                self._done += job.size
                title = job.title
                yield number, result
            moved(self._done + sum(self._parts), f"{self._processes} processes · {title}")
        if broken:
            self.close()
        return broken

    def _begun(self) -> ProcessPoolExecutor:
        if self._pool is None:
            context = multiprocessing.get_context("spawn")  # a fork would inherit locks and threads in an unknown state
            self._parts = context.RawArray("d", self._processes)  # no lock, which a killed process could keep
            end, ours = context.Pipe(duplex=False)
            pool = ProcessPoolExecutor(self._processes, context, _set_up, (self._parts, end, taken_in()))
            for close in (end.close, pool.shutdown, ours.close):  # in the end the last one comes first
                self._opened.callback(close)
            self._pool = pool
        return self._pool


_parts: Any = None  # of a worker process: `_Workers._parts`


def _set_up(parts: Any, end: Connection, typed: list[Typed]) -> None:
    """Begin a worker process: one thread, what the command loaded, and Ctrl-C left to the parent, which ends all."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(end,), daemon=True).start()
    from warehouse_env.threads import set_num_threads

    global _parts
    set_num_threads(1)
    take_in(typed)
    _parts = parts


def _end_with(end: Connection) -> None:
    """End this process when the parent closes its end of the pipe, be it that it was killed."""
    with contextlib.suppress(EOFError, OSError):
        end.recv_bytes()
    os._exit(1)


def _work(job: Job, slot: int) -> Result:
    def tick(part: float) -> None:
        _parts[slot] = part

    return job.run(tick)
