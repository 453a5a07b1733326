"""The course of an advice: how many robots, where they wait, which changes to try."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.advice import changes
from train.advice.capacity import Capacity, RobotsNeeded, begun, capacity, confirmed, robots_needed
from train.advice.changes import Effect
from train.advice.study import Team, TrialRuns
from train.advice.trials import AdvicePlan, Drive, TimeBudget, Use
from train.advice.trips import Bottleneck, bottlenecks, draw_trips, plan_trips, traffic
from train.evaluation.places import FloorNotes, floor_of_notes

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
    effects: list[Effect]
    sought: bool  # whether there was time for changes


def advise(plan: AdvicePlan, drive: Drive, clock: TimeBudget) -> Advice:
    """Find everything in the time given, which begins after the first episodes, since these may compile kernels."""
    study = begun(plan, drive, clock)
    trips = draw_trips(plan.grid, plan.seed)
    visits, moves, _ = traffic(plan_trips(plan.grid, trips), plan.grid.shape)
    found = capacity(study)
    answered = robots_needed(study, found, _ASKED) if plan.wanted is not None else None
    team = Team(found.team.policy, answered.robots if answered and answered.robots else found.team.robots)
    worst = _places(study, team, visits)[1]
    most = changes.affordable(clock.left, study.seconds(team.robots))
    chosen = changes.options(plan, worst, trips, moves, team.robots, most)
    if not chosen and plan.episodes is None:
        study.repeat([found.team], Use.CONFIRM, _MOST, 1.0)
        found = found._replace(goals=confirmed(study, found.team))
    effects = changes.effects(study, chosen, team)
    return Advice(plan, team, found, answered, *_places(study, team, visits), visits, effects, most > 0)


def _places(study: TrialRuns, team: Team, visits: NDArray[np.float64]) -> tuple[FloorNotes, list[Bottleneck]]:
    """Return where robots wait, and the bottlenecks."""
    floor = floor_of_notes(study.of(team))
    return floor, bottlenecks(study.plan.grid, floor.waiting, visits) if floor.waiting.any() else []
