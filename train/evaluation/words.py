"""What the rows of an evaluation show, in words: as much as their intervals bear, and no more."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from train.evaluation.places import Floor
from train.reporting.columns import MEASURES
from train.reporting.report import counted, difference, grouped, number, short_names, with_interval
from train.reporting.rows import Interval, Row, apart, is_told, mean_interval, paired, select

_SAME_EPISODE = ("layout", "robots", "tasks", "planner", "seed")
_NONE_SEEN = 3.0  # events that a Poisson process which has shown none is held to at 95%


def paragraph(rows: Sequence[Row], floors: Mapping[str, Floor]) -> list[str]:
    """Return one paragraph a floor; floors: what each policy noted there, the keys are policy and layout joined by @.

    On each floor the words are about its largest number of robots, and what it changes against the smallest.
    """
    short = short_names({str(row[name]) for row in rows for name in ("layout", "policy")})
    texts = [_about(rows)]
    for layout in dict.fromkeys(str(row["layout"]) for row in rows):
        own = select(rows, layout=layout)
        most = max(row["robots"] for row in own)
        full = select(own, robots=most)
        sentences = [f"**{short[layout]}, {counted(most, 'robot')}.**", *_goals(full, short), *_load(own, full, short)]
        sentences += [*_orders(full, short), *_collisions(full, short), *_stuck(full, short)]
        texts.append(" ".join([*sentences, *_places(full, floors, short)]))
    return [*texts, CAVEAT]


CAVEAT = (
    "Brackets are 95% intervals, each for itself: of twenty differences that do not exist one will look told apart. "
    "What is *not told apart* may differ by as much as its interval says; more episodes make it narrower."
)


def _about(rows: Sequence[Row]) -> str:
    groups = grouped(rows, ("layout", "robots", "policy"))
    each = " to ".join(map(str, sorted({min(map(len, groups.values())), max(map(len, groups.values()))})))
    seconds = "/".join(number(value) for value in sorted({round(row["seconds"], 1) for row in rows}))
    policies = len({row["policy"] for row in rows})
    return (
        f"{len(rows)} episodes of {seconds} s: {each} for each of {_count(policies, 'policy', 'policies')}, "
        f"{_count(len({row['layout'] for row in rows}), 'floor', 'floors')} and number of robots."
        + (" The policies had the same seeds, so they are compared in pairs." if policies > 1 else "")
    )


def _count(number: int, one: str, more: str) -> str:
    return f"{number} {one if number == 1 else more}"


def ranked(rows: Sequence[Row], name: str, reverse: bool) -> list[tuple[str, Interval]]:
    """Return the policies with their interval of a measure, from least to most or the reverse; without data none."""
    found = [(str(key[0]), MEASURES[name].interval(own)) for key, own in grouped(rows, ("policy",)).items()]
    known = [one for one in found if math.isfinite(one[1].mean)]
    return sorted(known, key=lambda one: one[1].mean, reverse=reverse)


def _goals(rows: Sequence[Row], short: Mapping[str, str]) -> list[str]:
    """Say who reaches the most goals, and whether that is told apart from the next."""
    order = ranked(rows, "goals_per_robot_hour", reverse=True)
    if not order:
        return []
    best, interval = order[0]
    reached = with_interval(interval)
    if len(order) == 1:
        return [f"`{short[best]}` reaches {reached} goals per robot-hour."]
    second = order[1][0]
    versus = _against(rows, best, second, "goals_per_robot_hour")
    most = f"Most goals are reached under `{short[best]}`, {reached} per robot-hour"
    return [f"{most}; the next is `{short[second]}`, {versus}."]


def _against(rows: Sequence[Row], ours: str, other: str, name: str) -> str:
    measure = MEASURES[name]
    found = paired(select(rows, policy=ours), select(rows, policy=other), measure.value, _SAME_EPISODE)
    if found.samples < 2:
        return "of which one episode tells nothing apart"
    text = f"difference {difference(found, measure.factor)}"
    return text if is_told(found) else f"*not told apart* ({text})"


def _load(own: Sequence[Row], full: Sequence[Row], short: Mapping[str, str]) -> list[str]:
    """Say what more robots cost each of them, under the policy with the most goals."""
    fewest, most = min(row["robots"] for row in own), full[0]["robots"]
    order = ranked(full, "goals_per_robot_hour", reverse=True)
    before = select(own, robots=fewest, policy=order[0][0]) if order else []
    if fewest == most or not before:
        return []
    value = MEASURES["goals_per_robot_hour"].value
    change = apart(order[0][1], mean_interval(map(value, before)))
    told = "" if is_told(change) else ", *not told apart* from none"
    return [
        f"From {fewest} to {counted(most, 'robot')} its goals per robot-hour change by {difference(change)}{told}; all "
        f"robots together reach {number(most * order[0][1].mean)} an hour instead of "
        f"{number(fewest * (order[0][1].mean - change.mean))}."
    ]


def _orders(rows: Sequence[Row], short: Mapping[str, str]) -> list[str]:
    """Say who carries out the most orders, how long they take, and how stations and driving are used."""
    order = ranked(rows, "orders_per_hour", reverse=True)
    if not order:
        return []
    best, found = order[0]
    own = select(rows, policy=best)

    def of(name: str) -> str:
        measure = MEASURES[name]
        return with_interval(measure.interval(own), measure.factor)

    text = f"Under `{short[best]}` {with_interval(found)} orders an hour are dropped"
    if len(order) > 1:
        text += (
            f", the most; the next is `{short[order[1][0]]}`, {_against(rows, best, order[1][0], 'orders_per_hour')}"
        )
    return [
        f"{text}.",
        f"Half of its orders take at most {of('order_median_s')} s, one in twenty over {of('order_p95_s')} s; "
        f"{of('orders_late')} of an episode are late. Stations are used {of('station_utilisation')}% of the time, and "
        f"{of('empty_driving')}% of the metres are driven without a load.",
    ]


def _collisions(rows: Sequence[Row], short: Mapping[str, str]) -> list[str]:
    """Say who has no collisions, and how few of them that proves; and the fewest and most of the others."""
    order = ranked(rows, "collisions_per_km", reverse=False)
    clean = [policy for policy, interval in order if interval.mean == 0]
    sentences = []
    for policy in clean:
        km = sum(row["robot_km"] for row in select(rows, policy=policy))
        bound = f" (which shows less than {number(_NONE_SEEN / km, 2)} per km, with 95%)" if km else ""
        sentences.append(f"Under `{short[policy]}` nothing collides in {number(km)} robot-km{bound}.")
    others = [(policy, interval) for policy, interval in order if interval.mean > 0]
    if others:
        (least, few), (worst, many) = others[0], others[-1]
        text = f"Collisions per km: {with_interval(few)} under `{short[least]}`"
        if worst != least:
            versus = _against(rows, worst, least, "collisions_per_km")
            text += f", {with_interval(many)} under `{short[worst]}`: {versus}"
        sentences.append(f"{text}.")
    return sentences


def _stuck(rows: Sequence[Row], short: Mapping[str, str]) -> list[str]:
    """Say under which policies robots are stuck at the end."""
    order = ranked(rows, "stuck", reverse=True)
    stuck = [f"{with_interval(found, 100)}% under `{short[policy]}`" for policy, found in order if found.mean > 0]
    if not stuck:
        return ["At the end no robot is stuck."] if order else []
    rest = " and none under the others" if len(stuck) < len(order) else ""
    return [f"At the end robots are stuck: {', '.join(stuck)}{rest}."]


def _places(rows: Sequence[Row], floors: Mapping[str, Floor], short: Mapping[str, str]) -> list[str]:
    """Say, of the policy with the most goals, how much robots wait, on how little of the floor, and their detours."""
    order = ranked(rows, "goals_per_robot_hour", reverse=True)
    floor = floors.get(f"{order[0][0]}@{rows[0]['layout']}") if order else None
    if floor is None:
        return []
    sentences = []
    policy = order[0][0]
    share = mean_interval(row["waiting_share"] for row in select(rows, policy=policy))
    if floor.waiting.any():
        cells = half_of(floor.waiting)
        sentences.append(
            f"Under `{short[policy]}` robots stand {with_interval(share, 100)}% of their time, half of that on "
            f"{_count(cells, 'cell', 'cells')} of the floor."
        )
    if len(floor.ratios):
        median, tenth = np.quantile(floor.ratios, (0.5, 0.9))
        sentences.append(
            f"Half of its trips are at most {number(float(median))} times as long as planned, one in ten is over "
            f"{number(float(tenth))} times."
        )
    return sentences


def half_of(heat: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> int:
    """Return on how few cells at least half of all heat lies."""
    ranked_heat = np.sort(heat.ravel())[::-1].cumsum()
    return int(np.searchsorted(ranked_heat, ranked_heat[-1] / 2 * (1 - 1e-12))) + 1
