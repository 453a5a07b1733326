"""How many robots a floor bears: the policy that drives best there, the number that makes most, the knee, the jam.

What is chosen is measured again on seeds that had no part in the choice.
"""

from __future__ import annotations

from typing import NamedTuple

from train.advice import changes
from train.advice.aim import GOALS
from train.advice.curve import Load, jams_from, knee, loads, peak, rungs, smallest
from train.advice.race import FEWEST, mean
from train.advice.study import Crew, Study
from train.advice.trials import Plan, Use
from train.reporting.columns import MEASURES
from train.reporting.rows import Interval, paired
from warehouse_env.maps.grid_map import GridMap

SPARSE = 64  # free cells a robot, with which the search begins; the most goals are made with a few times as many robots
SCOUTS = 2  # episodes of a number of robots on the way up
ROUNDS = 8  # of a race, at most
STEADY = 4  # episodes of each number below the best, for the knee
CONFIRMED = 12  # episodes of what was chosen, with seeds of their own, where there is time
ALONE = 40  # episodes of one robot alone, which are quick and vary much; with orders they are long, and vary little
UNRACED = "the policies were raced"  # what the time may be over before
EASY = 0.75  # of what one alone makes, each: with so many robots nobody is in the way yet
OVER = 0.65  # of the time, when all this is
_UP, _POLICY, _LOAD, _KNEE, _CONFIRM, _JAM = 0.3, 0.4, 0.5, 0.52, 0.6, OVER  # when each of its parts is


class Versus(NamedTuple):
    """The chosen policy against another."""

    policy: str
    difference: Interval  # goals per hour of all robots, in pairs of episodes with seeds of their own


class Capacity(NamedTuple):
    """How many robots a floor bears."""

    crew: Crew  # the policy that drove best, and the fewest robots not told apart from those that make most
    goals: Load  # what they make, in episodes that had no part in the choice
    best: int  # robots that made most in the episodes by which it was chosen
    alone: Interval  # goals per hour of one robot
    loads: list[Load]  # of the policy, in the episodes by which it was chosen
    others: list[Versus]
    contacts: Interval  # a kilometre
    knee: Interval | None  # robots from which a further one brings less than half of what one alone does
    jam: Load | None
    stopped: list[str]  # what the time was over before


def begins_with(grid: GridMap, most: int) -> int:
    """Return the number of robots, a power of two, that the search begins with."""
    count = 1
    while 2 * count <= min(most, len(grid.free_cells) // SPARSE):
        count *= 2
    return count


def capacity(study: Study) -> Capacity:
    """Find out."""
    stopped = list[str]()
    _share_time(study, begins_with(study.plan.grid, study.plan.most))
    centre = _climb(study, stopped)
    _share_time(study, centre)
    crew = _choose_policy(study, centre, stopped)
    crew, best = _choose_load(study, crew, stopped)
    alone = _alone(study, crew.policy)
    _below(study, crew, alone)
    confirm(study, crew)
    others = _others(study, crew)
    jam = _jam(study, crew.policy, stopped)
    found = study.loads(crew.policy)
    fall = knee(found, alone, study.plan.seed)
    contacts = MEASURES["collisions_per_km"].interval(study.of(crew))
    return Capacity(crew, confirmed(study, crew), best, alone, found, others, contacts, fall, jam, stopped)


def _share_time(study: Study, robots: int) -> None:
    """Let the number have all of the time where the rest would not do for a single change with so many robots."""
    minutes = study.clock.minutes
    if minutes is not None and changes.LEAST * study.seconds(robots) > (1 - OVER) * 60 * minutes:
        study.stretch = 1 / OVER


def _climb(study: Study, stopped: list[str]) -> int:
    """Double the robots of the first policy until they make less, or halve them until more do; return the best."""
    plan = study.plan
    policy, number = plan.policies[0], begins_with(plan.grid, plan.most)
    while True:
        _scout(study, policy, number)
        found = study.loads(policy)
        best = peak(found)
        if best.robots < found[-1].robots or number == plan.most:
            break
        number = min(2 * number, plan.most)
        if not study.affords([Crew(policy, number)], plan.seeds(Use.CHOOSE, plan.at_most(SCOUTS)), _UP):
            stopped.append(f"{number} robots were tried")
            return best.robots
    while best.robots == found[0].robots > 1:
        _scout(study, policy, best.robots // 2)
        found = study.loads(policy)
        best = peak(found)
    return best.robots


def _scout(study: Study, policy: str, robots: int) -> None:
    study.rows([Crew(policy, robots)], study.plan.seeds(Use.CHOOSE, study.plan.at_most(SCOUTS)))


def _choose_policy(study: Study, robots: int, stopped: list[str]) -> Crew:
    """Race all policies with so many robots, and with half of them; return the best, with the better number."""
    crews = [Crew(policy, count) for policy in study.plan.policies for count in sorted({max(1, robots // 2), robots})]
    raced = study.race(crews, ROUNDS, _POLICY, lambda left: len({crew.policy for crew in left}) == 1)
    if raced.values[crews[0]]:
        return raced.best
    if len(study.plan.policies) > 1:
        stopped.append(UNRACED)
    return Crew(study.plan.policies[0], robots)


def _choose_load(study: Study, crew: Crew, stopped: list[str]) -> tuple[Crew, int]:
    """Race numbers around the best so far; return the fewest robots not told apart from the best, and those."""
    centre = crew.robots
    tried = set[int]()
    while True:
        tried.add(centre)
        jammed = {load.robots for load in study.loads(crew.policy) if load.jammed and load.robots != centre}
        counts = [one for one in rungs(max(1, centre // 2), min(2 * centre, study.plan.most)) if one not in jammed]
        raced = study.race([Crew(crew.policy, count) for count in counts], ROUNDS, _LOAD)
        best = raced.best.robots
        if not raced.values[raced.best]:
            if len(counts) > 1:
                stopped.append("numbers in between were tried")
            _scout(study, crew.policy, centre)
            return Crew(crew.policy, centre), centre
        if best not in (counts[0], counts[-1]) or best in tried:
            break
        centre = best
    means = {one.robots: mean(raced.values[one]) for one in raced.left}
    return Crew(crew.policy, smallest(means, list(means))), best


def alone_seeds(plan: Plan) -> range:
    """Return the seeds of one robot alone."""
    return plan.seeds(Use.ALONE, plan.at_most(ALONE if plan.aim is GOALS else STEADY))


def _alone(study: Study, policy: str) -> Interval:
    """Return what one robot makes."""
    (rows,) = study.rows([Crew(policy, 1)], alone_seeds(study.plan))
    return loads({1: rows}, study.plan.aim)[0].goals


def _below(study: Study, crew: Crew, alone: Interval) -> None:
    """Drive halves of the number until nobody is in the way, and what is in between, so that the knee is within."""
    plan, number = study.plan, crew.robots
    seeds = plan.seeds(Use.CHOOSE, plan.at_most(STEADY))
    while number > 1:
        number //= 2
        crews = [Crew(crew.policy, count) for count in rungs(number, 2 * number)]
        if not study.affords(crews, seeds, _KNEE):
            return
        (rows, *_) = study.rows(crews, seeds)
        if mean([plan.aim.made(row) for row in rows]) >= EASY * number * alone.mean:
            return


def confirm(study: Study, crew: Crew, episodes: int = CONFIRMED, share: float = _CONFIRM) -> None:
    """Drive a crew on seeds of their own, FEWEST times at least and as often as there is time for."""
    plan = study.plan
    done, most = 0, plan.at_most(episodes)
    while done < most:
        done = min(most, max(FEWEST, done + plan.processes))
        seeds = plan.seeds(Use.CONFIRM, done)
        if done > FEWEST and not study.affords([crew], seeds, share):
            return
        study.rows([crew], seeds)


def confirmed(study: Study, crew: Crew) -> Load:
    """Return what a crew made on seeds that had no part in the choice."""
    return next(load for load in study.loads(crew.policy, Use.CONFIRM) if load.robots == crew.robots)


def _others(study: Study, crew: Crew) -> list[Versus]:
    """Drive the other policies on the same seeds; return the differences."""
    plan, found = study.plan, list[Versus]()
    seeds = plan.seeds(Use.CONFIRM, confirmed(study, crew).episodes)
    for policy in plan.policies:
        other = Crew(policy, crew.robots)
        if policy == crew.policy or not study.affords([other], seeds, _JAM):
            continue
        mine, theirs = study.rows([crew, other], seeds)
        found.append(Versus(policy, paired(mine, theirs, plan.aim.made, ("seed",))))
    return found


def _jam(study: Study, policy: str, stopped: list[str]) -> Load | None:
    """Drive more robots, until they jam; then the numbers in between. Return the fewest that jam."""
    plan = study.plan
    seeds = plan.seeds(Use.CHOOSE, plan.at_most(FEWEST))
    while True:
        found = study.loads(policy)
        jam = jams_from(found)
        if jam is None:
            number = min(2 * found[-1].robots, plan.most)
        else:
            below = max((load.robots for load in found if load.robots < jam.robots), default=0)
            number = next((rung for rung in rungs(below + 1, jam.robots) if rung < jam.robots), jam.robots)
        crew = Crew(policy, number)
        if jam is not None and jam.robots == number and jam.episodes >= len(seeds):
            return jam
        if jam is None and number == found[-1].robots:
            return None
        if not study.affords([crew], seeds, _JAM):
            stopped.append("the number that jams was found")
            return jam
        study.rows([crew], seeds)
