"""From rows to the figures of a table: means, shares and differences, each with its interval."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from train.reporting.report import grouped
from train.reporting.rows import Interval, Row, mean_interval, t_quantile, wilson_interval
from train.tables.measures import MEASURES

_RESAMPLES = 400  # of the runs of one map, where a figure needs them all together (a best, a standard deviation)
ROUNDING = 1e-9  # relative difference that counts as none


class Figures:
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
        """Return ours - other with its 95% interval; NaN where one of them has no figure."""
        first, second = self.tasks(setting, ours), self.tasks(setting, other)
        if len(first) > 1:  # on each map that gave both a figure
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
        # One of a kind, as an exact search's path, is compared as it is; one run of a random search cannot be.
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
