"""Jobs done in several processes of this machine."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import Connection

from train.evaluation.jobs import Job, Result
from train.evaluation.remote import WAIT, RemoteWorkers
from train.own import Typed, take_in, taken_in


class Processes(RemoteWorkers):
    """Processes that start when they are needed. Each is a pool of its own, so a killed one takes no others with it."""

    tries = 2
    again_alone = True  # it may have been killed because the memory was full

    def __init__(self, processes: int) -> None:
        """Run up to `processes` jobs at a time."""
        self._width = processes
        self._idle: list[ProcessPoolExecutor] = []
        self._busy: dict[Future[Result], ProcessPoolExecutor] = {}
        self._pipe: tuple[Connection, Connection] | None = None  # closing its second end ends the processes

    @property
    def width(self) -> int:
        """How many processes there may be."""
        return self._width

    def send(self, job: Job) -> Future[Result]:
        """Give a job to an idle process or a new one."""
        pool = self._idle.pop() if self._idle else self._start()
        try:
            future = pool.submit(_work, job)
        except BrokenProcessPool:  # killed while it was idle
            pool = self._start()
            future = pool.submit(_work, job)
        self._busy[future] = pool
        return future

    def ended(self) -> Iterator[tuple[Future[Result], Result | None]]:
        """Yield the jobs that ended; a process that was killed is forgotten."""
        for future in wait(self._busy, WAIT, FIRST_COMPLETED).done:
            pool = self._busy.pop(future)
            try:
                result = future.result()
            except BrokenProcessPool:
                yield future, None
                continue
            self._idle.append(pool)
            yield future, result

    def close(self) -> None:
        """End all processes."""
        if self._pipe is None:
            return
        self._pipe[1].close()
        for pool in (*self._idle, *self._busy.values()):
            pool.shutdown()
        self._pipe[0].close()
        self._idle, self._busy, self._pipe = [], {}, None

    def _start(self) -> ProcessPoolExecutor:
        context = multiprocessing.get_context("spawn")  # a fork would inherit locks and threads in an unknown state
        os.environ.setdefault("PYTHONSAFEPATH", "1")  # keeps files of the working folder from shadowing modules
        self._pipe = self._pipe or context.Pipe(duplex=False)
        return ProcessPoolExecutor(1, context, _set_up, (self._pipe[0], taken_in()))


def _set_up(end: Connection, typed: list[Typed]) -> None:
    """Prepare a worker process: one thread, the user's own parts, and Ctrl-C left to the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(end,), daemon=True).start()
    from warehouse_env.threads import set_num_threads

    set_num_threads(1)
    take_in(typed)


def _end_with(end: Connection) -> None:
    """End this process when the parent closes its end of the pipe or is killed."""
    with contextlib.suppress(EOFError, OSError):
        end.recv_bytes()
    os._exit(1)


def _work(job: Job) -> Result:
    return job.run(lambda part: None)
