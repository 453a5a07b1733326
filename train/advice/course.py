"""The course of an advice: how many robots, where they wait, which changes to try; each step from the rows before."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.advice import changes
from train.advice.asked import Asked, asked
from train.advice.candidates import Bottleneck, bottlenecks, draw_trips, passing, plan_trips, traffic
from train.advice.capacity import SCOUTS, Capacity, alone_seeds, begins_with, capacity, confirm, confirmed
from train.advice.changes import Effect
from train.advice.cost import expected
from train.advice.study import Crew, Study
from train.advice.trials import Clock, Drive, Plan, Use
from train.evaluation.places import Floor, floor_of_notes

_ASKED = 0.75  # of the time, when the goals that are asked for are answered
_MOST = 100  # episodes of the answer, where there is time and nothing else to find out

Say = Callable[[str], None]
"""Called with what is worth saying before the end."""


class Advice(NamedTuple):
    """All that was found out."""

    plan: Plan
    crew: Crew  # whose bottlenecks and changes are shown: the fewest that make what is asked for, else the most
    capacity: Capacity
    asked: Asked | None  # where a number of goals was asked for, or orders are given
    floor: Floor  # where those robots wait
    bottlenecks: list[Bottleneck]
    visits: NDArray[np.float64]  # share of trips over each cell
    effects: list[Effect]
    sought: bool  # whether there was time for changes
    rungs: int = 0  # of each ladder, that there was time for


def advise(plan: Plan, drive: Drive, clock: Clock, say: Say) -> Advice:
    """Find out everything, in the time that there is once robots alone have driven, for which kernels may compile.

    The number of robots comes first: where the time will not do for changes, it has all of it.
    """
    study = _begun(plan, drive, clock, say)
    trips = draw_trips(plan.grid, plan.seed)
    routes = plan_trips(plan.grid, trips)
    visits, flow = passing(routes, plan.grid.shape), traffic(routes, plan.grid.shape)
    found = capacity(study)
    answered = asked(study, found, _ASKED) if plan.wanted is not None else None
    crew = Crew(found.crew.policy, answered.robots if answered and answered.robots else found.crew.robots)
    worst = _places(study, crew, visits)[1]
    took, ladders = study.seconds(crew.robots), changes.ladders(plan)
    rungs = changes.affordable_rungs(clock.left, took, ladders)
    most = changes.affordable(clock.left, took, ladders * rungs)
    chosen = changes.options(plan, worst, trips, flow, crew, most, rungs)
    if not chosen and plan.episodes is None:
        confirm(study, found.crew, _MOST, 1.0)
        found = found._replace(goals=confirmed(study, found.crew))
    effects = changes.effects(plan, chosen, crew, drive, clock)
    return Advice(plan, crew, found, answered, *_places(study, crew, visits), visits, effects, most > 0, rungs)


def _begun(plan: Plan, drive: Drive, clock: Clock, say: Say) -> Study:
    """Drive what compiles, robots alone and the first number of them; then begin to count and say what to expect."""
    study = Study(plan, drive, clock)
    first = [Crew(policy, begins_with(plan.grid, plan.most)) for policy in plan.policies]
    study.rows([Crew(policy, 1) for policy in plan.policies], alone_seeds(plan))
    study.rows(first, plan.seeds(Use.CHOOSE, plan.at_most(SCOUTS)))
    study.restart()
    study.rows(first, plan.seeds(Use.CHOOSE, SCOUTS, plan.at_most(SCOUTS)))
    say(expected(study, clock.minutes))
    return study


def _places(study: Study, crew: Crew, visits: NDArray[np.float64]) -> tuple[Floor, list[Bottleneck]]:
    """Return where robots wait, and the worst places first."""
    floor = floor_of_notes(study.of(crew))
    return floor, bottlenecks(study.plan.grid, floor.waiting, visits) if floor.waiting.any() else []
