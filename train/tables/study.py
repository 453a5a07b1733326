"""A table of a paper as data: the maps, the systems that are compared, the printed figures and the claims.

A paper's module lists its `STUDIES`; everything else (running, resuming, tables, verdicts, pictures) is the same for
all. Lengths are in cells, times in milliseconds, shares from 0 to 1.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from train.reporting.report import number
from train.reporting.rows import Interval, Row
from train.tables.measures import MEASURES, ROUNDING, Figures
from warehouse_env.errors import ConfigError, unknown_name
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning import Planner, make_planner

Word = Literal["holds", "holds in part", "does not hold", "cannot be told"]
HOLDS: Final = "holds"
IN_PART: Final = "holds in part"
FAILS: Final = "does not hold"
OPEN: Final = "cannot be told"


class TableTask(NamedTuple):
    """A map with a start and a goal on it; others: start and goal of whatever else moves in a study's experiment."""

    grid: GridMap
    start: Cell
    goal: Cell
    others: tuple[tuple[Cell, Cell], ...] = ()


@dataclass(frozen=True)
class Setting:
    """A group of lines of the paper's table: one map, or several random ones of one kind.

    With one task a sample is a run; with several a sample is the mean of a map's runs, so intervals are over maps.
    """

    name: str
    tasks: tuple[TableTask, ...]


@dataclass(frozen=True)
class System:
    """A planner with its parameters, as one line of the table; `label` is unique in a study, e.g. "pf_aco (paper)".

    mode: what a study's experiment does with the planned paths, one of its own names; "" where it only plans.
    """

    label: str
    planner: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    mode: str = ""

    def make(self) -> Planner:
        """Build the planner; ConfigError for a wrong name or parameter."""
        return make_planner(self.planner, **self.parameters)


Experiment = Callable[[TableTask, System, np.random.Generator], Row]
"""What is run in place of a single plan -> the figures of a row: those of `plan_once` that the study's table shows."""


class Published(NamedTuple):
    """A figure that the paper prints.

    system: what the paper calls it; ours: the label of our system that it belongs beside, "" for a line of its own.
    value: in the unit of the measure: cells, milliseconds, shares from 0 to 1.
    """

    setting: str
    system: str
    measure: str
    value: float
    ours: str = ""


def published(
    measures: Sequence[str], lines: Iterable[tuple[str, str, str, Sequence[float | None]]]
) -> tuple[Published, ...]:
    """Return the figures of printed lines (setting, system, ours, values), a value a measure, None where none is."""
    return tuple(
        Published(setting, system, measure, value, ours)
        for setting, system, ours, values in lines
        for measure, value in zip(measures, values, strict=True)
        if value is not None
    )


class Verdict(NamedTuple):
    """What became of a claim, and the figures behind it.

    by_clock: it rests on times, so another machine may judge otherwise; such verdicts are shown, but not counted.
    """

    word: Word
    why: str
    by_clock: bool = False

    @classmethod
    def graded(cls, holds: Sequence[bool], why: str) -> Verdict:
        """Return the verdict on a claim that holds in some places: in all, in part, nowhere; open if there are none."""
        if not holds:
            return cls(OPEN, "nothing was run for it")
        return cls(HOLDS if all(holds) else IN_PART if any(holds) else FAILS, why)

    @property
    def shown(self) -> str:
        """The word as it stands on a page, in Markdown."""
        return f"**{self.word}**" + (", by this machine's clock" if self.by_clock else "")


@dataclass(frozen=True)
class Claim:
    """`ours` has a better `measure` than `other`, by `by` where a size is given.

    by: relative to `other` (-0.14: 14% less); for a share, a difference of shares (0.5: 50 points more).
    settings: names of the settings that it is claimed for; all if empty. `check` replaces the general rule where a
    claim has another form, and reads no times; `measure`, `ours` and `other` are then unused.
    """

    text: str
    ours: str = ""
    other: str = ""
    measure: str = ""
    by: float | None = None
    settings: tuple[str, ...] = ()
    check: Callable[[Figures], Verdict] | None = None


@dataclass(frozen=True)
class Study:
    """One table of one paper: what is run for it, what the paper prints, what it claims.

    settings: a function, so that maps are built only where they are needed; it must give the same maps every time.
    runs: of each system on each task; measures: names of MEASURES, the columns.
    pictured: settings of which pictures are drawn; all if empty.
    experiment: a function of a module, run for every row; a single plan if None.
    note: what is a reconstruction, and what differs from the paper; Markdown, shown under the table.
    """

    name: str
    paper: str
    title: str
    settings: Callable[[], tuple[Setting, ...]]
    systems: tuple[System, ...]
    runs: int
    measures: tuple[str, ...]
    published: tuple[Published, ...] = ()
    claims: tuple[Claim, ...] = ()
    note: str = ""
    pictured: tuple[str, ...] = ()
    experiment: Experiment | None = None

    def __post_init__(self) -> None:
        """Refuse names that do not exist, so that a wrong table is noticed before it is run."""
        labels = [system.label for system in self.systems]
        if len(set(labels)) != len(labels):
            raise ConfigError(f"study {self.name}: two systems have one label; labels must differ")
        ruled = [claim for claim in self.claims if claim.check is None]
        measures = (*self.measures, *(p.measure for p in self.published), *(claim.measure for claim in ruled))
        for measure in measures:
            if measure not in MEASURES:
                raise unknown_name(f"study {self.name}: measure", measure, MEASURES)
        named = (*(p.ours for p in self.published if p.ours), *(name for c in ruled for name in (c.ours, c.other)))
        for label in named:
            if label not in labels:
                raise unknown_name(f"study {self.name}: system", label, labels)


_PRINT_ROUNDING = 1e-5  # relative: the papers print four decimals

RULE = (
    "How a claim is judged, setting by setting: the difference of the two systems' figures with its 95% interval "
    "(Welch's t over runs where there is one map, paired by map where there are several, a bootstrap of the runs for "
    "best, longest and standard deviation of one map). It **holds** if in every setting the difference has the claimed "
    "sign, its interval is clear of zero and reaches the claimed size; it **holds in part** if in at least one setting "
    "the sign is right and the interval clear of zero; otherwise it **does not hold**. Lengths and turns are those of "
    "the runs that found a path. Verdicts on milliseconds rest on the clock of the machine that ran them and may "
    "differ on another: they are marked and **not counted**, so that the totals are the same everywhere."
)


class Judged(NamedTuple):
    """One setting's part of a verdict: the relative difference, and whether it has the claimed sign and size."""

    relative: Interval
    clear: bool
    reaches: bool
    text: str


def judge(figures: Figures, claim: Claim) -> Verdict:
    """Return the verdict on a claim by RULE, with the figures of each setting behind it."""
    if claim.check is not None:
        return claim.check(figures)
    settings = claim.settings or figures.settings
    judged = [one for one in (_judge(figures, claim, setting) for setting in settings) if one is not None]
    why, by_clock = "; ".join(one.text for one in judged), MEASURES[claim.measure].clock
    if not judged or all(not math.isfinite(one.relative.mean) for one in judged):
        return Verdict(OPEN, why or "nothing was run for it", by_clock)
    if all(one.clear and one.reaches for one in judged):
        return Verdict(HOLDS, why, by_clock)
    return Verdict(IN_PART if any(one.clear for one in judged) else FAILS, why, by_clock)


def _judge(figures: Figures, claim: Claim, setting: str) -> Judged | None:
    if not figures.tasks(setting, claim.ours) or not figures.tasks(setting, claim.other):
        return None
    relative = figures.relative(setting, claim.ours, claim.other, claim.measure)
    less = MEASURES[claim.measure].better != "more" if claim.by is None else claim.by < 0
    sign = -1.0 if less else 1.0
    best, worst = (relative.low, relative.high) if less else (relative.high, relative.low)
    clear = math.isfinite(worst) and sign * worst > 0 and sign * relative.mean > ROUNDING
    reaches = claim.by is None or (math.isfinite(best) and sign * best >= sign * claim.by - ROUNDING)
    ours, other = (figures.figure(setting, label, claim.measure).mean for label in (claim.ours, claim.other))
    measure = MEASURES[claim.measure]
    shown = [number(measure.factor * value, measure.digits) for value in (ours, other)]
    found = [figures.figure(setting, label, "found_share").mean for label in (claim.ours, claim.other)]
    shown = [
        text + ("" if share == 1 else f" (found {number(100 * share)}%)")
        for text, share in zip(shown, found, strict=True)
    ]
    unit = " points" if claim.measure.endswith("_share") else "%"
    text = f"{setting}: {shown[0]} against {shown[1]}, {percent(relative, unit)}"
    return Judged(relative, clear, reaches, text)


def reaches_print(figures: Figures, published: Sequence[Published], ours: str) -> Verdict:
    """Return whether our figures are at or better than every printed one beside `ours`, but times; names the others."""
    worse, reached = [], []
    for printed in published:
        figure = figures.figure(printed.setting, ours, printed.measure)
        measure = MEASURES[printed.measure]
        if printed.ours != ours or measure.clock or measure.better == "neither" or not math.isfinite(figure.mean):
            continue
        sign = -1.0 if measure.better == "more" else 1.0
        reached.append(sign * (figure.mean - printed.value) <= _PRINT_ROUNDING * abs(printed.value))
        if not reached[-1]:
            shown = [number(measure.factor * value, measure.digits) for value in (figure.mean, printed.value)]
            worse.append(f"{printed.setting}, {measure.heading}: {shown[0]} against {shown[1]} in print")
    why = f"{sum(reached)} of {len(reached)} figures reached" + ("; not: " + "; ".join(worse) if worse else "")
    return Verdict.graded(reached, why)


def percent(relative: Interval, unit: str = "%") -> str:
    """Format a relative difference with its interval: "-11.6% [-12.3, -10.9]"."""
    if not math.isfinite(relative.mean):
        return "no figure"
    mean = f"{100 * relative.mean:+.1f}{unit}"
    if not math.isfinite(relative.low) or relative.high - relative.low < 1e-6:
        return mean
    return f"{mean} [{100 * relative.low:+.1f}, {100 * relative.high:+.1f}]"


def verdict_counts(verdicts: Sequence[Verdict]) -> str:
    """Return how many claims hold, hold in part and do not, in a sentence; those that rest on the clock are apart."""
    counts = Counter(verdict.word for verdict in verdicts if not verdict.by_clock)
    told = [counts[word] for word in (HOLDS, IN_PART, FAILS)]
    counted = counts.total()
    more = f"; {counts[OPEN]} cannot be told" if counts[OPEN] else ""
    apart = len(verdicts) - counted
    clock = f" Judged apart by this machine's clock, not counted: {apart}." if apart else ""
    return f"Of {counted} claims {told[0]} hold, {told[1]} hold in part and {told[2]} do not hold{more}.{clock}"
