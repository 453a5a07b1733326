"""The measures of a table, and their figures with intervals.

A measure turns the rows of one task into independent samples: one a run where each run has its own value (length,
turns), or one in all where the runs have it together (best, worst, standard deviation).
"""

import math
import statistics
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np

from train.evaluation.planning_runs import is_optimal
from train.reporting.report import grouped
from train.reporting.rows import Interval, Row, mean_interval, t_quantile, wilson_interval

Samples = Callable[[Sequence[Row]], list[float]]
_TEN = 10  # runs of which paper 000 prints the best
_RESAMPLES = 400  # of the runs of one map, where a figure needs them all together (a best, a standard deviation)
ROUNDING = 1e-9  # relative difference that counts as none
PRINT_ROUNDING = 1e-5  # relative: the papers print four decimals


class TableMeasure(NamedTuple):
    """A figure of a table.

    samples: from the rows of one task to its samples; runs without a path give none, except to shares.
    better: the good direction; "neither" for what only describes. factor: of the shown figure, 100 for shares.
    single: a task gives one sample, so one map alone has no interval. clock: a time, which differs between machines.
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


def _of_best_of_ten(field: str) -> Samples:
    """One sample for each ten runs, or of all if there are fewer: the field of their shortest path of fewest turns."""

    def samples(rows: Sequence[Row]) -> list[float]:
        size = _TEN if len(rows) >= _TEN else max(len(rows), 1)
        groups = (rows[first : first + size] for first in range(0, len(rows) - size + 1, size))
        found = ([row for row in group if row["length"] is not None] for group in groups)
        best = [min(group, key=lambda row: (round(row["length"], 9), row["turns"])) for group in found if group]
        return [float(row[field]) for row in best if row[field] is not None]

    return samples


def _deviation(values: list[float]) -> float:
    return statistics.stdev(values) if len(values) > 1 else math.nan


def _share(happened: Callable[[Row], bool]) -> Samples:
    return lambda rows: [float(happened(row)) for row in rows]


MEASURES: dict[str, TableMeasure] = {
    "best": TableMeasure("best length", _over("length", min), single=True),
    "best_of_10": TableMeasure("best of 10 runs", _of_best_of_ten("length"), digits=6),
    "best_of_10_turns": TableMeasure("its turns", _of_best_of_ten("turns"), digits=3),
    "best_of_10_converged_at": TableMeasure("it converged at", _of_best_of_ten("converged_at"), digits=3),
    "mean": TableMeasure("mean length", _each("length")),
    "worst": TableMeasure("longest", _over("length", max), single=True),
    "sd": TableMeasure("st. dev.", _over("length", _deviation), "less", digits=3, single=True),
    "gap": TableMeasure("over the optimum [%]", _each("gap"), factor=100.0, digits=3),
    "optimal_share": TableMeasure("optimal [%]", _share(is_optimal), "more", 100.0, 3),
    "found_share": TableMeasure("found [%]", _share(lambda row: bool(row["success"])), "more", 100.0, 3),
    "turns": TableMeasure("turns", _each("turns"), digits=3),
    "turn_angle": TableMeasure("turned [degrees]", _each("turn_angle"), digits=4),
    "converged_at": TableMeasure("converged at", _each("converged_at"), digits=3),
    "converged_first": TableMeasure("earliest", _over("converged_at", min), digits=3, single=True),
    "converged_last": TableMeasure("latest", _over("converged_at", max), digits=3, single=True),
    "converged_sd": TableMeasure("st. dev. of it", _over("converged_at", _deviation), digits=3, single=True),
    "ms": TableMeasure("median ms", _over("cpu_ms", statistics.median), digits=3, single=True, clock=True),
    "line_length": TableMeasure("smoothed length", _each("line_length")),
    "best_line_length": TableMeasure("best smoothed length", _over("line_length", min), single=True),
    "worst_line_length": TableMeasure("longest smoothed", _over("line_length", max), single=True),
    "line_sd": TableMeasure("st. dev., smoothed", _over("line_length", _deviation), digits=3, single=True),
    "clearance": TableMeasure("clearance [cells]", _each("clearance"), "more", digits=3),
    "last": TableMeasure("last arrival [s]", _each("last")),
    "contacts": TableMeasure("contacts", _each("contacts"), digits=3),
    "apart": TableMeasure("least distance to it [cells]", _each("apart"), "more", digits=3),
    "optimum": TableMeasure("optimum", _each("optimal_length"), "neither", digits=6),
    "min_turns": TableMeasure("fewest turns", _each("min_turns"), "neither", digits=3),
}


class TableFigures:
    """All figures of one study, by its name, read from rows."""

    def __init__(self, study: str, rows: Sequence[Row]) -> None:
        self.rows = [row for row in rows if row["study"] == study]
        self.settings = tuple(dict.fromkeys(str(row["setting"]) for row in self.rows))
        self._cells = {
            (setting, system): list(grouped(own, ("number",)).values())
            for (setting, system), own in grouped(self.rows, ("setting", "system")).items()
        }

    def tasks(self, setting: str, system: str) -> list[list[Row]]:
        """Return the rows of a system in a setting, one list a task; empty where it was not run."""
        return self._cells.get((setting, system), [])

    def figure(self, setting: str, system: str, measure: str) -> Interval:
        """Return mean and 95% interval of a measure, over runs on one map or over maps where there are several.

        The interval is cut to what is possible: no measure is negative, no share above 1.
        """
        sampled = [MEASURES[measure].samples(rows) for rows in self.tasks(setting, system)]
        if len(sampled) == 1 and measure.endswith("_share"):
            return wilson_interval(sum(map(bool, sampled[0])), len(sampled[0])) if sampled[0] else mean_interval([])
        found = mean_interval(sampled[0] if len(sampled) == 1 else [_mean(samples) for samples in sampled if samples])
        return found.cut(1.0 if measure.endswith("_share") else math.inf)

    def difference(self, setting: str, ours: str, other: str, measure: str) -> Interval:
        """Return ours - other with its 95% interval; NaN where one has no figure. Maps are compared in pairs."""
        first, second = self.tasks(setting, ours), self.tasks(setting, other)
        if len(first) > 1:
            samples = MEASURES[measure].samples
            return mean_interval(_mean(samples(a)) - _mean(samples(b)) for a, b in zip(first, second, strict=True))
        if not first or not second:
            return mean_interval([])
        if MEASURES[measure].single:
            return _bootstrap(first[0], second[0], measure)
        return _welch(MEASURES[measure].samples(first[0]), MEASURES[measure].samples(second[0]))

    def relative(self, setting: str, ours: str, other: str, measure: str) -> Interval:
        """Return (ours - other) / other, of shares ours - other; the interval is that of the difference, so scaled."""
        difference = self.difference(setting, ours, other, measure)
        if measure.endswith("_share"):
            return difference
        base = abs(self.figure(setting, other, measure).mean)
        mean, low, high, samples = difference
        return Interval(mean / base, low / base, high / base, samples) if base > 0 else difference


def _mean(samples: Sequence[float]) -> float:
    return float(np.mean(samples)) if samples else math.nan


def _welch(first: Sequence[float], second: Sequence[float]) -> Interval:
    """Return the difference of two means with Welch's interval; that of equal samples has no width."""
    count = min(len(first), len(second))
    if count == 0:
        return mean_interval([])
    mean = _mean(first) - _mean(second)
    if count == 1:
        # A single value, as of an exact search, is compared as it is; a single run of a random search is not.
        spread = max((float(np.ptp(sample)) for sample in (first, second)), default=0.0)
        return Interval(mean, mean, mean, 1) if spread == 0.0 else Interval(mean, math.nan, math.nan, 1)
    errors = [float(np.var(sample, ddof=1)) / len(sample) for sample in (first, second)]
    if sum(errors) <= (ROUNDING * max(abs(_mean(first)), abs(_mean(second)))) ** 2:
        return Interval(mean, mean, mean, count)
    freedom = sum(errors) ** 2 / sum(e**2 / (len(s) - 1) for e, s in zip(errors, (first, second), strict=True))
    half = t_quantile(max(1, math.floor(freedom))) * math.sqrt(sum(errors))
    return Interval(mean, mean - half, mean + half, count)


def _bootstrap(first: list[Row], second: list[Row], measure: str) -> Interval:
    """Return the difference of two figures that take all runs together, by resampling the runs; always the same."""
    samples, rng = MEASURES[measure].samples, np.random.default_rng(0)
    found = [_mean(samples(rows)) for rows in (first, second)]
    drawn = []
    for _ in range(_RESAMPLES):
        again = [[rows[k] for k in rng.integers(len(rows), size=len(rows))] for rows in (first, second)]
        drawn.append(_mean(samples(again[0])) - _mean(samples(again[1])))
    known = [value for value in drawn if math.isfinite(value)]
    low, high = np.percentile(known, (2.5, 97.5)) if known else (math.nan, math.nan)
    return Interval(found[0] - found[1], float(low), float(high), min(len(first), len(second)))
