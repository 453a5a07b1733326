"""What is worth using, in a few plain sentences computed from the rows over all planners."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from train.reporting.report import number
from train.tables.all_planners import family
from train.tables.figures import Figures
from train.tables.study import FAILS, HOLDS, IN_PART, OPEN, Study, Verdict

_LEAST = 1e-9  # difference of gaps or turns that counts as one
_NEGLIGIBLE = 0.5  # [%] mean excess over the shortest length that a driver would not notice; also of turns


class Summary(NamedTuple):
    """A planner over all runs: median time [ms], mean gap [%] and turns over the fewest, these of runs with a path.

    optimal, found: shares of all runs; line: what is to be driven over the shortest path of cells.
    """

    name: str
    family: str
    ms: float
    gap: float
    optimal: float
    turns: float
    found: float
    line: float

    def text(self) -> str:
        """Return the figures behind the name."""
        return (
            f"`{self.name}` ({number(self.ms, 2)} ms, {number(self.gap, 2)}% over the shortest, "
            f"{number(self.turns, 3)} times the fewest turns)"
        )


def summaries(study: Study, figures: Figures) -> list[Summary]:
    """Return each planner's figures over all settings of the study, the quickest first."""
    found = []
    for system in study.systems:
        rows = [r for setting in figures.settings for task in figures.tasks(setting, system.label) for r in task]
        good = [row for row in rows if row["success"]]
        if not rows:
            continue
        gap = 100 * float(np.mean([row["gap"] or 0.0 for row in good])) if good else float("nan")
        turned, fewest = sum(row["turns"] for row in good), sum(row["min_turns"] for row in good)
        driven, shortest = (sum(row[name] for row in good) for name in ("line_length", "optimal_length"))
        found.append(
            Summary(
                name=system.label,
                family=family(system.planner),
                ms=float(np.median([row["cpu_ms"] for row in rows])),
                gap=gap,
                optimal=float(np.mean([bool(row["success"]) and row["gap"] < 1e-9 for row in rows])),
                turns=turned / fewest if fewest else float("nan"),
                found=len(good) / len(rows),
                line=driven / shortest if shortest else float("nan"),
            )
        )
    return sorted(found, key=lambda one: one.ms)


def worth_using(study: Study, figures: Figures) -> str:
    """Return the paragraph: what to take for the shortest path, for few turns, at any angle; the colonies; failures."""
    every = summaries(study, figures)
    sure = [one for one in every if one.found == 1.0]
    return " ".join([*_searches(sure), *_colonies(sure), *_failures(every)])


def _searches(sure: Sequence[Summary]) -> list[str]:
    lines = []
    exact = [one for one in sure if one.optimal == 1.0]
    if exact:
        lines.append(f"For a shortest path take {exact[0].text()}: nothing that always finds one is as quick.")
    near = [one for one in sure if one.gap <= _NEGLIGIBLE]
    if near:
        fewest = min(near, key=lambda one: (round(one.turns, 2), one.ms))
        lines.append(f"For few turns on a path as short take {fewest.text()}.")
    lines += [
        f"`{one.name}` ({number(one.ms, 2)} ms) leaves the grid: its lines are {number(100 * (1 - one.line), 2)}% "
        "shorter than the shortest path of cells, and pass close to the shelves' corners."
        for one in sure
        if one.family == "any-angle search" and one.line < 1
    ]
    return lines


def _colonies(sure: Sequence[Summary]) -> list[str]:
    colonies = [one for one in sure if one.family == "ant colony"]
    if not colonies:
        return []
    best = min(colonies, key=lambda one: (round(one.gap, 3), one.ms))
    lines = [f"Of the ant colonies the best is {best.text()}."]
    for one in sure:
        if one.name == "astar_turns":
            least = best.gap - one.gap > -_LEAST and best.turns - one.turns > -_NEGLIGIBLE / 100
            adds = "adds nothing to it here" if least else "has fewer turns"
            lines.append(f"It takes {number(best.ms / one.ms, 2)} times the time of `{one.name}` and {adds}.")
    beaten = [one for one in colonies if any(o.ms < one.ms and o.gap < one.gap - _LEAST for o in colonies)]
    if beaten:
        lines.append(f"{_names(beaten)}: another colony is both quicker and shorter; they are here to compare with.")
    return lines


def _failures(every: Sequence[Summary]) -> list[str]:
    lost = [one for one in every if one.found < 1.0]
    shares = ", ".join(f"`{one.name}` ({number(100 * (1 - one.found), 2)}%)" for one in lost)
    return [f"Not to be relied on, since some of their runs find no path at all: {shares}."] if lost else []


def _names(items: Sequence[Summary]) -> str:
    names = [f"`{one.name}`" for one in items]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def verdict_counts(verdicts: Sequence[Verdict]) -> str:
    """Return how many claims hold, hold in part and do not, in a sentence; those that rest on the clock are apart."""
    counts = Counter(verdict.word for verdict in verdicts if not verdict.by_clock)
    told = [counts[word] for word in (HOLDS, IN_PART, FAILS)]
    counted = counts.total()
    more = f"; {counts[OPEN]} cannot be told" if counts[OPEN] else ""
    apart = len(verdicts) - counted
    clock = f" Judged apart by this machine's clock, not counted: {apart}." if apart else ""
    return f"Of {counted} claims {told[0]} hold, {told[1]} hold in part and {told[2]} do not hold{more}.{clock}"
