"""An advice in words: what it says, how sure that is, and what it rests on."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from train.advice.aim import FELL, GOALS, Aim
from train.advice.asked import SURE, Asked
from train.advice.candidates import Candidate, Kind, storage_lost
from train.advice.capacity import UNRACED, Capacity
from train.advice.changes import KINDS, PAIRS, Effect, kinds
from train.advice.course import Advice
from train.advice.curve import NEAR, STUCK, Load, peak
from train.advice.ladder import ladder_text, measured
from train.advice.trials import Plan
from train.kinds import described
from train.reporting.report import difference, number, with_interval
from train.reporting.rows import Interval, apart, is_told
from warehouse_env.config import RobotSpec
from warehouse_env.maps.grid_map import GridMap

NAMED = 3  # bottlenecks named in words


def answer(advice: Advice) -> list[str]:
    """Return the paragraphs of the answer, in Markdown's bold and italics."""
    capacity = advice.capacity
    parts = [asked_text(advice.asked, capacity, advice.plan.aim)] if advice.asked else []
    knee = knee_text(capacity, advice.plan.aim)
    parts += [" ".join(_most(advice)), knee, " ".join(_jam(advice)), " ".join(_policies(advice))]
    parts += [" ".join(_bottlenecks(advice)), *(" ".join(_changes(advice, kind)) for kind in kinds(advice.plan))]
    return [part for part in (*parts, _narrow(advice.plan), _basis(advice)) if part]


def _narrow(plan: Plan) -> str:
    """Say what the robots' bodies take from the floor."""
    return f"**Not all of the floor is for these robots**: {'; '.join(plan.narrow)}." if plan.narrow else ""


def asked_text(asked: Asked, capacity: Capacity, aim: Aim = GOALS) -> str:
    """Say how many robots make the goals, or the share of the orders in time, that were asked for."""
    if aim.share is None:
        wanted, makes, they = f"{asked.wanted:,.0f} goals an hour", "make", "they make"
        factor, unit, most = 1.0, "", "the most is"
    else:
        wanted, makes, they = f"{100 * asked.wanted:g}% of the orders in time", "drop", "of those due they drop"
        factor, unit, most = aim.share.factor, "%", "of those due it drops"
    goals = _commas(with_interval(asked.goals, factor)) + unit
    if asked.robots is None:
        most = f"{most} {goals}, with {capacity.crew.robots} robots"
        if asked.possible:
            return f"**Whether this floor {makes}s {wanted} is not told**: {most}, and of no number it is sure."
        return f"**This floor does not {makes} {wanted}**: {most}."
    text = (
        f"**{wanted} take {_robots(asked.robots)}**: {they} {goals}, in {asked.goals.samples} episodes that had no "
        f"part in finding them [{100 * SURE:.0f}% interval]."
    )
    if asked.fewer is None:
        return text
    fewer = asked.fewer.asked
    told = "are too few" if fewer.high < asked.wanted else "may be too few"
    return f"{text} {_robots(asked.fewer.robots)} {told}: {_commas(with_interval(fewer, factor))}{unit}."


def _listed(texts: list[str]) -> str:
    return " and ".join([", ".join(texts[:-1]), texts[-1]] if len(texts) > 1 else texts)


def _commas(text: str) -> str:
    """Return figures with a comma at thousands."""
    return re.sub(r"\d{4,}", lambda found: f"{int(found[0]):,}", text)


def _robots(count: int) -> str:
    return f"{count} robot{'s' * (count != 1)}"


def _most(advice: Advice) -> Iterator[str]:
    """Say how many goals, or orders, the floor makes at most, and with how many robots."""
    found, name, aim = advice.capacity, advice.plan.grid.name, advice.plan.aim
    goals, made = found.goals, _commas(with_interval(found.goals.goals))
    largest, robots = found.loads[-1].robots, _robots(found.crew.robots)
    open_ = found.crew.robots == largest > 1
    most = f"{name} makes at least this with {robots}" if open_ else f"{name} makes the most with {robots}"
    yield (
        f"**{most}: {made} {aim.noun} an hour**{_of_all(advice.plan)}, in {goals.episodes} episodes that had no part "
        "in choosing that number."
    )
    if found.best != found.crew.robots:
        yield (
            f"In those that had, {found.best} robots made most; the smaller number is named, since it was not told "
            f"apart and came within {100 - 100 * NEAR:.0f}%."
        )
    for load in found.loads:
        if load.goals.mean > goals.goals.high and load.stuck.mean > 0:
            made = _commas(with_interval(load.goals))
            yield f"{load.robots} made {made} in those, but some of them were stuck at the end, so it does not last."
    if open_:
        yield f"More were not tried, so it may be more: {_why(advice)}."
    elif found.stopped:
        yield f"The time was over before {_listed(found.stopped)}."
    if found.alone.mean > 0 and aim.share is None:
        share = number(100 * goals.each.mean / found.alone.mean, 2)
        waiting = with_interval(goals.waiting, 100, 2)
        yield f"Each of them makes {share}% of what one alone does, and waits {waiting}% of its time."


def _why(advice: Advice) -> str:
    if advice.capacity.stopped:
        return f"the time was over before {_listed(advice.capacity.stopped)}"
    return "it is the most to try, or as many as find a start and goals of their own on its pick faces and stations"


def _of_all(plan: Plan) -> str:
    """Say how many orders come, where they are drawn."""
    orders = plan.work.get("orders")
    return f" of {orders.per_hour:,.0f} that come" if orders is not None and orders.file is None else ""


def knee_text(found: Capacity, aim: Aim = GOALS) -> str:
    """Say from how many robots on a further one is worth less than half of the first."""
    each = f"{with_interval(found.alone)} {aim.noun} an hour"
    if found.knee is None:
        largest = found.loads[-1].robots
        return f"Up to {_robots(largest)}, as many as were tried, a further one brings over half of the first ({each})."
    return (
        f"**From about {_count(found.knee)} robots on a further one brings less than half of what the first did** "
        f"({each})."
    )


def _count(knee: Interval) -> str:
    high = f"{knee.high:.0f}" if math.isfinite(knee.high) else "more than were tried"
    return f"{knee.mean:.0f} [{knee.low:.0f}, {high}]"


def _jam(advice: Advice) -> Iterator[str]:
    found, jam = advice.capacity, advice.capacity.jam
    if jam is None:
        yield f"No jam was seen with up to {_robots(found.loads[-1].robots)}."
        return
    yield f"**With {_robots(jam.robots)} it jams**: {jam_text(advice, jam)}."
    below = [load for load in found.loads if load.robots < jam.robots]
    if below:
        yield f"{_robots(below[-1].robots)} still drive." if not below[-1].jammed else ""


def jam_text(advice: Advice, jams: Load) -> str:
    """Say what the jam with so many robots is."""
    if jams.stuck.mean >= STUCK:
        share = with_interval(jams.stuck, 100)
        return f"{share}% of the robots are stuck after {advice.plan.seconds / 60:g} minutes ({jams.episodes} episodes)"
    most = peak([load for load in advice.capacity.loads if load.robots < jams.robots])
    fall = apart(jams.goals, most.goals)
    open_ = "" if is_told(fall) else "; so few episodes do *not tell* this *apart* from chance"
    return (
        f"all together make {_commas(with_interval(jams.goals))} {advice.plan.aim.noun} an hour, less than "
        f"{100 * FELL:g}% of what {most.robots} did (difference {_commas(difference(fall))}{open_})"
    )


def _policies(advice: Advice) -> Iterator[str]:
    """Say who drives, and what the others would make."""
    found, policies = advice.capacity, len(advice.plan.policies)
    raced = f", the best of {policies} that were raced" if policies > 1 and UNRACED not in found.stopped else ""
    yield f"They drive under `{found.crew.policy}`{raced}."
    if len(found.others) < policies - 1:
        yield "The time was over before all others were measured on new seeds."
    for other in found.others:
        gain = f"{_commas(difference(other.difference))} {advice.plan.aim.noun} an hour"
        gain += f" in {other.difference.samples} pairs of episodes"
        told = "" if is_told(other.difference) else ", which is *not told apart* from none"
        yield f"Its difference from `{other.policy}` with as many robots is {gain}{told}."
    if found.contacts.mean > 0:
        yield f"**Its robots touch something**: {with_interval(found.contacts)} contacts a kilometre."


def _bottlenecks(advice: Advice) -> Iterator[str]:
    if not advice.bottlenecks:
        yield "No robot waited, so there is no bottleneck."
        return
    places = [
        f"**{k}** (x {place.x:g} m, y {place.y:g} m; {100 * place.share:.0f}% of all waiting, "
        f"{100 * place.trips:.0f}% of all trips pass)"
        for k, place in enumerate(advice.bottlenecks[:NAMED], start=1)
    ]
    yield f"{_robots(advice.crew.robots)} wait most at {', '.join(places)}."
    together = sum(place.share for place in advice.bottlenecks)
    if together < 0.3:
        count = len(advice.bottlenecks)
        yield f"Waiting is spread: the {count} worst places have {100 * together:.0f}% of it together."


_ASKED_OF = {"aisle": "One more aisle", "one-way": "A one-way rule", "stations": "Stations", "chargers": "Chargers"}


def _changes(advice: Advice, kind: Kind) -> Iterator[str]:
    own = [effect for effect in advice.effects if effect.candidate.kind == kind]
    what = _ASKED_OF[kind]
    if kind not in KINDS:
        yield _ladder(own, kind, advice)
        return
    if not own and not advice.sought:
        yield f"**{what}**: there was no time to try any."
        return
    if not own:
        yield f"**{what}**: no change of this kind is possible at the bottlenecks." if advice.bottlenecks else ""
        return
    best, crew = own[0], f"with {_robots(advice.crew.robots)}"
    yield (
        f"**{what}**: of {len(own)} tried {crew} the best is {best.candidate.text}; "
        f"{effect_text(best, advice.plan.aim)}."
    )
    if kind == "aisle":
        yield f"It costs {storage_text(advice.plan.grid, best.candidate)}."


def _ladder(own: list[Effect], kind: Kind, advice: Advice) -> str:
    what = _ASKED_OF[kind]
    if not measured(own, kind):
        why = "no other number can be had here" if advice.rungs else "there was no time to try any other number"
        return f"**{what}**: {why}."
    return f"**{what}**: with {_robots(advice.crew.robots)}, {_commas(ladder_text(own, kind, advice.plan.aim))}"


def storage_text(grid: GridMap, one: Candidate) -> str:
    """Say how much storage a change takes away."""
    lost = storage_lost(grid, one)
    cells = f"{100 * lost.share:.0f}% of the storage ({lost.cells} shelf cells)"
    return f"{cells}; {lost.faces} of {lost.of} pick faces have no shelf left" if lost.faces else cells


def effect_text(effect: Effect, aim: Aim = GOALS) -> str:
    """Say what a change brings or may bring; it is said to bring something from PAIRS pairs on."""
    if effect.goals is None:
        return "it was not driven again"
    share = f" ({100 * effect.goals.mean / effect.base.mean:+.1f}%)" if effect.base.mean > 0 else ""
    text = (
        f"{_commas(difference(effect.goals))} {aim.gained} an hour{share} in {effect.goals.samples} pairs of episodes"
    )
    if effect.took is not None:
        text += f"; an order takes {difference(effect.took)} s"
    if effect.told:
        return f"it {'brings' if effect.goals.mean > 0 else 'costs'} {text}"
    if effect.goals.samples < PAIRS:
        return f"it may bring something, but these are too few pairs to say so: {text}"
    what = "it may bring something, or nothing" if effect.goals.mean > 0 else "it brings nothing that could be told"
    return f"{what}: {text}"


def told(interval: Interval | None, factor: float = 1.0) -> str:
    """Format a difference for a table."""
    return "" if interval is None else difference(interval, factor)


def _basis(advice: Advice) -> str:
    plan = advice.plan
    whole = ", of orders in time all" if plan.aim is not GOALS else ""
    favour = " Where orders favour some shelves, this may be otherwise." if plan.aim is GOALS else ""
    return (
        f"Simulated: {_worked(plan)}, {robots_text(plan)}, episodes of {plan.seconds:g} s of which the second half "
        f"is counted{whole}. Brackets are 95% intervals over episodes; those of changes are so much wider that "
        f"{held(plan)}. A change is chosen in some episodes and measured in others with new seeds, in pairs with the "
        f"floor as it is; {'other ' if plan.work else ''}pick faces and stations stay, also where their shelf "
        f"goes.{favour}"
    )


def robots_text(plan: Plan) -> str:
    """Say what robots drive, and which of them one alone is."""
    if plan.kinds is None:
        return f"robots of {described(RobotSpec())}"
    turns = " (one alone is of each kind in turn, as often as there are such)" if plan.kinds.mixed else ""
    return f"robots of {plan.kinds.words}{turns}"


def held(plan: Plan) -> str:
    """Say what the intervals of changes hold."""
    ladders = [kind for kind in kinds(plan) if kind not in KINDS]
    both = "both kinds of them" if ladders else "both kinds"
    each = "".join(f", and all numbers of {kind} together," for kind in ladders)
    return f"{both} together{each} hold with 95%"


def _worked(plan: Plan) -> str:
    """Say what robots work at."""
    orders, service, battery = (plan.work.get(name) for name in ("orders", "service", "battery"))
    texts = ["lifelong trips between pick faces and stations drawn at random"]
    if orders is not None:
        come = (
            f"those of {orders.file}" if orders.file else f"{orders.per_hour:g} an hour in the mean, at random moments"
        )
        texts = [f"orders ({come}), given out by the rule {orders.allocation}"]
    if service is not None:
        texts.append(f"{service.pick:g} s at every pick face and {service.station:g} s at every station")
    if battery is not None:
        chargers = f"{battery.chargers} charger{'s' * (battery.chargers > 1)}"
        texts.append(f"batteries of {battery.capacity:g} Wh, {chargers} of {battery.power:g} W")
    return ", ".join(texts)
