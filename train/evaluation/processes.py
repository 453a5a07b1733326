"""Independent pieces of work side by side in processes; what they give does not depend on how many there are."""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")


def work_all(work: Callable[[Job], Result], jobs: Sequence[Job], processes: int) -> Iterator[Result]:
    """Yield `work(job)` of every job as it ends, in any order; in this process where one is enough.

    `work` is a function of a module and, like jobs and results, can be pickled. Its errors are raised here. Leaving
    the generator early ends the processes.
    """
    with workers(min(processes, len(jobs))) as each:
        yield from each(work, jobs)


@contextlib.contextmanager
def workers(processes: int) -> Iterator[Callable[[Callable[[Any], Any], Iterable[Any]], Iterator[Any]]]:
    """Yield a `map` whose work is done in so many processes, in any order; in this one for less than two."""
    if processes <= 1:
        yield map
        return
    context = multiprocessing.get_context("spawn")  # a fork would inherit locks and threads in an unknown state
    with context.Pool(processes, _set_up) as pool:
        yield pool.imap_unordered


def _set_up() -> None:
    """Begin a process: one thread, and Ctrl-C is left to the parent, which then ends all."""
    from warehouse_env.threads import set_num_threads

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    set_num_threads(1)
