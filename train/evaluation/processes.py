"""Jobs done in several processes of this machine."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import Connection
from typing import Any

from train.evaluation.jobs import WAIT, Job, Numbered, Progress, Result
from train.own import Typed, take_in, taken_in
from warehouse_env.errors import LostError


class Processes:
    """Processes that do jobs, begun when they are needed, and anew after one was killed, which ends the others, too."""

    def __init__(self, processes: int) -> None:
        """Have up to so many at a time."""
        self.width = processes
        self._done = 0.0  # size of the jobs that are over
        self._parts: Any = None  # how much of its job each has done, shared with them
        self._pool: ProcessPoolExecutor | None = None
        self._opened = contextlib.ExitStack()

    def close(self) -> None:
        """End all processes, whatever they are at."""
        self._pool = None
        self._opened.close()

    def each(self, jobs: Sequence[Numbered], moved: Progress) -> Iterator[tuple[int, Result]]:
        """Yield number and result of each job as it ends; after all, LostError names those that killed a process."""
        waiting, lost = deque(jobs), list[Numbered]()
        self._done = 0.0
        while waiting:
            suspects = yield from self._together(waiting, self.width, moved)
            for suspect in suspects:
                lost += yield from self._together(deque([suspect]), 1, moved)
        if lost:
            named = "; ".join(job.title for _, job in lost)
            raise LostError(f"{len(lost)} of {len(jobs)} jobs killed their process twice, at last done alone: {named}")

    def _together(
        self, waiting: deque[Numbered], most: int, moved: Progress
    ) -> Generator[tuple[int, Result], None, list[Numbered]]:
        """Do what waits, up to `most` at a time, until a process is killed; return what was under way then."""
        free, broken = list(range(most)), list[Numbered]()
        under_way: dict[Future[Result], tuple[int, Numbered]] = {}
        title = ""
        while under_way or (waiting and not broken):
            while free and waiting and not broken:
                slot, one = free.pop(), waiting.popleft()
                try:
                    under_way[self._begun().submit(_work, one[1], slot)] = slot, one
                except BrokenProcessPool:
                    broken.append(one)
            for future in wait(under_way, WAIT, FIRST_COMPLETED).done:
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
            moved(self._done + sum(self._parts), f"{self.width} processes · {title}")
        if broken:
            self.close()
        return broken

    def _begun(self) -> ProcessPoolExecutor:
        if self._pool is None:
            context = multiprocessing.get_context("spawn")  # a fork would inherit locks and threads in an unknown state
            self._parts = context.RawArray("d", self.width)  # no lock, which a killed process could keep
            os.environ.setdefault("PYTHONSAFEPATH", "1")  # so a file of the working folder is none of Python's to them
            end, ours = context.Pipe(duplex=False)
            pool = ProcessPoolExecutor(self.width, context, _set_up, (self._parts, end, taken_in()))
            for close in (end.close, pool.shutdown, ours.close):  # in the end the last one comes first
                self._opened.callback(close)
            self._pool = pool
        return self._pool


_parts: Any = None  # of a worker process: `Processes._parts`


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
