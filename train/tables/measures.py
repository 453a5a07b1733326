"""What a table can say about the runs of one planner on one task: names, headings, and how to read them from rows.

A measure turns the rows of one task into independent samples. One sample a run where each run has its own value
(length, turns, milliseconds); one sample in all where the runs have it together (best, worst, standard deviation).
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

from train.reporting.plan_report import is_optimal
from train.reporting.rows import Row

Samples = Callable[[Sequence[Row]], list[float]]
_TEN = 10  # runs of which paper 000 gives the best


class Measure(NamedTuple):
    """A figure of a table.

    samples: from the rows of one task to its samples; runs without a path give none, except to the shares.
    better: which direction is good; "neither" for what only describes (a standard deviation, the optimum).
    factor: what the samples are multiplied by to be shown, 100 where they are shares.
    single: True where a task gives one sample, so that one map alone has no interval.
    clock: True for times: their figures, and the verdicts on them, differ from machine to machine.
    """

    heading: str
    samples: Samples
    better: Literal["less", "more", "neither"] = "less"
    factor: float = 1.0
    digits: int = 4
    single: bool = False
    clock: bool = False


def _each(field: str) -> Samples:
    """One sample a run that has the field; a run without a path has None there."""
    return lambda rows: [float(row[field]) for row in rows if row[field] is not None]


def _over(field: str, reduce: Callable[[list[float]], float]) -> Samples:
    """One sample of all runs together."""

    def samples(rows: Sequence[Row]) -> list[float]:
        values = _each(field)(rows)
        return [reduce(values)] if values else []

    return samples


def _best(rows: Sequence[Row]) -> Row | None:
    """Return the row of the shortest path, that of the fewest turns where several are as short."""
    found = [row for row in rows if row["length"] is not None]
    return min(found, key=lambda row: (round(row["length"], 9), row["turns"]), default=None)


def _of_best(field: str) -> Samples:
    """One sample: the field of the shortest path of all runs."""

    def samples(rows: Sequence[Row]) -> list[float]:
        best = _best(rows)
        return [] if best is None or best[field] is None else [float(best[field])]

    return samples


def _of_best_in_ten(field: str) -> Samples:
    """One sample each ten consecutive runs: the field of their shortest path, as paper 000 reports it."""

    def samples(rows: Sequence[Row]) -> list[float]:
        tens = [rows[first : first + _TEN] for first in range(0, len(rows) - _TEN + 1, _TEN)] or [rows]
        return [value for ten in tens for value in _of_best(field)(ten)]

    return samples


def _deviation(values: list[float]) -> float:
    return statistics.stdev(values) if len(values) > 1 else math.nan


def _share(happened: Callable[[Row], bool]) -> Samples:
    return lambda rows: [float(happened(row)) for row in rows]


MEASURES: dict[str, Measure] = {
    "best": Measure("best length", _over("length", min), single=True),
    "best_of_10": Measure("best of 10 runs", _of_best_in_ten("length"), digits=6),
    "best_of_10_turns": Measure("its turns", _of_best_in_ten("turns"), digits=3),
    "best_of_10_converged_at": Measure("it converged at", _of_best_in_ten("converged_at"), digits=3),
    "mean": Measure("mean length", _each("length")),
    "worst": Measure("longest", _over("length", max), single=True),
    "sd": Measure("st. dev.", _over("length", _deviation), "less", digits=3, single=True),
    "gap": Measure("over the optimum [%]", _each("gap"), factor=100.0, digits=3),
    "optimal_share": Measure("optimal [%]", _share(is_optimal), "more", 100.0, 3),
    "found_share": Measure("found [%]", _share(lambda row: bool(row["success"])), "more", 100.0, 3),
    "turns": Measure("turns", _each("turns"), digits=3),
    "best_turns": Measure("turns of the best", _of_best("turns"), digits=3, single=True),
    "turn_angle": Measure("turned [degrees]", _each("turn_angle"), digits=4),
    "converged_at": Measure("converged at", _each("converged_at"), digits=3),
    "best_converged_at": Measure("best converged at", _of_best("converged_at"), digits=3, single=True),
    "converged_first": Measure("earliest", _over("converged_at", min), digits=3, single=True),
    "converged_last": Measure("latest", _over("converged_at", max), digits=3, single=True),
    "converged_sd": Measure("st. dev. of it", _over("converged_at", _deviation), digits=3, single=True),
    "iterations": Measure("iterations", _each("iterations"), digits=3),
    "ms": Measure("median ms", _over("cpu_ms", statistics.median), digits=3, single=True, clock=True),
    "line_length": Measure("smoothed length", _each("line_length")),
    "best_line_length": Measure("best smoothed length", _over("line_length", min), single=True),
    "worst_line_length": Measure("longest smoothed", _over("line_length", max), single=True),
    "line_sd": Measure("st. dev., smoothed", _over("line_length", _deviation), digits=3, single=True),
    "line_turns": Measure("turns, smoothed", _each("line_turns"), digits=3),
    "clearance": Measure("clearance [cells]", _each("clearance"), "more", digits=3),
    "last": Measure("last arrival [s]", _each("last")),
    "contacts": Measure("contacts", _each("contacts"), digits=3),
    "apart": Measure("least distance to it [cells]", _each("apart"), "more", digits=3),
    "climb": Measure("climb [m]", _each("climb_m"), digits=3),
    "optimum": Measure("optimum", _each("optimal_length"), "neither", digits=6),
    "min_turns": Measure("fewest turns", _each("min_turns"), "neither", digits=3),
}
