"""An advice as a page: the answer, and the figures behind it."""

from __future__ import annotations

from collections.abc import Sequence

from agents import POLICIES
from train.advice.aim import Aim
from train.advice.answer import answer, effect_text, held, robots_text, told
from train.advice.candidates import Candidate, storage_lost
from train.advice.changes import KINDS, Effect, kinds, sure
from train.advice.course import Advice
from train.advice.ladder import ladder_table, measured, verdict
from train.advice.take_away import recommended
from train.advice.trials import BLOCK
from train.reporting.page import Link, Page, Part, Shown, made_by
from train.reporting.report import Table, number, with_interval
from warehouse_env.render import report_charts
from warehouse_env.render.heat_maps import Panel, heat_maps


def advice_page(advice: Advice, hall: Sequence[Part] = (), files: Sequence[Link] = ()) -> Page:
    """Return the page; hall: what was understood of a hall. files: of the floor to take away."""
    grid = advice.plan.grid
    parts = [
        *hall,
        Part("How many robots", pictures=[_throughput(advice)], tables=[loads_table(advice)]),
        Part("Where the bottlenecks are", pictures=[_heat(advice)], tables=[places_table(advice)]),
        _of_changes(advice),
        *([_to_take_away(advice, files)] if files else []),
        Part("What was run", facts=_facts(advice)),
    ]
    title = f"How many robots does {grid.name} bear, and what holds them up?"
    high, wide = (number(side * grid.cell_size) for side in grid.shape)
    subtitle = f"{wide} x {high} m, {len(grid.picks)} pick faces, {len(grid.stations)} stations"
    return Page(title, subtitle, answer(advice), parts)


def _to_take_away(advice: Advice, files: Sequence[Link]) -> Part:
    """Return the files of the recommended floor."""
    found = recommended(advice)
    text = f"This is {found.words}."
    if found.effect is None:
        return Part("The floor to take away", text, links=files)
    one = found.effect.candidate
    label = "The floor to take away"
    opened = one.changed if one.kind != "one-way" else None
    drawing = heat_maps([Panel("", one.grid, opened=opened)], "", label)
    return Part(label, text, [Shown(drawing, f"{label}, in green what is changed.")], links=files)


def _throughput(advice: Advice) -> Shown:
    capacity = advice.capacity
    noun = advice.plan.aim.noun
    label = f"{noun.capitalize()} per hour of all robots together over their number"
    found = [report_charts.FloorLoad(load.robots, *load.goals[:3], load.jammed) for load in capacity.loads]
    named = report_charts.FloorLoad(capacity.goals.robots, *capacity.goals.goals[:3], False)
    caption = (
        f"{label}, in the second half of the episodes: means with 95% intervals. The large dot is the answer, in "
        "episodes of its own. The dashed line is what they would reach if each were alone on the floor."
    )
    knee = capacity.knee[:3] if capacity.knee else None
    return Shown(report_charts.throughput(found, capacity.alone.mean, named, knee, label, noun), caption)


def loads_table(advice: Advice) -> Table:
    """Return a line for each number of robots, first the answer in episodes of its own."""
    capacity, aim = advice.capacity, advice.plan.aim
    lines = [(f"{capacity.goals.robots}, new seeds", capacity.goals)]
    lines += [(str(load.robots), load) for load in capacity.loads]
    cells = [
        (
            name, str(load.episodes), with_interval(load.goals), with_interval(load.each),
            with_interval(load.waiting, 100), with_interval(load.stuck, 100),
            *([with_interval(load.share, aim.share.factor)] if load.share and aim.share else []),
            "jams" if load.jammed else "drives",
        )
        for name, load in lines
    ]  # fmt: skip
    share = (aim.share.heading,) if aim.share else ()
    header = ("robots", "episodes", f"{aim.noun}/h, all", f"{aim.noun}/robot-h", "waiting %", "stuck %", *share, "")
    note = (
        "The first line is the answer; the others are the episodes by which it was chosen. Of those that looked worse "
        "there are fewer. Stuck: robots that at the end have not got on for over a minute."
        f"{' In time: of the orders due by the end; no more than do not pile up.' if share else ''}"
    )
    return Table(f"Robots under {capacity.crew.policy}", header, tuple(cells), note)


def _heat(advice: Advice) -> Shown:
    grid = advice.plan.grid
    places = [tuple(grid.centre(place.cell).tolist()) for place in advice.bottlenecks]
    panels = [
        Panel("waiting [s per hour and cell]", grid, advice.floor.waiting, numbers=places),
        Panel("trips that pass [%]", grid, 100 * advice.visits),
    ]
    label = f"Where {advice.crew.robots} robots wait, and where trips lead"
    caption = (
        f"{label}. Left: how long an hour some robot stands on a cell; the numbers are the worst places. Right: the "
        "share of trips, drawn at random, whose shortest route leads over a cell. Blue squares are stations."
    )
    return Shown(heat_maps(panels, "", label, shared=False), caption)


def places_table(advice: Advice) -> Table:
    """Return a line for each bottleneck."""
    cells = [
        (
            str(k), f"{place.x:g}", f"{place.y:g}", f"{place.waiting:.0f}", f"{100 * place.share:.1f}",
            f"{100 * place.trips:.1f}",
        )
        for k, place in enumerate(advice.bottlenecks, start=1)
    ]  # fmt: skip
    header = ("place", "x [m]", "y [m]", "waiting [s per hour]", "of all waiting [%]", "trips that pass [%]")
    return Table("Bottlenecks", header, tuple(cells), "Within two cells of the place's middle.")


def _of_changes(advice: Advice) -> Part:
    """Return what changes bring, or why none was driven."""
    why = "" if advice.effects else "None was driven: there was no time, or nowhere to change anything."
    tables = [*ladder_tables(advice), *([changes_table(advice)] if advice.effects else [])]
    return Part("What a change would bring", why, _changes(advice), tables=tables)


def _changes(advice: Advice) -> list[Shown]:
    """Return where the best change of each kind lies, and what all of them bring."""
    best = [effect for effect in advice.effects if effect.goals is not None]
    if not best:
        return []
    aim = advice.plan.aim
    drawn_at = dict(zip("ABCD", _placed(best, aim), strict=False))
    panels = [_panel(effect.candidate, letter, advice) for letter, effect in drawn_at.items()]
    label = "The changes that were measured"
    said = " ".join(
        f"**{letter}: {effect.candidate.kind}**: {effect.candidate.text}; {effect_text(effect, aim)}."
        for letter, effect in drawn_at.items()
    )
    caption = f"{label}, in green, over where robots wait without them [s per hour]. {said}"
    raced = [one for one in advice.effects if one.first.samples]
    looks = {
        "first look": [report_charts.Pair(one.candidate.text, *one.first[:3]) for one in raced],
        "measured": [report_charts.Pair(one.candidate.text, *one.goals[:3]) for one in best if one.goals is not None],
    }
    differences = f"{aim.gained.capitalize()} per hour of all robots, difference from the floor as it is"
    below = (
        f"{differences}: paired, with intervals; blue and filled where the interval leaves out 0. The best of each "
        "kind at first look was driven again with new seeds: what it was chosen by flatters it."
    )
    drawn = report_charts.differences(
        {title: pairs for title, pairs in looks.items() if pairs}, differences, f"{aim.gained} per hour"
    )
    maps = [Shown(heat_maps(panels, "standing [s per hour]", label), caption)] if panels else []
    return [*maps, Shown(drawn, below)]


def _placed(best: list[Effect], aim: Aim) -> list[Effect]:
    """Return the changes that have a place on the floor, of stations the number that is best, or most."""
    found = [effect for effect in best if effect.candidate.kind in KINDS]
    stations = measured(best, "stations")
    if stations:
        chosen = verdict(stations, "stations", aim).number
        found.append(next((one for one in stations if one.candidate.number == chosen), stations[-1]))
    return [effect for effect in found if effect.candidate.changed.any()]


def _panel(one: Candidate, letter: str, advice: Advice) -> Panel:
    """Return the floor with a change."""
    grid = advice.plan.grid if one.kind in KINDS else one.grid
    return Panel(
        f"{letter}: {one.kind}", grid, advice.floor.waiting, opened=None if one.kind == "one-way" else one.changed,
        one_way=one.grid.one_way if one.kind == "one-way" else None,
    )  # fmt: skip


def ladder_tables(advice: Advice) -> list[Table]:
    """Return what numbers of stations and of chargers bring, where they were tried."""
    aim = advice.plan.aim
    ladders = [kind for kind in kinds(advice.plan) if kind not in KINDS and measured(advice.effects, kind)]
    return [ladder_table(advice.effects, kind, aim) for kind in ladders]


def changes_table(advice: Advice) -> Table:
    """Return a line for each change of the floor that was tried."""
    gained, timed = advice.plan.aim.gained, advice.plan.aim.share is not None
    cells = [
        (
            effect.candidate.text, effect.candidate.kind, told(effect.first), str(effect.first.samples),
            told(effect.goals), str(effect.goals.samples) if effect.goals else "", told(effect.waiting, 100),
            told(effect.trip), *([told(effect.took)] if timed else []),
            f"{100 * storage_lost(advice.plan.grid, effect.candidate).share:.0f}",
        )
        for effect in advice.effects
    ]  # fmt: skip
    header = (
        "change", "kind", f"{gained}/h, first look", "pairs", f"{gained}/h, measured", "pairs", "waiting %",
        "metres a trip", *(["s an order"] if timed else []), "storage lost %",
    )  # fmt: skip
    note = (
        "Differences from the floor as it is, in pairs of episodes with the same seeds [interval by Student's t: 95% "
        f"at first look, {' and '.join(_sure(advice))} of what was measured, so that {held(advice.plan)}]."
    )
    return Table("Changes of the floor", header, tuple(cells), note)


def _sure(advice: Advice) -> list[str]:
    return [f"{share:.4g}%" for share in dict.fromkeys(100 * sure(kind) for kind in kinds(advice.plan))]


def _facts(advice: Advice) -> dict[str, str]:
    plan = advice.plan
    return made_by(**{
        "Policies": ", ".join(f"`{policy}`: {_summary(policy)}" for policy in plan.policies),
        "Robots": robots_text(plan),
        "Routes": f"by {plan.planner}",
        "Episodes": f"of {plan.seconds:g} s, seeds from {plan.seed} on, {BLOCK} for each use",
        "Rows": "`rows.jsonl` beside this page holds every episode",
    })  # fmt: skip


def _summary(policy: str) -> str:
    return POLICIES[policy].summary if policy in POLICIES else "a policy folder"
