"""How many robots a floor bears: the best policy there, the number that makes most, the knee, the jam.

The choice is measured again on seeds that had no part in it.
"""

from __future__ import annotations

from typing import NamedTuple

from train.advice.aim import GOALS
from train.advice.curve import LoadPoint, jams_from, knee, loads, peak, rungs, smallest
from train.advice.race import FEWEST, mean
from train.advice.study import Team, TrialRuns
from train.advice.trials import AdvicePlan, Use
from train.reporting.columns import MEASURES
from train.reporting.rows import Interval
from warehouse_env.maps.grid_map import GridMap

SPARSE = 64  # free cells a robot at which the search begins; the best number is usually a few times as large
SCOUTS = 2  # episodes of a number of robots on the way up
ROUNDS = 8  # of a race, at most
STEADY = 4  # episodes of each number below the best, for the knee
CONFIRMED = 12  # episodes of the choice on new seeds, if there is time
ALONE = 40  # episodes of one robot alone, which are quick and vary much; with orders they are long and vary little
EASY = 0.75  # of the throughput of one alone, each: so few robots do not hinder each other
_UP, _POLICY, _LOAD, _KNEE, _CONFIRM, _JAM = 0.3, 0.4, 0.5, 0.52, 0.6, 0.65  # of the time, when each part ends


class Capacity(NamedTuple):
    """How many robots a floor bears."""

    crew: Team  # the best policy, and the fewest robots not told apart from those that make most
    goals: LoadPoint  # what they make on new seeds
    alone: Interval  # goals per hour of one robot
    loads: list[LoadPoint]  # of the policy, in the episodes of the choice
    raced: bool  # whether policies were compared
    contacts: Interval  # per kilometre
    knee: Interval | None  # robots from which a further one adds less than half of the first
    jam: LoadPoint | None
    stopped: list[str]  # what the time was over before


def begins_with(grid: GridMap, most: int) -> int:
    """Return the number of robots at which the search begins, a power of two."""
    count = 1
    while 2 * count <= min(most, len(grid.free_cells) // SPARSE):
        count *= 2
    return count


def capacity(study: TrialRuns) -> Capacity:
    """Find the policy, the number of robots, the knee and the jam."""
    stopped = list[str]()
    centre = _climb(study, stopped)
    crew, raced = _choose_policy(study, centre, stopped)
    crew = _choose_load(study, crew, stopped)
    (rows,) = study.rows([Team(crew.policy, 1)], alone_seeds(study.plan))
    alone = loads({1: rows}, study.plan.aim)[0].goals
    _below(study, crew, alone)
    confirm(study, crew)
    jam = _jam(study, crew.policy, stopped)
    found = study.loads(crew.policy)
    fall = knee(found, alone, study.plan.seed)
    contacts = MEASURES["collisions_per_km"].interval(study.of(crew))
    return Capacity(crew, confirmed(study, crew), alone, found, raced, contacts, fall, jam, stopped)


def _climb(study: TrialRuns, stopped: list[str]) -> int:
    """Double the robots of the first policy until they make less, or halve them until they do; return the best."""
    plan = study.plan
    policy, number = plan.policies[0], begins_with(plan.grid, plan.most)
    while True:
        _scout(study, policy, number)
        found = study.loads(policy)
        best = peak(found)
        if best.robots < found[-1].robots or number == plan.most:
            break
        number = min(2 * number, plan.most)
        if not study.affords([Team(policy, number)], plan.seeds(Use.CHOOSE, plan.at_most(SCOUTS)), _UP):
            stopped.append(f"{number} robots were tried")
            return best.robots
    while best.robots == found[0].robots > 1:
        _scout(study, policy, best.robots // 2)
        found = study.loads(policy)
        best = peak(found)
    return best.robots


def _scout(study: TrialRuns, policy: str, robots: int) -> None:
    study.rows([Team(policy, robots)], study.plan.seeds(Use.CHOOSE, study.plan.at_most(SCOUTS)))


def _choose_policy(study: TrialRuns, robots: int, stopped: list[str]) -> tuple[Team, bool]:
    """Race all policies with this number of robots and half of it; return the best, and whether there was a race."""
    policies, counts = study.plan.policies, sorted({max(1, robots // 2), robots})
    crews = [Team(policy, count) for policy in policies for count in counts]
    raced = study.race(crews, ROUNDS, _POLICY, lambda left: len({crew.policy for crew in left}) == 1)
    if raced.values[crews[0]]:
        return raced.best, True
    if len(policies) > 1:
        stopped.append("the policies were raced")
    return Team(policies[0], robots), False


def _choose_load(study: TrialRuns, crew: Team, stopped: list[str]) -> Team:
    """Race numbers around the best so far; return the fewest robots not told apart from the best."""
    centre = crew.robots
    tried = set[int]()
    while True:
        tried.add(centre)
        jammed = {load.robots for load in study.loads(crew.policy) if load.jammed and load.robots != centre}
        counts = [one for one in rungs(max(1, centre // 2), min(2 * centre, study.plan.most)) if one not in jammed]
        raced = study.race([Team(crew.policy, count) for count in counts], ROUNDS, _LOAD)
        best = raced.best.robots
        if not raced.values[raced.best]:
            if len(counts) > 1:
                stopped.append("numbers in between were tried")
            _scout(study, crew.policy, centre)
            return Team(crew.policy, centre)
        if best not in (counts[0], counts[-1]) or best in tried:
            break
        centre = best
    means = {one.robots: mean(raced.values[one]) for one in raced.left}
    return Team(crew.policy, smallest(means, list(means)))


def alone_seeds(plan: AdvicePlan) -> range:
    """Return the seeds of one robot alone."""
    return plan.seeds(Use.ALONE, plan.at_most(ALONE if plan.aim is GOALS else STEADY))


def _below(study: TrialRuns, crew: Team, alone: Interval) -> None:
    """Halve the number until robots do not hinder each other, and drive the numbers between, to find the knee."""
    plan, number = study.plan, crew.robots
    seeds = plan.seeds(Use.CHOOSE, plan.at_most(STEADY))
    while number > 1:
        number //= 2
        crews = [Team(crew.policy, count) for count in rungs(number, 2 * number)]
        if not study.affords(crews, seeds, _KNEE):
            return
        (rows, *_) = study.rows(crews, seeds)
        if mean([plan.aim.made(row) for row in rows]) >= EASY * number * alone.mean:
            return


def confirm(study: TrialRuns, crew: Team, episodes: int = CONFIRMED, share: float = _CONFIRM) -> None:
    """Drive a crew on new seeds, at least FEWEST times and as often as there is time."""
    plan = study.plan
    done, most = 0, plan.at_most(episodes)
    while done < most:
        done = min(most, max(FEWEST, done + plan.processes))
        seeds = plan.seeds(Use.CONFIRM, done)
        if done > FEWEST and not study.affords([crew], seeds, share):
            return
        study.rows([crew], seeds)


def confirmed(study: TrialRuns, crew: Team) -> LoadPoint:
    """Return what a crew made on new seeds."""
    return next(load for load in study.loads(crew.policy, Use.CONFIRM) if load.robots == crew.robots)


def _jam(study: TrialRuns, policy: str, stopped: list[str]) -> LoadPoint | None:
    """Drive more robots until they jam, then the numbers between; return the fewest that jam."""
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
        crew = Team(policy, number)
        if jam is not None and jam.robots == number and jam.episodes >= len(seeds):
            return jam
        if jam is None and number == found[-1].robots:
            return None
        if not study.affords([crew], seeds, _JAM):
            stopped.append("the number that jams was found")
            return jam
        study.rows([crew], seeds)
