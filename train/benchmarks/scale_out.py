"""One training over machines: its workers as Ray actors beside the same workers in threads, in turns.

Both do the same updates to the bit, so their times are of the same work; the best of many short turns counts, which
other work on the machine has disturbed least. The rows of a worker and of a gradient step grow together: an update has
as many gradient rounds at every size, so what a round costs can be told.

    python -m train.benchmarks.scale_out --json rows.jsonl
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from train.evaluation.cluster import connected
from train.learning.actors import Actors
from train.learning.config import ThreadedPPOConfig
from train.learning.crew import CrewMaker, Threads
from train.learning.recipes import by_recipe
from train.learning.trainer import profile
from train.reporting.report import Table, number
from train.reporting.rows import Row, RowFile
from train.threaded_ppo import ThreadedPpo
from warehouse_env.checked import Checked

_PIECES = 7  # gradient steps of a pass, as in the shipped training
_WARM_UP = 2
_TURNS = 12
_ROUNDS = 200  # rounds of one row a worker, whose time is nearly all the way to the workers and back
_CREWS: dict[str, CrewMaker] = {"threads": Threads, "actors": Actors}


@dataclass(frozen=True)
class ScaleOut(Checked):
    """Measure a training by the recipe `bare` of threaded_ppo with its workers as Ray actors and as threads."""

    workers: tuple[int, ...] = (1, 2, 4)
    """Numbers of workers."""
    rows: tuple[int, ...] = (304, 608, 1216, 4864)
    """Robots that each worker trains with at a time."""
    most: int = 9728
    """Leave out trainings with more robots than this."""
    seconds: float = 0.3
    """Least time of a turn [s]."""
    ray: str = "local"
    """Where: see `warehouse train --ray`."""
    json: Path | None = None
    """File for the rows, as JSON lines."""

    def run(self) -> None:
        """Measure and print."""
        # else actors give way to all other work, and threads do not
        os.environ["RAY_worker_niceness"] = "0"  # noqa: SIM112, Ray's own spelling
        file, rows = RowFile(self.json), []
        with connected(self.ray, max(self.workers)):
            for row in self._rows():
                rows.append(row)
                file.add([row])
        table(rows).print()

    def _rows(self) -> Iterator[Row]:
        for rows in self.rows:
            for workers in self.workers:
                if workers * rows <= self.most:
                    yield self._measure(workers, rows)

    def _measure(self, workers: int, rows: int) -> Row:
        config = by_recipe(ThreadedPPOConfig, "bare", threads=workers, rows=workers * rows)
        config = replace(config, minibatch=config.rows * config.rollout // _PIECES)
        with ExitStack() as stack:
            trainers = {name: stack.enter_context(closing(ThreadedPpo(config, crew))) for name, crew in _CREWS.items()}
            update = max(profile(trainer, 1, _WARM_UP)["seconds"] for trainer in trainers.values())
            turns: dict[str, list[dict[str, float]]] = {name: [] for name in trainers}
            for _ in range(_TURNS):
                for name, trainer in trainers.items():
                    turns[name].append(profile(trainer, max(1, round(self.seconds / update)), 0))
            rounds = {name: _round_ms(trainer) for name, trainer in trainers.items()}
        best = {name: max(turn["steps_per_second"] for turn in own) for name, own in turns.items()}
        return {
            "workers": workers, "rows_a_worker": rows, "rows_a_gradient": config.minibatch // workers,
            "threads_steps_per_s": best["threads"], "actors_steps_per_s": best["actors"],
            "lost": 1.0 - best["actors"] / best["threads"], "round_ms": rounds["actors"] - rounds["threads"],
            "cores": os.cpu_count(),
        }  # fmt: skip


def _round_ms(trainer: ThreadedPpo) -> float:
    """Return the least time of a gradient round of one row a worker [ms]."""
    times = []
    one = (np.zeros(1, np.int64), (0.0, 1.0), 0.0)
    for _ in range(_ROUNDS):
        begun = time.perf_counter()
        trainer._descend([one] * trainer.config.threads)
        times.append(time.perf_counter() - begun)
    return 1000.0 * min(times)


def table(rows: list[Row]) -> Table:
    """Return the table of the rows."""
    header = ("workers", "rows a worker", "rows a gradient", "threads", "actors", "lost", "ms a round")
    cells = tuple(
        (
            str(row["workers"]), str(row["rows_a_worker"]), f"{row['rows_a_gradient']:,}",
            *(f"{row[name]:,.0f}" for name in ("threads_steps_per_s", "actors_steps_per_s")),
            f"{100 * row['lost']:.0f}%", number(row["round_ms"], 2),
        )
        for row in rows
    )  # fmt: skip
    return Table("Agent-steps/s of one training, its workers in threads and as actors", header, cells)


if __name__ == "__main__":
    import tyro

    tyro.cli(ScaleOut).run()
