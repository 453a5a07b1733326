"""Independent pieces of work side by side in processes; what they give does not depend on how many there are."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")


def work_all(work: Callable[[Job], Result], jobs: Sequence[Job], processes: int) -> Iterator[Result]:
    """Yield `work(job)` of every job as it ends, in any order; in this process where one is enough.

    `work` is a function of a module and, like jobs and results, can be pickled. Its errors are raised here. Leaving
    the generator early ends the processes.
    """
    if min(processes, len(jobs)) <= 1:
        yield from map(work, jobs)
        return
    context = multiprocessing.get_context("spawn")  # a fork would inherit locks and threads in an unknown state
    with context.Pool(min(processes, len(jobs)), _set_up) as pool:
        yield from pool.imap_unordered(work, jobs)


def _set_up() -> None:
    """Begin a process: one thread, and Ctrl-C is left to the parent, which then ends all."""
    from warehouse_env.threads import set_num_threads

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    set_num_threads(1)
