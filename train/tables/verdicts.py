"""Judge the claims of a table by its figures."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from train.reporting.report import number
from train.reporting.rows import Interval
from train.tables.measures import MEASURES, PRINT_ROUNDING, ROUNDING, TableFigures
from train.tables.study import FAILS, HOLDS, IN_PART, OPEN, Claim, ClaimVerdict, Published

RULE = (
    "A claim is judged in each setting by the difference of the two systems' figures with its 95% interval (Welch's t "
    "over runs on one map, paired by map on several, a bootstrap of the runs for best, longest and standard deviation "
    "of one map). It **holds** if in every setting the difference has the claimed sign, its interval excludes zero and "
    "reaches the claimed size. It **holds in part** if in at least one setting the sign is right and the interval "
    "excludes zero; otherwise it **does not hold**. Lengths and turns are those of runs that found a path. Verdicts on "
    "milliseconds depend on the machine: they are marked and **not counted**, so the totals are the same everywhere."
)


class SettingVerdict(NamedTuple):
    """One setting's part of a verdict: whether the difference has the claimed sign, and the claimed size."""

    known: bool
    clear: bool
    reaches: bool
    text: str


def judge(figures: TableFigures, claim: Claim) -> ClaimVerdict:
    """Return the verdict on a claim by RULE, with the figures of each setting."""
    if claim.check is not None:
        return claim.check(figures)
    settings = claim.settings or figures.settings
    judged = [one for one in (_judge(figures, claim, setting) for setting in settings) if one is not None]
    why, by_clock = "; ".join(one.text for one in judged), MEASURES[claim.measure].clock
    if not any(one.known for one in judged):
        return ClaimVerdict(OPEN, why or "nothing was run for it", by_clock)
    if all(one.clear and one.reaches for one in judged):
        return ClaimVerdict(HOLDS, why, by_clock)
    return ClaimVerdict(IN_PART if any(one.clear for one in judged) else FAILS, why, by_clock)


def _judge(figures: TableFigures, claim: Claim, setting: str) -> SettingVerdict | None:
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
    return SettingVerdict(math.isfinite(relative.mean), clear, reaches, text)


def reaches_print(figures: TableFigures, published: Sequence[Published], ours: str) -> ClaimVerdict:
    """Judge whether our figures reach every printed one beside `ours`, except times; name those that do not."""
    worse, reached = [], []
    for printed in published:
        figure = figures.figure(printed.setting, ours, printed.measure)
        measure = MEASURES[printed.measure]
        if printed.ours != ours or measure.clock or measure.better == "neither" or not math.isfinite(figure.mean):
            continue
        sign = -1.0 if measure.better == "more" else 1.0
        reached.append(sign * (figure.mean - printed.value) <= PRINT_ROUNDING * abs(printed.value))
        if not reached[-1]:
            shown = [number(measure.factor * value, measure.digits) for value in (figure.mean, printed.value)]
            worse.append(f"{printed.setting}, {measure.heading}: {shown[0]} against {shown[1]} in print")
    why = f"{sum(reached)} of {len(reached)} figures reached" + ("; not: " + "; ".join(worse) if worse else "")
    return ClaimVerdict.graded(reached, why)


def percent(relative: Interval, unit: str = "%") -> str:
    """Format a relative difference with its interval: "-11.6% [-12.3, -10.9]"."""
    if not math.isfinite(relative.mean):
        return "no figure"
    mean = f"{100 * relative.mean:+.1f}{unit}"
    if not math.isfinite(relative.low) or relative.high - relative.low < 1e-6:
        return mean
    return f"{mean} [{100 * relative.low:+.1f}, {100 * relative.high:+.1f}]"


def verdict_counts(verdicts: Sequence[ClaimVerdict]) -> str:
    """Say how many claims hold, hold in part and do not; those that depend on the clock are counted apart."""
    counts = Counter(verdict.word for verdict in verdicts if not verdict.by_clock)
    whole, part, none = (counts[word] for word in (HOLDS, IN_PART, FAILS))
    more = f"; {counts[OPEN]} cannot be told" if counts[OPEN] else ""
    apart = len(verdicts) - counts.total()
    clock = f" Judged apart by this machine's clock, not counted: {apart}." if apart else ""
    return f"Of {counts.total()} claims {whole} hold, {part} hold in part and {none} do not hold{more}.{clock}"
