"""Episodes an hour by who drives them: this process, several, a Ray cluster of this machine; starting apart."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import NamedTuple

from train.evaluation.cluster import LOCAL, Cluster
from train.evaluation.episodes import Episodes
from train.evaluation.jobs import Here, Workers
from train.evaluation.processes import Processes
from train.evaluation.rollout import make_experiment
from train.reporting.report import Table, number
from train.reporting.rows import Row, select
from warehouse_env.config import EnvConfig

POLICY, LAYOUT, PLANNER, ROBOTS = "threaded_ppo", "paper46", "astar_turns", 16
EPISODE = 60.0  # [s] simulated
_TURNS = 3
_LEAST = 4  # episodes for each worker


class _Turn(NamedTuple):
    start_s: float  # until all workers have done a job
    per_s: float  # jobs after that


def jobs(seconds: float, seed: int) -> Iterator[Row]:
    """Yield a row for each kind and number of workers, measured in turns, each turn for about `seconds` a worker."""
    cores = os.cpu_count() or 1
    made: dict[tuple[str, int], Callable[[], Workers]] = {("here", 1): Here}
    for width in dict.fromkeys(width for width in (1, 2, 4, 8, 16, cores) if width <= cores):
        if width > 1:
            made["processes", width] = lambda width=width: Processes(width)  # type: ignore[misc]
        made["ray", width] = lambda width=width: Cluster(LOCAL, cores=width)  # type: ignore[misc]
    once = 1.0 / _turn(Here(), _LEAST, seed).per_s
    each = max(_LEAST, round(seconds / once))
    turns = [{key: _turn(make(), each * key[1], seed) for key, make in made.items()} for _ in range(_TURNS)]
    for kind, width in made:
        own = [turn[kind, width] for turn in turns]
        shares = [turn[kind, width].per_s / (width * turn["here", 1].per_s) for turn in turns]
        yield {
            "workers": kind, "width": width, "start_s": statistics.median(one.start_s for one in own),
            "episodes_per_s": statistics.median(one.per_s for one in own), "efficiency": statistics.median(shares),
            "low": min(shares), "high": max(shares), "on": f"{ROBOTS} robots, {EPISODE:g} s, {LAYOUT}, {POLICY}",
        }  # fmt: skip


def _turn(workers: Workers, count: int, seed: int) -> _Turn:
    """Drive so many episodes, after one for each worker that does not count."""
    experiment = make_experiment(POLICY, EnvConfig(layout=LAYOUT, planner=PLANNER, num_agents=ROBOTS), 1, EPISODE, seed)
    episode = Episodes(experiment)
    with closing(workers):
        begin = time.perf_counter()
        width = workers.width  # a cluster is connected to
        for _ in workers.each([(number, episode) for number in range(2 * width)], lambda done, title: None):
            pass
        started = time.perf_counter()
        for _ in workers.each([(number, episode) for number in range(count)], lambda done, title: None):
            pass
        return _Turn(started - begin, count / (time.perf_counter() - started))


def jobs_table(rows: list[Row]) -> Table:
    """Return the table of `jobs`' rows."""
    header = ("workers", "at a time", "start s", "episodes/s", "of as many times one process %", "spread")
    cells = tuple(
        (
            row["workers"], str(row["width"]), number(row["start_s"], 2), number(row["episodes_per_s"], 3),
            number(100 * row["efficiency"], 3), f"{number(100 * row['low'], 3)} to {number(100 * row['high'], 3)}",
        )
        for row in select(rows, what="jobs")
    )  # fmt: skip
    note = f"An episode: {rows[0]['on']}; in turns within one run; start: until each worker has done two."
    return Table("Jobs by who does them", header, cells, note)
