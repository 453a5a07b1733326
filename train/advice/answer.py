"""An advice: its course (how many robots, where they wait, which changes to try) and its answer in words."""

import math
import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.advice import changes
from train.advice.capacity import SURE, Capacity, RobotsNeeded, begun, capacity, confirmed, robots_needed
from train.advice.changes import PAIRS, Candidate, Effect, storage_lost
from train.advice.curve import STUCK, peak
from train.advice.study import Team, TrialRuns
from train.advice.trials import FELL, GOALS, AdvicePlan, Aim, Drive, TimeBudget, Use
from train.advice.trips import Bottleneck, bottlenecks, draw_trips, plan_trips, traffic
from train.evaluation.places import FloorNotes, floor_of_notes
from train.kinds import described
from train.reporting.columns import longest_stand
from train.reporting.report import difference, number, with_interval
from train.reporting.rows import Row
from warehouse_env.config import RobotSpec
from warehouse_env.errors import counted
from warehouse_env.maps.grid_map import GridMap

_ASKED = 0.75  # of the time, when the robots for a target are found
_MOST = 100  # episodes of the answer if no change is tried


class Advice(NamedTuple):
    """All findings."""

    plan: AdvicePlan
    team: Team  # of bottlenecks and changes: the fewest that reach the target, else the best
    capacity: Capacity
    asked: RobotsNeeded | None  # if a target was given
    floor: FloorNotes  # where those robots wait
    bottlenecks: list[Bottleneck]
    visits: NDArray[np.float64]  # share of trips over each cell
    effect: Effect | None  # of the best aisle
    sought: bool  # whether there was time for changes
    stands: dict[int, Row]  # number of robots -> episode of their longest stand


def advise(plan: AdvicePlan, drive: Drive, clock: TimeBudget) -> Advice:
    """Find everything in the time given, which begins after the first episodes, since these may compile kernels."""
    study = begun(plan, drive, clock)
    trips = draw_trips(plan.grid, plan.seed)
    visits, _ = traffic(plan_trips(plan.grid, trips), plan.grid.shape)
    found = capacity(study)
    answered = robots_needed(study, found, _ASKED) if plan.wanted is not None else None
    team = Team(found.team.policy, answered.robots if answered and answered.robots else found.team.robots)
    worst = _places(study, team, visits)[1]
    most = changes.affordable(clock.left, study.seconds(team.robots))
    chosen = changes.options(plan, worst, trips, team.robots, most)
    if not chosen and plan.episodes is None:
        study.repeat([found.team], Use.CONFIRM, _MOST, 1.0)
        found = found._replace(goals=confirmed(study, found.team))
    effect = changes.measured(study, chosen, team)
    counts = (team.robots, found.jam.robots if found.jam else 0)
    stands = {count: row for count in counts if (row := longest_stand(study.of(Team(team.policy, count))))}
    return Advice(plan, team, found, answered, *_places(study, team, visits), visits, effect, most > 0, stands)


def _places(study: TrialRuns, team: Team, visits: NDArray[np.float64]) -> tuple[FloorNotes, list[Bottleneck]]:
    """Return where robots wait, and the bottlenecks."""
    floor = floor_of_notes(study.of(team))
    return floor, bottlenecks(study.plan.grid, floor.waiting, visits) if floor.waiting.any() else []


NAMED = 3  # bottlenecks named in words


def answer(advice: Advice) -> list[str]:
    """Return the paragraphs of the answer, with Markdown's bold and italics."""
    plan, capacity = advice.plan, advice.capacity
    parts = [asked_text(advice.asked, capacity, plan.aim)] if advice.asked else []
    parts += [_most(advice), _knee(capacity, plan.aim), _jam(advice), _policy(advice), _bottlenecks(advice)]
    parts.append(_change(advice))
    if plan.narrow:
        parts.append(f"**These robots cannot use the whole floor**: {'; '.join(plan.narrow)}.")
    return [part for part in (*parts, _basis(plan)) if part]


def asked_text(asked: RobotsNeeded, capacity: Capacity, aim: Aim = GOALS) -> str:
    """Say how many robots reach the target."""
    wanted, made = f"{asked.wanted:,.0f} {aim.noun} an hour", _commas(with_interval(asked.goals))
    if asked.robots is not None:
        return (
            f"**{wanted} take {counted(asked.robots, 'robot')}**: they reach {made} in {asked.goals.samples} new "
            f"episodes [{100 * SURE:.0f}% interval]."
        )
    most = f"the most is {made}, with {counted(capacity.team.robots, 'robot')}"
    if asked.possible:
        return f"**It is not certain that this floor allows {wanted}**: {most}."
    return f"**This floor does not allow {wanted}**: {most}."


def _commas(text: str) -> str:
    """Return figures with a comma at thousands."""
    return re.sub(r"\d{4,}", lambda found: f"{int(found[0]):,}", text)


def _most(advice: Advice) -> str:
    """Say how many goals, or orders, the floor allows at most, and with how many robots."""
    found, aim, plan = advice.capacity, advice.plan.aim, advice.plan
    made, robots = _commas(with_interval(found.goals.goals)), counted(found.team.robots, "robot")
    is_last, orders = found.team.robots == found.loads[-1].robots > 1, plan.work.get("orders")
    most = f"reaches {'at least this' if is_last else 'the most'} with {robots}: {made} {aim.noun} an hour"
    given = f" of {orders.per_hour:,.0f} given" if orders is not None and orders.file is None else ""
    text = f"**{plan.grid.name} {most}**{given}, in {found.goals.episodes} new episodes."
    if found.stopped:
        text += f" The time was over before {', '.join(found.stopped)}."
    elif is_last:
        text += " More were not tried: `--most`, or the starts and goals on this floor, allow no more."
    if found.alone.mean > 0 and aim is GOALS:
        share, waiting = number(100 * found.goals.each.mean / found.alone.mean, 2), found.goals.waiting
        text += f" Each robot reaches {share}% of the goals of one alone and waits {with_interval(waiting, 100, 2)}% of"
        text += " its time."
    return text


def _knee(found: Capacity, aim: Aim) -> str:
    """Say from how many robots on a further one adds less than half of the first."""
    each = f"{with_interval(found.alone)} {aim.noun} an hour"
    if found.knee is None:
        return f"Up to {counted(found.loads[-1].robots, 'robot')}, each adds over half of the first ({each})."
    high = f"{found.knee.high:.0f}" if math.isfinite(found.knee.high) else "more than were tried"
    count = f"{found.knee.mean:.0f} [{found.knee.low:.0f}, {high}]"
    return f"**From about {count} robots on, a further one adds less than half of the first** ({each})."


def _jam(advice: Advice) -> str:
    """Say with how many robots the floor jams, and how that shows."""
    found, jam = advice.capacity, advice.capacity.jam
    if jam is None:
        return f"No jam was seen with up to {counted(found.loads[-1].robots, 'robot')}."
    below = [load for load in found.loads if load.robots < jam.robots]
    if jam.stuck.mean >= STUCK:
        how = f"{with_interval(jam.stuck, 100)}% of the robots are stuck after {advice.plan.seconds / 60:g} minutes"
    else:
        made = f"all robots together reach {_commas(with_interval(jam.goals))} {advice.plan.aim.noun} an hour"
        how = f"{made}, less than {100 * FELL:g}% of what {peak(below).robots} reach"
    text = f"**With {counted(jam.robots, 'robot')} it jams**: {how} ({counted(jam.episodes, 'episode')})."
    if below and not below[-1].jammed:
        text += f" With {below[-1].robots} it does not."
    return text + _stood(advice, jam.robots)


def _stood(advice: Advice, robots: int) -> str:
    """Name the robot that stood longest among so many, and the one that it waited for; "" without a long stand."""
    row = advice.stands.get(robots)
    if row is None:
        return ""
    seconds, why = row["longest_standing_s"], row["longest_standing_why"]
    return f" The longest stand took {seconds:.0f} s (seed {row['seed']}): {why}."


def _policy(advice: Advice) -> str:
    """Say which policy drives, and whether robots touch something."""
    found, policies = advice.capacity, len(advice.plan.policies)
    raced = f", the best of {policies} policies" if found.raced else ""
    text = f"The policy is `{found.team.policy}`{raced}."
    if found.contacts.mean > 0:
        text += f" **Its robots touch something**: {with_interval(found.contacts)} contacts per kilometre."
    return text


def _bottlenecks(advice: Advice) -> str:
    if not advice.bottlenecks:
        return "No robot waited, so there is no bottleneck."
    places = [
        f"**{k}** (x {place.x:g} m, y {place.y:g} m; {100 * place.share:.0f}% of all waiting, "
        f"{100 * place.trips:.0f}% of all trips)"
        for k, place in enumerate(advice.bottlenecks[:NAMED], start=1)
    ]
    robots = advice.team.robots
    return f"{counted(robots, 'robot')} wait most at {', '.join(places)}.{_stood(advice, robots)}"


def _change(advice: Advice) -> str:
    """Say what the best change gains."""
    effect, head = advice.effect, "**One more aisle**"
    if effect is None and not advice.sought:
        return f"{head}: there was no time to try any."
    if effect is None:
        return f"{head}: none can be opened at the bottlenecks." if advice.bottlenecks else ""
    best = f"the best of {effect.tried} tried is " if effect.tried > 1 else ""
    cost = f"it costs {storage_text(advice.plan.grid, effect.candidate)}"
    said = f"{best}{effect.candidate.text}: {effect_text(effect, advice.plan.aim)}; {cost}"
    return f"{head} with {counted(advice.team.robots, 'robot')}: {said}."


def storage_text(grid: GridMap, one: Candidate) -> str:
    """Say how much storage a change removes."""
    lost, share, faces, served = storage_lost(grid, one)
    cells = f"{100 * share:.0f}% of the storage ({lost} shelf cells)"
    return f"{cells}, and {faces} of {served} pick faces have no shelf left" if faces else cells


def effect_text(effect: Effect, aim: Aim = GOALS) -> str:
    """Say what a change gains; a gain is reported from PAIRS pairs on."""
    share = f" ({100 * effect.gain.mean / effect.base.mean:+.1f}%)" if effect.base.mean > 0 else ""
    text = f"{_commas(difference(effect.gain))} {aim.noun} an hour{share} in {effect.gain.samples} pairs of episodes"
    if effect.significant:
        return f"it {'gains' if effect.gain.mean > 0 else 'loses'} {text}"
    why = "there are too few pairs to tell" if effect.gain.samples < PAIRS else "the difference may be chance"
    return f"{why}, {text}"


def _basis(plan: AdvicePlan) -> str:
    return (
        f"Simulated: {_worked(plan)}, {robots_text(plan)}, episodes of {plan.seconds:g} s of which the second half "
        f"counts. Brackets are 95% intervals over episodes. "
        "A change is chosen in some episodes and measured in others, with new seeds, in pairs with the floor as it is."
    )


def robots_text(plan: AdvicePlan) -> str:
    """Describe the robots."""
    return f"robots of {described(RobotSpec()) if plan.kinds is None else plan.kinds.words}"


def _worked(plan: AdvicePlan) -> str:
    """Describe the robots' work."""
    orders, service, battery = (plan.work.get(name) for name in ("orders", "service", "battery"))
    texts = ["lifelong trips between random pick faces and stations"]
    if orders is not None:
        come = f"those of {orders.file}" if orders.file else f"{orders.per_hour:g} an hour on average"
        texts = [f"orders ({come}), assigned by the rule {orders.allocation}"]
    if service is not None:
        texts.append(f"{service.pick:g} s at every pick face and {service.station:g} s at every station")
    if battery is not None:
        chargers = counted(battery.chargers, "charger")
        texts.append(f"batteries of {battery.capacity:g} Wh, {chargers} of {battery.power:g} W")
    return ", ".join(texts)
