"""Jobs done in several processes of this machine."""

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

from train.evaluation.jobs import Job, Numbered, Progress, Result, lost_jobs
from train.job_files import Typed, take_in, taken_in

_WAIT = 0.2  # [s] between two looks at the processes


class Processes:
    """Processes that start when they are needed (see `Workers`).

    Each is a pool of its own, so a killed one takes no others with it. Its job is repeated once, after all others and
    alone, since the memory may have been full.
    """

    def __init__(self, processes: int) -> None:
        """Run up to `processes` jobs at a time."""
        self.width = processes
        self._idle: list[ProcessPoolExecutor] = []
        self._busy: dict[Future[Result], tuple[ProcessPoolExecutor, Numbered]] = {}
        self._pipe: tuple[Connection, Connection] | None = None  # closing its second end ends the processes
        self._done = 0.0

    def each(self, jobs: Sequence[Numbered], moved: Progress) -> Iterator[tuple[int, Result]]:
        """Do the jobs (see `Workers.each`)."""
        self._done = 0.0
        killed = yield from self._each(jobs, self.width, moved)
        lost = yield from self._each(killed, 1, moved)
        if lost:
            raise lost_jobs([job for _, job in lost], len(jobs), tries=2)

    def _each(
        self, jobs: Sequence[Numbered], width: int, moved: Progress
    ) -> Generator[tuple[int, Result], None, list[Numbered]]:
        """Do jobs, `width` at a time; return those whose process was killed."""
        waiting, killed, title = deque(jobs), list[Numbered](), "processes start"
        while waiting or self._busy:
            while waiting and len(self._busy) < width:
                self._send(waiting.popleft())
            for future in wait(self._busy, _WAIT, FIRST_COMPLETED).done:
                pool, (number, job) = self._busy.pop(future)
                if isinstance(future.exception(), BrokenProcessPool):
                    killed.append((number, job))
                    continue
                self._idle.append(pool)
                self._done, title = self._done + job.size, job.title
                yield number, future.result()
            moved(self._done, f"{width} at a time · {title}")
        return killed

    def _send(self, numbered: Numbered) -> None:
        """Give a job to an idle process or a new one."""
        pool = self._idle.pop() if self._idle else self._start()
        try:
            future = pool.submit(_work, numbered[1])
        except BrokenProcessPool:  # killed while it was idle
            pool = self._start()
            future = pool.submit(_work, numbered[1])
        self._busy[future] = pool, numbered

    def close(self) -> None:
        """End all processes."""
        if self._pipe is None:
            return
        self._pipe[1].close()
        for pool in (*self._idle, *(pool for pool, _ in self._busy.values())):
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
