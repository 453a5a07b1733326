"""Experiments under a progress bar, their rows written as they come; what a file holds already is not played again."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

from train.evaluation.pool import Job, play_all
from train.evaluation.rollout import Experiment, Trace, identity
from train.reporting.report import make_progress
from train.reporting.rows import Row, RowFile


def play(
    experiments: Sequence[Experiment],
    file: RowFile,
    old: Sequence[Row] = (),
    traced: bool = False,
    processes: int = 1,
    notes: RowFile | None = None,
) -> tuple[list[Row], list[Trace]]:
    """Run experiments under a progress bar, writing the rows of each as soon as it ends.

    Episodes whose rows are among `old` are not played again. notes: the file for what `Places` notes of the others.
    Returns all rows in the order of the experiments, and if `traced` the traces of the first episodes played. On Ctrl-C
    the KeyboardInterrupt says which rows are kept.
    """
    rows: dict[int, list[Row]] = {}
    traces: dict[int, Trace] = {}
    jobs = []
    for index, experiment in enumerate(experiments):
        rows[index], missing = _split(experiment, old)
        if missing is not None:
            jobs.append(Job(index, missing, traced, notes is not None))
    try:
        with make_progress() as progress:
            bar = progress.add_task("", total=sum(job.experiment.config.max_steps for job in jobs))
            moved = lambda steps, title: progress.update(bar, completed=steps, description=title)  # noqa: E731
            for played in play_all(jobs, processes, moved):
                file.add(played.rows)
                if notes is not None:
                    notes.add(played.notes)
                rows[played.number] += played.rows
                if played.trace is not None:
                    traces[played.number] = played.trace
    except KeyboardInterrupt:
        raise KeyboardInterrupt(file.kept()) from None
    return [row for index in sorted(rows) for row in rows[index]], [traces[index] for index in sorted(traces)]


def _split(experiment: Experiment, old: Iterable[Row]) -> tuple[list[Row], Experiment | None]:
    """Return the rows of an experiment that exist already, and the experiment of its missing episodes, if any."""
    same = identity(experiment).items()
    found = {row["episode"]: row for row in old if all(row.get(name) == value for name, value in same)}
    done = [found[k] for k in experiment.episodes if k in found and found[k]["seed"] == experiment.seed + k]
    missing = tuple(k for k in experiment.episodes if all(row["episode"] != k for row in done))
    return done, dataclasses.replace(experiment, episodes=missing) if missing else None
