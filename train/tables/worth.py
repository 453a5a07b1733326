"""What is worth using, in a few plain sentences computed from the rows over all planners."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from train.report import number
from train.tables.all_planners import family
from train.tables.figures import Figures
from train.tables.study import FAILS, HOLDS, IN_PART, Verdict

_NEGLIGIBLE = 0.5  # [%] mean excess over the shortest length that a driver would not notice


class Summary(NamedTuple):
    """A planner over all runs: median time [ms], mean gap [%] of the runs that found a path, turns over the fewest."""

    name: str
    family: str
    ms: float
    gap: float
    optimal: float
    turns: float
    found: float

    def text(self) -> str:
        """Return the figures behind the name."""
        return (
            f"`{self.name}` ({number(self.ms, 2)} ms, {number(self.gap, 2)}% over the shortest, "
            f"{number(self.turns, 3)} times the fewest turns)"
        )


def summaries(figures: Figures) -> list[Summary]:
    """Return each planner's figures over all settings of the study, the quickest first."""
    found = []
    for system in figures.study.systems:
        rows = [r for setting in figures.settings for task in figures.tasks(setting, system.label) for r in task]
        good = [row for row in rows if row["success"]]
        if not rows:
            continue
        gap = 100 * float(np.mean([row["gap"] or 0.0 for row in good])) if good else float("nan")
        turned, fewest = sum(row["turns"] for row in good), sum(row["min_turns"] for row in good)
        found.append(
            Summary(
                name=system.label,
                family=family(system.planner),
                ms=float(np.median([row["ms"] for row in rows])),
                gap=gap,
                optimal=float(np.mean([bool(row["success"]) and row["gap"] < 1e-9 for row in rows])),
                turns=turned / fewest if fewest else float("nan"),
                found=len(good) / len(rows),
            )
        )
    return sorted(found, key=lambda one: one.ms)


def worth_using(figures: Figures) -> str:
    """Return the paragraph: the quickest exact search, the fewest turns, the best colony, what is beaten and fails."""
    every = summaries(figures)
    sure = [one for one in every if one.found == 1.0]
    exact = [one for one in sure if one.optimal == 1.0]
    lines = []
    if exact:
        lines.append(f"For a shortest path take {exact[0].text()}: nothing that always finds one is as quick.")
    near = [one for one in sure if one.gap <= _NEGLIGIBLE]
    if near:
        fewest = min(near, key=lambda one: (round(one.turns, 2), one.ms))
        lines.append(f"For few turns on a path as short take {fewest.text()}.")
    colonies = [one for one in every if one.family == "ant colony"]
    kept = [one for one in colonies if one.found == 1.0]
    if kept:
        best = min(kept, key=lambda one: (round(one.gap, 3), one.ms))
        slower = f", and takes {number(best.ms / exact[0].ms, 2)} times the time of `{exact[0].name}`" if exact else ""
        lines.append(f"Of the ant colonies the best is {best.text()}{slower}.")
        beaten = [one for one in kept if any(o.ms < one.ms and o.gap < one.gap - 1e-9 for o in kept)]
        if beaten:
            names = _names(beaten)
            lines.append(f"Another colony is both quicker and shorter than {names}: they are here to compare with.")
    lost = [one for one in every if one.found < 1.0]
    if lost:
        shares = ", ".join(f"`{one.name}` ({number(100 * (1 - one.found), 2)}%)" for one in lost)
        lines.append(f"Not to be relied on, since some of their runs find no path at all: {shares}.")
    return " ".join(lines)


def _names(items: Sequence[Summary]) -> str:
    names = [f"`{one.name}`" for one in items]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def verdict_counts(verdicts: Sequence[Verdict]) -> str:
    """Return how many claims hold, hold in part and do not, in a sentence."""
    counts = Counter(verdict.word for verdict in verdicts)
    told = [counts[word] for word in (HOLDS, IN_PART, FAILS)]
    rest = len(verdicts) - sum(told)
    more = f"; {rest} cannot be told" if rest else ""
    return f"Of {len(verdicts)} claims {told[0]} hold, {told[1]} hold in part and {told[2]} do not hold{more}."
