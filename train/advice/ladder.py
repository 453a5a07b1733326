"""What numbers of stations and of chargers are worth, in words and as a table: each rung beside the floor as it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from train.advice.aim import Aim
from train.advice.changes import PAIRS, Effect
from train.reporting.report import Table, difference, number


class Verdict(NamedTuple):
    """How many to have, as far as it is told."""

    number: int
    text: str  # a sentence


def measured(effects: Sequence[Effect], kind: str) -> list[Effect]:
    """Return the rungs of a ladder that were driven, the fewest first."""
    return [effect for effect in effects if effect.candidate.kind == kind and effect.goals is not None]


def verdict(rungs: Sequence[Effect], kind: str, aim: Aim) -> Verdict:
    """Return how many of a kind to have: of those told to bring something the best, else no more than there are."""
    before, what = rungs[0].candidate.before, f"{aim.gained} an hour"
    told = [effect for effect in rungs if effect.told]
    better = [effect for effect in told if _gain(effect) > 0]
    if better:
        best = max(better, key=_gain)
        step = best.candidate.number - before
        each = f", {number(_gain(best) / step)} for each of the {step} more" if step > 1 else ""
        text = f"{best.candidate.number} instead of {before} bring {_figures(best)} {what}{each}"
        return Verdict(best.candidate.number, text)
    worse = [effect for effect in told if effect.candidate.number < before]
    fewer = [effect for effect in rungs if effect.candidate.number < before]
    more = [effect.candidate.number for effect in rungs if effect.candidate.number > before]
    over = f"up to {max(more)} are not told to bring anything" if more else "more were not tried"
    if not worse:
        spare = f"nor are {fewer[0].candidate.number} told to cost anything" if fewer else "fewer were not tried"
        return Verdict(before, f"no other number is told apart from the {before} that there are: {over}, {spare}")
    dearest = worse[-1]
    text = f"the {before} that there are are worth having against {dearest.candidate.number}, and {over}"
    return Verdict(before, text)


def ladder_text(effects: Sequence[Effect], kind: str, aim: Aim) -> str:
    """Say how many of a kind to have, and what each number that was tried brings or costs."""
    rungs = measured(effects, kind)
    figures = "; ".join(f"{effect.candidate.number}: {_rung(effect)}" for effect in rungs)
    return f"{verdict(rungs, kind, aim).text}. In {aim.gained} an hour against {rungs[0].candidate.before}: {figures}."


def _gain(effect: Effect) -> float:
    return effect.goals.mean if effect.goals is not None else 0.0


def _figures(effect: Effect) -> str:
    assert effect.goals is not None
    share = f" ({100 * effect.goals.mean / effect.base.mean:+.1f}%)" if effect.base.mean > 0 else ""
    return f"{difference(effect.goals)}{share}"


def _rung(effect: Effect) -> str:
    assert effect.goals is not None
    pairs = effect.goals.samples
    sign = "" if effect.told else " (too few pairs)" if pairs < PAIRS else " (not told)"
    return f"{_figures(effect)}{sign}"


def ladder_table(effects: Sequence[Effect], kind: str, aim: Aim) -> Table:
    """Return a line for each number that was tried."""
    rungs = measured(effects, kind)
    timed = any(effect.took is not None for effect in rungs)
    lines = []
    for effect in rungs:
        assert effect.goals is not None
        step = effect.candidate.number - effect.candidate.before
        most = effect.goals.high if step > 0 else -effect.goals.low
        lines.append((
            str(effect.candidate.number), difference(effect.goals), number(_gain(effect) / step), number(most),
            *([difference(effect.took) if effect.took else ""] if timed else []), str(effect.goals.samples),
            "told" if effect.told else "not told",
        ))  # fmt: skip
    against = f"{aim.gained}/h against {rungs[0].candidate.before}"
    header = (kind, against, "each of them", "at most", *(["s an order"] if timed else []), "pairs", "")
    note = (
        "Each number in pairs of episodes with the number that there is, until it is told or time is over. At most: "
        "what more of them bring, or fewer cost, by the end of the interval; all rungs together hold with 95%."
    )
    return Table(f"How many {kind}", header, tuple(lines), note)
