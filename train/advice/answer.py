"""An advice in words: what it says, how sure that is, and what it rests on."""

from __future__ import annotations

from collections.abc import Iterator

from train.advice.course import FELL, STUCK, Advice, Effect, Load
from train.reporting.report import difference, number, with_interval
from train.reporting.rows import Interval, apart, is_told

NAMED = 3  # bottlenecks named in words


def answer(advice: Advice) -> list[str]:
    """Return the paragraphs of the answer, in Markdown's bold and italics."""
    parts = [" ".join(_capacity(advice)), " ".join(_bottlenecks(advice))]
    parts += [" ".join(_changes(advice, kind)) for kind in ("aisle", "one-way")]
    return [part for part in (*parts, _basis(advice)) if part]


def _capacity(advice: Advice) -> Iterator[str]:
    jams = next((load for load in advice.loads if load.jammed), None)
    name = advice.plan.grid.name
    if jams is None:
        tried = advice.loads[-1].robots
        why = "the time was over" if advice.stopped else "the most to try, or that have goals of their own"
        yield f"**{name} bears {tried} robots at least**: no jam was seen with up to {tried} ({why})."
    elif advice.bears == 0:
        yield f"**{name} jams with {jams.robots} robots already**, the fewest that were tried: {_jam(advice, jams)}."
    else:
        yield f"**{name} bears about {advice.bears} robots.** With {jams.robots} it jams: {_jam(advice, jams)}."
        if advice.stopped:
            yield "The time was over before the number in between was found."
    load = next((load for load in advice.loads if load.robots == advice.bears), None)
    if load is not None:
        alone = with_interval(advice.alone)
        share = number(100 * load.each.mean / advice.alone.mean, 2) if advice.alone.mean > 0 else "-"
        yield (
            f"{load.robots} robots together reach {with_interval(load.goals)} goals an hour; each of them {share}% of "
            f"what one alone would ({alone}), waiting {with_interval(load.waiting, 100, 2)}% of its time."
        )
    worth = worthwhile(advice.loads, advice.alone.mean)
    if worth is not None:
        yield f"Beyond about {worth} robots, a further one brings less than half of what one alone would."


def _jam(advice: Advice, jams: Load) -> str:
    if jams.stuck.mean >= STUCK:
        return f"{with_interval(jams.stuck, 100)}% of the robots are stuck after {advice.plan.seconds / 60:g} minutes"
    most = max((load for load in advice.loads if load.robots < jams.robots), key=lambda load: load.goals.mean)
    fall = apart(jams.goals, most.goals)
    open_ = "" if is_told(fall) else "; so few episodes do *not tell* this *apart* from chance"
    return (
        f"all together reach {with_interval(jams.goals)} goals an hour, less than {100 * FELL:g}% of what "
        f"{most.robots} did (difference {difference(fall)}{open_})"
    )


def worthwhile(loads: list[Load], alone: float) -> int | None:
    """Return the last number of robots tried before a further robot brings less than half of `alone` [goals/h].

    None where each step brought more, or the first did not.
    """
    worth = None
    before, reached = 0, 0.0
    for load in loads:
        if load.goals.mean - reached < 0.5 * alone * (load.robots - before):
            return worth
        before, reached = load.robots, load.goals.mean
        worth = load.robots
    return None


def _bottlenecks(advice: Advice) -> Iterator[str]:
    if not advice.bottlenecks:
        yield "No robot waited, so there is no bottleneck."
        return
    places = [
        f"**{k}** (x {place.x:g} m, y {place.y:g} m; {100 * place.share:.0f}% of all waiting, "
        f"{100 * place.trips:.0f}% of all trips pass)"
        for k, place in enumerate(advice.bottlenecks[:NAMED], start=1)
    ]
    yield f"Robots wait most at {', '.join(places)}."
    together = sum(place.share for place in advice.bottlenecks)
    if together < 0.3:
        count = len(advice.bottlenecks)
        yield f"Waiting is spread: the {count} worst places have {100 * together:.0f}% of it together."


def _changes(advice: Advice, kind: str) -> Iterator[str]:
    own = [effect for effect in advice.effects if effect.candidate.kind == kind]
    what = "One more aisle" if kind == "aisle" else "A one-way rule"
    if not own:
        yield f"**{what}**: no change of this kind is possible at the bottlenecks." if advice.bottlenecks else ""
        return
    best = own[0]
    yield f"**{what}**: of {len(own)} tried the best is {best.candidate.text}; {effect_text(best)}."


def effect_text(effect: Effect) -> str:
    """Say what a change brings, or that nothing can be told."""
    if effect.goals is None:
        return "it was not driven again"
    share = f" ({100 * effect.goals.mean / effect.base.mean:+.1f}%)" if effect.base.mean > 0 else ""
    text = f"{difference(effect.goals)} goals an hour{share} in {effect.goals.samples} pairs of episodes"
    if not is_told(effect.goals):
        return f"what it brings is *not told apart* from nothing: {text}"
    return f"it {'brings' if effect.goals.mean > 0 else 'costs'} {text}"


def told(interval: Interval | None, factor: float = 1.0) -> str:
    """Format a difference for a table."""
    return "" if interval is None else difference(interval, factor)


def _basis(advice: Advice) -> str:
    plan = advice.plan
    return (
        "Simulated: lifelong trips between pick faces and stations drawn at random, robots of 0.9 x 0.6 m under right "
        f"of way by rules (`greedy`), episodes of {plan.seconds:g} s. Brackets are 95% intervals over episodes. A "
        "change is chosen in some episodes and measured in others with new seeds, in pairs with the floor as it is; "
        "pick faces and stations stay. Where orders favour some shelves, this may be otherwise."
    )
