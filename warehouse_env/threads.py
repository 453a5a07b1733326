"""The number of threads, and the helper threads that step many worlds; helpers sleep until there is work.

Threads of OpenMP and of a BLAS spin for milliseconds after each piece of work. If two libraries share the cores, each
waits for cores on which the other one spins. So the step enters no parallel region of Numba. Any thread may do any
part, and the calling thread does every part that no helper has taken, so it never waits for a helper without a core.
Numba is not asked for its number of threads either: that call starts them, and resets torch's number where both share
one OpenMP.
"""

import os
import time
from collections import deque
from collections.abc import Callable, Sequence
from queue import SimpleQueue
from threading import Lock, Thread, local
from typing import Any, TypeVar

import numba

from warehouse_env.errors import check_count

MOST_THREADS = int(numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]  # the cores, or as the environment says
T = TypeVar("T")
Done = SimpleQueue[tuple[T | None, BaseException | None]]

_jobs: SimpleQueue[Callable[[], None]] = SimpleQueue()
_helpers: list[Thread] = []
_lock = Lock()
_allowed = local()


def set_num_threads(threads: int) -> None:
    """Set how many threads the calling thread uses for steps of many worlds and for plans; all cores by default."""
    _allowed.threads = check_count("threads", threads)


def get_num_threads() -> int:
    """Return how many threads the calling thread may use."""
    return getattr(_allowed, "threads", MOST_THREADS)


def side_by_side(call: Callable[..., T], parts: Sequence[Sequence[Any]]) -> list[T]:
    """Return `call(*part)` for all parts, in any order, on as many threads as allowed.

    `call` must release the interpreter's lock (a kernel does). The first exception of a part is raised after all parts
    have ended. An interrupt starts no further part and is raised once no part is running.
    """
    if len(parts) == 1:
        return [call(*parts[0])]
    waiting = deque(parts)
    done: Done[T] = SimpleQueue()
    inside: list[None] = []  # one for each helper that may have taken a part

    def help_out() -> None:
        inside.append(None)
        try:
            _work(call, waiting, done)
        finally:
            inside.pop()

    helpers = min(get_num_threads(), len(parts)) - 1
    _wake(helpers)
    try:
        for _ in range(helpers):
            _jobs.put(help_out)
        _work(call, waiting, done)
        results = [done.get() for _ in parts]
    except BaseException:  # an interrupt: helpers must not write to the caller's arrays after this returns
        waiting.clear()
        while inside:
            time.sleep(0.001)
        raise
    for _, error in results:
        if error is not None:
            raise error
    return [result for result, _ in results]  # type: ignore[misc]


def _work(call: Callable[..., T], waiting: deque[Sequence[Any]], done: Done[T]) -> None:
    """Do parts until none waits."""
    while True:
        try:
            part = waiting.popleft()
        except IndexError:
            return
        try:
            done.put((call(*part), None))
        except BaseException as error:
            done.put((None, error))


def _wake(helpers: int) -> None:
    """Start helpers until there are at least so many; they live as long as the process."""
    while len(_helpers) < helpers:
        with _lock:
            if len(_helpers) < helpers:
                _helpers.append(Thread(target=_help, name="warehouse step", daemon=True))
                _helpers[-1].start()


def _help() -> None:
    while True:
        _jobs.get()()


def _forget() -> None:
    """Reset a forked process, which has none of its parent's threads."""
    global _jobs, _lock
    _jobs, _lock = SimpleQueue(), Lock()
    _helpers.clear()


os.register_at_fork(after_in_child=_forget)
