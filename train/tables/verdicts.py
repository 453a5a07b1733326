"""Judge the claims of a table by its figures."""

import math
from collections import Counter
from collections.abc import Callable, Sequence

from train.reporting.report import number
from train.reporting.rows import Interval
from train.tables.measures import MEASURES, PRINT_ROUNDING, ROUNDING, TableFigures
from train.tables.study import FAILS, HOLDS, IN_PART, OPEN, Claim, ClaimVerdict, PrintedLine

RULE = (
    "A claim is judged in each setting by the difference of the two systems' figures with its 95% interval (Welch's t "
    "over runs on one map, paired by map on several, a bootstrap of the runs for best, longest and standard deviation "
    "of one map). It **holds** if in every setting the difference has the claimed sign, its interval excludes zero and "
    "reaches the claimed size. It **holds in part** if in at least one setting the sign is right and the interval "
    "excludes zero; otherwise it **does not hold**. Lengths and turns are those of runs that found a path. Verdicts on "
    "milliseconds depend on the machine: they are marked and **not counted**, so the totals are the same everywhere."
)


def judge(figures: TableFigures, claim: Claim, printed: Sequence[PrintedLine] = ()) -> ClaimVerdict:
    """Return the verdict on a claim by RULE or its own check, with the figures of each setting."""
    if claim.why_open:
        return ClaimVerdict(OPEN, claim.why_open)
    if claim.check:
        return CHECKS[claim.check](figures, claim, printed)
    both = claim.ours, claim.other
    run = [one for one in claim.settings or figures.settings if all(figures.tasks(one, label) for label in both)]
    judged, by_clock = [_judge(figures, claim, setting) for setting in run], MEASURES[claim.measure].clock
    words, why = {one.word for one in judged}, "; ".join(one.why for one in judged)
    if words <= {OPEN}:
        return ClaimVerdict(OPEN, why or "nothing was run for it", by_clock)
    if words == {HOLDS}:
        return ClaimVerdict(HOLDS, why, by_clock)
    return ClaimVerdict(IN_PART if words & {HOLDS, IN_PART} else FAILS, why, by_clock)


def _judge(figures: TableFigures, claim: Claim, setting: str) -> ClaimVerdict:
    """Return the verdict in one setting: whether the difference has the claimed sign, and the claimed size."""
    relative = figures.relative(setting, claim.ours, claim.other, claim.measure)
    less = MEASURES[claim.measure].better != "more" if claim.by is None else claim.by < 0
    sign = -1.0 if less else 1.0
    best, worst = (relative.low, relative.high) if less else (relative.high, relative.low)
    clear = math.isfinite(worst) and sign * worst > 0 and sign * relative.mean > ROUNDING
    reaches = claim.by is None or (math.isfinite(best) and sign * best >= sign * claim.by - ROUNDING)
    measure, shown = MEASURES[claim.measure], []
    for label in (claim.ours, claim.other):
        mean, share = (figures.figure(setting, label, name).mean for name in (claim.measure, "found_share"))
        found = "" if share == 1 else f" (found {number(100 * share)}%)"
        shown.append(f"{number(measure.factor * mean, measure.digits)}{found}")
    unit = " points" if claim.measure.endswith("_share") else "%"
    text = f"{setting}: {shown[0]} against {shown[1]}, {percent(relative, unit)}"
    if not math.isfinite(relative.mean):
        return ClaimVerdict(OPEN, text)
    return ClaimVerdict(FAILS if not clear else HOLDS if reaches else IN_PART, text)


def reaches_print(figures: TableFigures, claim: Claim, printed: Sequence[PrintedLine]) -> ClaimVerdict:
    """Judge whether our figures reach every printed one beside `ours`, except times; name those that do not."""
    worse, reached = [], []
    beside = [line for line in printed if line.ours == claim.ours]
    for setting, name, value in ((line.setting, *figure) for line in beside for figure in line.figures.items()):
        mean, measure = figures.figure(setting, claim.ours, name).mean, MEASURES[name]
        if measure.clock or measure.better == "neither" or not math.isfinite(mean):
            continue
        sign = -1.0 if measure.better == "more" else 1.0
        reached.append(sign * (mean - value) <= PRINT_ROUNDING * abs(value))
        if not reached[-1]:
            shown = [number(measure.factor * one, measure.digits) for one in (mean, value)]
            worse.append(f"{setting}, {measure.heading}: {shown[0]} against {shown[1]} in print")
    why = f"{sum(reached)} of {len(reached)} figures reached" + ("; not: " + "; ".join(worse) if worse else "")
    return ClaimVerdict.graded(reached, why)


def below_print(figures: TableFigures, claim: Claim, _: Sequence[PrintedLine]) -> ClaimVerdict:
    """Judge whether our figure is below `printed`, of another paper, by the claimed relative size."""
    (setting,), by = claim.settings, claim.by or 0.0
    figure = figures.figure(setting, claim.ours, claim.measure)
    if not math.isfinite(figure.mean):
        return ClaimVerdict(OPEN, "nothing was run for it")
    low, high = (value if math.isfinite(value) else figure.mean for value in (figure.low, figure.high))
    shown = f"{number(figure.mean, 4)} against {number(claim.printed, 4)} in print"
    below = high < claim.printed
    why = f"{setting}, {MEASURES[claim.measure].heading}: {shown}"
    return ClaimVerdict.graded([below, below and low / claim.printed - 1 <= by], why)


def costs_at_most(figures: TableFigures, claim: Claim, _: Sequence[PrintedLine]) -> ClaimVerdict:
    """Judge "ours costs at most `by` over other" by the upper ends of the intervals."""
    most = (claim.by or 0.0) + PRINT_ROUNDING + ROUNDING
    every = {name: figures.relative(name, claim.ours, claim.other, claim.measure) for name in claim.settings}
    costs = {name: cost for name, cost in every.items() if math.isfinite(cost.mean)}  # where both have a figure
    why = "; ".join(f"{name}: {percent(cost)}" for name, cost in costs.items())
    return ClaimVerdict.graded([cost.mean <= most and not cost.high > most for cost in costs.values()], why)


def resolves_all(figures: TableFigures, claim: Claim, _: Sequence[PrintedLine]) -> ClaimVerdict:
    """Judge "all robots arrive, and none touch" on every task of a setting."""
    runs = {name: [row for task in figures.tasks(name, claim.ours) for row in task] for name in claim.settings}
    good = {name: [row["success"] and not row["contacts"] for row in rows] for name, rows in runs.items() if rows}
    why = "; ".join(f"{name}: {sum(each)} of {len(each)}" for name, each in good.items())
    return ClaimVerdict.graded([all(each) for each in good.values()], why)


def always_optimal(figures: TableFigures, claim: Claim, _: Sequence[PrintedLine]) -> ClaimVerdict:
    """Judge whether every run of `ours` has a shortest path."""
    shares = {name: figures.figure(name, claim.ours, "optimal_share").mean for name in claim.settings}
    if any(map(math.isnan, shares.values())):
        return ClaimVerdict(OPEN, "not all of it was run")
    shown = ", ".join(f"{name} {100 * share:.0f}%" for name, share in shares.items())
    return ClaimVerdict.graded([share == 1.0 for share in shares.values()], shown)


def finds_optimum(figures: TableFigures, claim: Claim, _: Sequence[PrintedLine]) -> ClaimVerdict:
    """Judge whether the best of the runs of `ours` is the optimum, on all maps of all settings."""
    counts = []
    for setting in figures.settings:
        runs = figures.tasks(setting, claim.ours)
        best = [min((row["gap"] for row in rows if row["success"]), default=1.0) for rows in runs]
        counts.append((setting, sum(gap < 1e-9 for gap in best), len(best)))
    why = "; ".join(f"{setting}: on {reached} of {maps} maps" for setting, reached, maps in counts)
    return ClaimVerdict.graded([reached == maps for _, reached, maps in counts if maps], why)


CHECKS: dict[str, Callable[[TableFigures, Claim, Sequence[PrintedLine]], ClaimVerdict]] = {
    check.__name__: check
    for check in (reaches_print, below_print, costs_at_most, resolves_all, always_optimal, finds_optimum)
}
"""Rules for claims of another form, from the figures, the claim and what the paper prints; none reads times."""


def percent(relative: Interval, unit: str = "%") -> str:
    """Format a relative difference with its interval: "-11.6% [-12.3, -10.9]"."""
    if not math.isfinite(relative.mean):
        return "no figure"
    mean = f"{100 * relative.mean:+.1f}{unit}"
    if not math.isfinite(relative.low) or relative.high - relative.low < 1e-6:
        return mean
    return f"{mean} [{100 * relative.low:+.1f}, {100 * relative.high:+.1f}]"


def verdict_counts(verdicts: Sequence[ClaimVerdict]) -> str:
    """Return how many claims hold, hold in part and do not, as a sentence; claims by the clock stand apart."""
    counts = Counter(verdict.word for verdict in verdicts if not verdict.by_clock)
    whole, part, none = (counts[word] for word in (HOLDS, IN_PART, FAILS))
    more = f"; {counts[OPEN]} undecided" if counts[OPEN] else ""
    apart = len(verdicts) - counts.total()
    clock = f" Judged apart by this machine's clock, not counted: {apart}." if apart else ""
    return f"Of {counts.total()} claims {whole} hold, {part} hold in part and {none} do not hold{more}.{clock}"
