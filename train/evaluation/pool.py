"""Experiments one after the other, or side by side in processes: the rows are the same, only the time differs."""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from train.evaluation.places import Places
from train.evaluation.rollout import Experiment, Routes, Trace, Watcher, run
from train.reporting.rows import Row
from warehouse_env.simulation.simulator import Simulator

_TICK = 50  # steps between two notes of progress
_WAIT = 0.2  # [s] between two looks at the processes


class Job(NamedTuple):
    """An experiment to play, its number among all, and whether its first episode is traced, its places noted."""

    number: int
    experiment: Experiment
    traced: bool
    noted: bool = False


class Played(NamedTuple):
    """What a job gave."""

    number: int
    rows: list[Row]
    trace: Trace | None
    notes: list[Row]


def play_all(jobs: Sequence[Job], processes: int, progress: Callable[[int, str], None]) -> Iterator[Played]:
    """Play all jobs and yield each as it ends; `progress(steps, title)` hears how many steps are done in all.

    Errors of a job are raised here. Leaving the generator early ends the processes.
    """
    if min(processes, len(jobs)) <= 1:
        yield from _in_turn(jobs, progress)
        return
    context = multiprocessing.get_context("spawn")  # a fork would inherit locks and threads in an unknown state
    done = context.Value("q", 0)
    with context.Pool(min(processes, len(jobs)), _set_up, (done,)) as pool:
        results = pool.imap_unordered(_work, jobs)
        title = f"{len(jobs)} experiments in {min(processes, len(jobs))} processes"
        while True:
            with contextlib.suppress(multiprocessing.TimeoutError):
                try:
                    yield results.next(timeout=_WAIT)
                except StopIteration:
                    return
            progress(done.value, title)


def _in_turn(jobs: Sequence[Job], progress: Callable[[int, str], None]) -> Iterator[Played]:
    routes, done = Routes(), 0
    for job in jobs:
        title = job.experiment.title
        progress(done, title)
        yield _play(job, routes, lambda steps, base=done, title=title: progress(base + steps, title))  # type: ignore[misc]
        done += job.experiment.config.max_steps
    progress(done, "")


def _play(job: Job, routes: Routes, tick: Callable[[int], None]) -> Played:
    def watch(simulator: Simulator, steps: int) -> None:
        if steps % _TICK == 0:
            tick(steps)

    trace = Trace(job.experiment) if job.traced else None
    places = Places(job.experiment) if job.noted else None
    watchers: list[Watcher] = [watch, *(one for one in (trace, places) if one is not None)]
    rows = run(job.experiment, watchers, routes)
    return Played(job.number, rows, trace, [] if places is None else places.rows())


class _Process:
    """What one worker process keeps between its jobs."""

    done: Any = None  # shared count of steps
    routes: Routes


def _set_up(done: Any) -> None:
    """Begin a worker process: one thread, and Ctrl-C is left to the parent, which then ends all."""
    from warehouse_env.threads import set_num_threads

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    set_num_threads(1)
    _Process.done, _Process.routes = done, Routes()


def _work(job: Job) -> Played:
    counted = 0

    def tick(steps: int) -> None:
        nonlocal counted
        with _Process.done.get_lock():
            _Process.done.value += steps - counted
        counted = steps

    played = _play(job, _Process.routes, tick)
    tick(job.experiment.config.max_steps)
    return played
