"""The course of an advice: how many robots, where they wait, which changes to try; each step from the rows before."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.advice import candidates
from train.advice.candidates import Bottleneck, Candidate, Kind, bottlenecks, draw_trips, passing, plan_trips, traffic
from train.advice.trials import AS_IS, Clock, Drive, Trial
from train.evaluation.places import Floor, floor_of_notes
from train.reporting.report import MEASURES
from train.reporting.rows import Interval, Row, mean_interval, paired
from warehouse_env.maps.grid_map import GridMap

FIRST = 8  # robots tried first
STUCK = 0.05  # share of robots stuck at the end from which a floor counts as jammed
FELL = 0.9  # of the throughput with fewer robots, below which it counts as jammed as well
CLOSE = 0.125  # of the number that a floor bears: as near to the number that jams as it is brought
_SHOWN = ("late_goals_per_robot_hour", "stuck", "waiting_share")


class Load(NamedTuple):
    """What a floor does with a number of robots."""

    robots: int
    episodes: int
    goals: Interval  # per hour, all robots together, in the second half of the episodes
    each: Interval  # per robot and hour, the same
    stuck: Interval  # share at the end
    waiting: Interval  # share of time
    jammed: bool


def loads(rows: Mapping[int, Sequence[Row]]) -> list[Load]:
    """Return what was measured for each number of robots, fewest first.

    A floor is jammed with so many robots where STUCK of them are stuck, or all together reach less than FELL of the
    most that fewer robots reached.
    """
    found: list[Load] = []
    for robots in sorted(rows):
        own = rows[robots]
        each, stuck, waiting = (MEASURES[name].interval(own) for name in _SHOWN)
        goals = each.times(robots)
        best = max((load.goals.mean for load in found), default=0.0)
        jammed = stuck.mean >= STUCK or goals.mean < FELL * best
        found.append(Load(robots, len(own), goals, each, stuck, waiting, jammed))
    return found


def bears(found: Sequence[Load]) -> int:
    """Return the most robots that were tried of those below the fewest that jam; 0 if the fewest do."""
    return max((load.robots for load in takewhile(lambda load: not load.jammed, found)), default=0)


def next_count(found: Sequence[Load], most: int) -> int | None:
    """Return the number of robots to try next, at most `most`; None where it is known closely enough.

    Twice as many while there is no jam, then the middle between the most without and the fewest with one. found: as
    `loads` gives them.
    """
    good = bears(found)
    jams = next((load.robots for load in found if load.jammed), None)
    if jams is None:
        following = 2 * good if good >= FIRST else FIRST
        return min(following, most) if good < most else None
    return None if jams - good <= max(1, CLOSE * good) else (good + jams) // 2


FEWEST = 3  # episodes of everything: with two an interval is three times as wide
MOST = 100  # of one number of robots, where there is time and nothing else to find out
ALONE = 4  # times as many of one robot alone, which are quick and vary much
KINDS: tuple[Kind, ...] = ("aisle", "one-way")
TRIED = 3  # changes of each kind that are driven at most, where there is time
CHOSEN_AT = 3  # bottlenecks, the worst ones, that changes are sought for
_GROWING = 0.4  # of the time, for the number of robots


@dataclass(frozen=True)
class Plan:
    """What is asked."""

    grid: GridMap
    planner: str
    seconds: float  # of an episode
    seed: int
    episodes: int | None  # of everything; None: what the clock allows
    most: int  # robots

    def trials(self, floor: str, grid: GridMap, robots: int, seeds: range) -> list[Trial]:
        """Return an episode for each seed."""
        return [Trial(floor, grid, robots, seed, self.seconds, self.planner) for seed in seeds]


class Effect(NamedTuple):
    """What a change of the floor brings, in pairs of episodes with the same seeds."""

    candidate: Candidate
    first: Interval  # goals per hour of all robots, by which it was chosen among others
    base: Interval  # goals per hour on the floor as it is, in the episodes of `goals`
    goals: Interval | None  # the difference in episodes of their own; None for what was not chosen
    waiting: Interval | None  # share of time, the same
    trip: Interval | None  # metres driven to a goal, the same


class Advice(NamedTuple):
    """All that was found out."""

    plan: Plan
    alone: Interval  # goals per hour of one robot
    loads: list[Load]
    bears: int
    stopped: bool  # the time was over before the number of robots was known closely
    floor: Floor  # where robots wait, as many as the floor bears
    visits: NDArray[np.float64]  # share of trips over each cell
    bottlenecks: list[Bottleneck]
    effects: list[Effect]


def advise(plan: Plan, drive: Drive, clock: Clock) -> Advice:
    """Find out everything, in the time that there is once a robot alone has driven, for which kernels may compile."""
    alone = drive(plan.trials(AS_IS, plan.grid, 1, range(plan.seed, plan.seed + ALONE * _few(plan))))
    clock.restart()
    rows, took, stopped = _grow(plan, drive, clock)
    trips = draw_trips(plan.grid, plan.seed)
    routes = plan_trips(plan.grid, trips)
    visits = passing(routes, plan.grid.shape)
    seen = _look(plan, rows, visits)
    flow = traffic(routes, plan.grid.shape)
    chosen = []
    most = _affordable(clock.left, took[seen.robots] / len(rows[seen.robots]))
    for kind in KINDS:
        cells = [place.cell for place in seen.worst[:CHOSEN_AT]]
        if kind == "aisle":
            options = [one for cell in cells for one in candidates.aisles(plan.grid, cell)]
        else:
            options = [one for cell in cells for one in candidates.one_ways(plan.grid, cell, flow)]
            options += candidates.alternating(plan.grid) if cells else []
        chosen += candidates.choose(options, trips, seen.robots, most)
    if not chosen and plan.episodes is None:
        _drive_more(plan, rows, took, drive, clock)
        seen = _look(plan, rows, visits)
    effects = _try(plan, chosen, seen.robots, drive, clock)
    each = loads({1: alone})[0].each
    return Advice(plan, each, seen.loads, bears(seen.loads), stopped, seen.floor, visits, seen.worst, effects)


class Seen(NamedTuple):
    """What rows tell: the loads, how many robots the floor bears, and where those wait, the worst places first."""

    loads: list[Load]
    robots: int
    floor: Floor
    worst: list[Bottleneck]


def _look(plan: Plan, rows: dict[int, list[Row]], visits: NDArray[np.float64]) -> Seen:
    found = loads(rows)
    count = bears(found) or found[0].robots
    floor = floor_of_notes(rows[count])
    worst = bottlenecks(plan.grid, floor.waiting, visits) if floor.waiting.any() else []
    return Seen(found, count, floor, worst)


def _drive_more(plan: Plan, rows: dict[int, list[Row]], took: dict[int, float], drive: Drive, clock: Clock) -> None:
    """Spend the time that is left on more episodes of the number of robots that the floor bears, and of the next."""
    while True:
        found = loads(rows)
        good = bears(found)
        near = [good] * (good > 0) + [load.robots for load in found if load.robots > good][:1]
        count = min(near, key=lambda robots: len(rows[robots]))
        if len(rows[count]) >= MOST or not clock.allows(took[count] / _few(plan)):
            return
        seed = plan.seed + len(rows[count])
        rows[count] += drive(plan.trials(AS_IS, plan.grid, count, range(seed, seed + 1)))


def _few(plan: Plan) -> int:
    return plan.episodes or FEWEST


def _affordable(left: float, took: float) -> int:
    """Return how many changes of each kind, 1 to TRIED, can be driven in the seconds that are left; took: an episode.

    Each is driven FEWEST times, and so is the floor as it is; then the best of each kind and the floor twice as often.
    """
    episodes = min(left / max(took, 1e-9), 1e9) / FEWEST
    return int(min(TRIED, max(1, (episodes - 3 - 2 * len(KINDS)) // len(KINDS))))


class Grown(NamedTuple):
    """Episodes by number of robots."""

    rows: dict[int, list[Row]]
    took: dict[int, float]  # [s] in all
    stopped: bool  # by the clock


def _grow(plan: Plan, drive: Drive, clock: Clock) -> Grown:
    """Drive FIRST robots, more until they jam, and numbers in between.

    A number that would take longer than its share of the time, by what the last one took, is not begun.
    """
    rows: dict[int, list[Row]] = {}
    took: dict[int, float] = {}
    last = FIRST
    count = next_count([], plan.most)
    while count is not None:
        if rows and not clock.allows(took[last] * (count / last) ** 1.5, _GROWING):
            return Grown(rows, took, True)
        begin = clock.spent
        seeds = range(plan.seed, plan.seed + _few(plan))
        rows[count] = drive(plan.trials(AS_IS, plan.grid, count, seeds))
        last, took[count] = count, clock.spent - begin
        count = next_count(loads(rows), plan.most)
    return Grown(rows, took, False)


def _try(plan: Plan, chosen: Sequence[Candidate], robots: int, drive: Drive, clock: Clock) -> list[Effect]:
    """Drive all changes, then the best of each kind again: with new seeds, for what it was chosen by flatters it.

    The effects are in the order of their kind, best first.
    """
    seed = plan.seed + ALONE * _few(plan)
    base, driven = _rounds(plan, chosen, robots, range(seed, seed + _few(plan)), drive, clock)
    firsts = [_goals(rows, base, robots) for rows in driven]
    order = sorted(range(len(chosen)), key=lambda k: (chosen[k].kind, -firsts[k].mean))
    best = [k for place, k in enumerate(order) if place == 0 or chosen[order[place - 1]].kind != chosen[k].kind]
    seed += _few(plan)
    most = plan.episodes or 1_000
    base, again = _rounds(plan, [chosen[k] for k in best], robots, range(seed, seed + most), drive, clock)
    found = dict(zip(best, again, strict=True))
    return [_effect(chosen[k], firsts[k], base, found.get(k), robots) for k in order]


def _rounds(
    plan: Plan, chosen: Sequence[Candidate], robots: int, seeds: range, drive: Drive, clock: Clock
) -> tuple[list[Row], list[list[Row]]]:
    """Drive the floor as it is and its changes, seed by seed while there is time, FEWEST at least; return the rows."""
    base: list[Row] = []
    driven: list[list[Row]] = [[] for _ in chosen]
    took = 0.0
    for done, seed in enumerate(seeds if chosen else ()):
        if done >= FEWEST and not clock.allows(took):
            break
        begin = clock.spent
        floors = [(AS_IS, plan.grid), *((one.text, one.grid) for one in chosen)]
        asked = [trial for name, grid in floors for trial in plan.trials(name, grid, robots, range(seed, seed + 1))]
        row, *rows = drive(asked)
        base.append(row)
        for own, one in zip(driven, rows, strict=True):
            own.append(one)
        took = clock.spent - begin
    return base, driven


def _effect(one: Candidate, first: Interval, base: Sequence[Row], rows: Sequence[Row] | None, robots: int) -> Effect:
    whole = mean_interval(map(_goals_of, base)).times(robots)
    if rows is None:
        return Effect(one, first, whole, None, None, None)
    waiting = paired(rows, base, lambda row: row["waiting_share"], ("seed",))
    trip = paired(rows, base, lambda row: row["path_length_m"], ("seed",))
    return Effect(one, first, whole, _goals(rows, base, robots), waiting, trip)


def _goals_of(row: Row) -> float | None:
    return row["goals_per_robot_hour"]  # type: ignore[no-any-return]


def _goals(rows: Sequence[Row], base: Sequence[Row], robots: int) -> Interval:
    """Return the paired difference of the goals per hour of all robots together."""
    return paired(rows, base, _goals_of, ("seed",)).times(robots)
