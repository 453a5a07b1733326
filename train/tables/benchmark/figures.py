"""From the benchmark's rows to figures: one summary for each map and planner, and their tables."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.evaluation.planning_runs import is_optimal
from train.reporting.report import Table, grouped, number, with_interval
from train.reporting.rows import Interval, Row, mean_interval
from train.tables.benchmark.peers import PEERS
from train.tables.benchmark.runs import MOMENTS

_SHOWN_MOMENTS = (0.1, 1.0, 5.0, 20.0, 100.0, 500.0, 2000.0)  # [ms]
_QUANTILES = (0.5, 0.95, 0.99, 1.0)


class Summary(NamedTuple):
    """A planner on a map; gaps, turns and clearance of the runs with a path, each weighed by what it stands for."""

    map: str
    planner: str
    pairs: int
    runs: int
    failed: float  # share of all runs
    gap: Interval  # mean excess over the shortest length, its 95% interval over pairs
    quantiles: tuple[float, ...]  # of the gap: median, 95th, 99th percentile, largest
    optimal: float  # share of all runs
    turns: float  # per turn of T*, all paths together; NaN where T* is not theirs (a peer that cuts corners)
    clearance: float  # [cells] least of all paths
    mean_clearance: float  # [cells] mean over paths of the mean over cells
    ms: float  # median
    ms95: float  # 95th percentile
    line_gap: float  # mean excess of the any-angle line; NaN without one
    anytime: NDArray[np.float64]  # mean gap at each of MOMENTS of the runs that have a path by then, NaN if none
    arrived: NDArray[np.float64]  # share of the runs that have a path by then


def summarise(rows: Sequence[Row]) -> list[Summary]:
    """Return a summary for each map and planner, in the order of the rows."""
    return [
        _summary(str(name), str(planner), own) for (name, planner), own in grouped(rows, ("map", "planner")).items()
    ]


def _summary(name: str, planner: str, rows: Sequence[Row]) -> Summary:
    weight = np.array([row["stands_for"] for row in rows])
    found = [row for row in rows if row["success"]]
    found_weight = np.array([row["stands_for"] for row in found], dtype=np.int64)
    gaps = _repeated([row["gap"] for row in found], found_weight)
    fewest = sum(row["min_turns"] * row["stands_for"] for row in found if row["min_turns"] is not None)
    turned = sum(row["turns"] * row["stands_for"] for row in found)
    means = [statistics.fmean(row["gap"] for row in pair) for pair in grouped(found, ("pair",)).values()]
    curves = np.array([[math.nan if gap is None else gap for gap in row["anytime"]] for row in rows])
    known = np.isfinite(curves) * weight[:, None]
    with np.errstate(invalid="ignore"):
        anytime = np.where(np.isfinite(curves), curves, 0.0) * weight[:, None]
        anytime = anytime.sum(axis=0) / known.sum(axis=0)
    ms = _repeated([row["ms"] for row in rows], weight)
    lines = [row["line_gap"] for row in found if row["line_gap"] is not None]
    return Summary(
        map=name, planner=planner, pairs=len({row["pair"] for row in rows}), runs=int(weight.sum()),
        failed=1.0 - found_weight.sum() / weight.sum(), gap=mean_interval(means).cut()._replace(mean=_mean(gaps)),
        quantiles=tuple(np.quantile(gaps, _QUANTILES).tolist()) if len(gaps) else (math.nan,) * len(_QUANTILES),
        optimal=sum(row["stands_for"] for row in found if is_optimal(row)) / int(weight.sum()),
        turns=turned / fewest if fewest else math.nan,
        clearance=min((row["clearance"] for row in found), default=math.nan),
        mean_clearance=_mean(_repeated([row["mean_clearance"] for row in found], found_weight)),
        ms=float(np.median(ms)), ms95=float(np.quantile(ms, 0.95)),
        line_gap=statistics.fmean(lines) if lines else math.nan, anytime=anytime,
        arrived=known.sum(axis=0) / weight.sum(),
    )  # fmt: skip


def _repeated(values: Sequence[float], times: NDArray[np.int64]) -> NDArray[np.float64]:
    return np.repeat(np.array(values, dtype=np.float64), times)


def _mean(values: NDArray[np.float64]) -> float:
    return float(values.mean()) if len(values) else math.nan


_HEADER = (
    "planner", "pairs", "runs", "failed", "gap % [95%]", "95th %", "99th %", "worst %", "optimal", "turns / T*",
    "least clearance", "mean clearance", "line %", "median ms", "95th ms",
)  # fmt: skip
NOTE = (
    "Gap: length over the shortest path by legal moves, minus 1, of the runs that found a path; mean with its 95% "
    "interval over pairs (Student's t), percentiles over runs. Optimal and failed: shares of all runs. T*: the fewest "
    "turns of a shortest path; all turns over all T*. Clearance: from cells' centres to the nearest shelf or the map's "
    "edge, in cells. Line: the same gap of the any-angle or smoothed line, where the planner makes one. Times are "
    "processor times of one core. A planner that draws no random number runs once a pair, which counts for all runs."
)


def table_of(name: str, summaries: Sequence[Summary]) -> Table:
    """Return the table of one map, the planners in the order of their mean gap, failures last."""
    own = sorted((one for one in summaries if one.map == name), key=rank)
    cells = tuple(
        (
            one.planner + (" (cuts corners)" if one.planner in PEERS and PEERS[one.planner].cuts_corners else ""),
            str(one.pairs), str(one.runs), _share(one.failed), with_interval(one.gap, 100.0),
            *(_percent(quantile) for quantile in one.quantiles[1:]), _share(one.optimal), number(one.turns),
            number(one.clearance, 2), number(one.mean_clearance), _percent(one.line_gap), number(one.ms),
            number(one.ms95),
        )
        for one in own
    )  # fmt: skip
    return Table(f"Benchmark on {name}", _HEADER, cells)


def _by_planner(summaries: Sequence[Summary]) -> dict[str, list[Summary]]:
    names = dict.fromkeys(one.planner for one in summaries)
    return {name: [one for one in summaries if one.planner == name] for name in names}


def overview(summaries: Sequence[Summary]) -> Table:
    """Return one line a planner over all maps: its worst map in each figure, the surest and shortest first."""
    lines = []
    for planner, own in _by_planner(summaries).items():
        gaps = [one.gap.mean for one in own if math.isfinite(one.gap.mean)]
        turns = [one.turns for one in own if math.isfinite(one.turns)]
        failed, gap = max(one.failed for one in own), max(gaps, default=math.nan)
        texts = (
            planner, _share(failed), _percent(gap), _share(min(one.optimal for one in own)),
            number(max(turns, default=math.nan)), *(number(pick(one.ms for one in own)) for pick in (min, max)),
        )  # fmt: skip
        lines.append(((failed > 0, gap if gaps else math.inf, max(one.ms for one in own)), texts))
    header = ("planner", "failed", "gap %", "optimal", "turns / T*", "least ms", "most ms")
    title = "All planners, each figure that of its worst map"
    notes = ["Times: the medians of the quickest and of the slowest map."]
    notes += [f"{name}: {PEERS[name].note}." for name in _by_planner(summaries) if name in PEERS]
    return Table(title, header, tuple(texts for _, texts in sorted(lines)), "\n".join(notes))


def rank(one: Summary) -> tuple[bool, float, float]:
    """Return what summaries of one map are sorted by: failures last, then the mean gap, then the time."""
    return one.failed > 0, one.gap.mean if math.isfinite(one.gap.mean) else math.inf, one.ms


def anytime_table(name: str, summaries: Sequence[Summary]) -> Table:
    """Return the mean gap after some milliseconds, with the share of runs that have a path by then where not all do."""
    places = [MOMENTS.index(moment) for moment in _SHOWN_MOMENTS]
    cells = []
    for one in sorted((one for one in summaries if one.map == name), key=rank):
        shown = [(float(one.anytime[k]), float(one.arrived[k])) for k in places]
        texts = [
            _percent(gap) + ("" if share in (0.0, 1.0) else f" ({_share(share)} have one)") for gap, share in shown
        ]
        cells.append((one.planner, *texts))
    header = ("planner", *(f"after {number(moment, 1)} ms" for moment in _SHOWN_MOMENTS))
    return Table(f"Gap % of the best path so far on {name}", header, tuple(cells))


def _percent(value: float) -> str:
    return number(round(100 * value, 6)) if math.isfinite(value) else "-"


def _share(value: float) -> str:
    """In per cent; 100 and 0 only where it is all or none."""
    text = number(100 * value)
    if value < 1.0 and text == "100":
        text = f"{100 * value:.3f}"
    return f"{text}%"


def csv(summaries: Sequence[Summary]) -> str:
    """Return every figure of every summary, one line each; shares and gaps as they are, not in per cent."""
    moments = [f"{what}_{moment:g}ms" for what in ("gap", "arrived") for moment in MOMENTS]
    lines = [
        "map,planner,pairs,runs,failed,gap,gap_low,gap_high,gap_50,gap_95,gap_99,gap_worst,optimal,turns_over_fewest,"
        "clearance,mean_clearance,ms,ms_95,line_gap," + ",".join(moments)
    ]
    for one in summaries:
        values: list[float] = [one.pairs, one.runs, one.failed, *one.gap[:3], *one.quantiles, one.optimal, one.turns]
        values += [one.clearance, one.mean_clearance, one.ms, one.ms95, one.line_gap, *one.anytime, *one.arrived]
        texts = [f"{value:.9g}" if math.isfinite(value) else "" for value in values]
        names = (f'"{name}"' if "," in name else name for name in (one.map, one.planner))
        lines.append(",".join([*names, *texts]))
    return "\n".join(lines) + "\n"
