"""How many robots a floor supports: the best policy and number, the knee, the jam, and the fewest for a target.

Each choice is measured again on seeds that had no part in it.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from train.advice.curve import LoadPoint, bracket, fewest_that, jams_from, knee, loads, peak, rungs, smallest
from train.advice.study import Team, TrialRuns, best_of
from train.advice.trials import GOALS, AdvicePlan, Drive, TimeBudget, Use
from train.books import simulator_of
from train.evaluation.rollout import make_experiment
from train.kinds import Kinds
from train.reporting.columns import MEASURES, driven_with
from train.reporting.rows import Interval, mean_interval
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.errors import ConfigError
from warehouse_env.maps.fitting import fitted
from warehouse_env.maps.grid_map import GridMap

PROBES = 40  # seeds on which all robots must find a start
SPARSE = 4  # endpoints per robot of the default size; with fewer, some find no start
STEP = 0.9  # from one number that is tried to the next
MARGIN = 0.9  # of the number found, for other seeds


def for_kinds(grid: GridMap, kinds: Kinds) -> tuple[GridMap, tuple[str, ...]]:
    """Return the floor for a body that covers those of all kinds, and where that does not fit, a sentence each.

    So robots have the same tasks in any number and on every changed floor. ConfigError if no pick face or no station
    can be reached.
    """
    config = EnvConfig(**kinds.each())
    floor = grid.at_pace(max(robot.max_speed for robot in config.bodies))
    body = config.widest_body
    made, narrow = fitted(floor, body)
    if narrow and made is floor:
        who = f"bodies of {body.length:g} x {body.width:g} m"
        raise ConfigError(f"{who} reach no pick face or no station of {grid.name}; choose smaller ones")
    return made, narrow


def most_with_a_start(plan: AdvicePlan) -> int:
    """Return the most robots, up to `plan.most`, that find free starts with any seed."""
    body = RobotSpec() if plan.kinds is None else EnvConfig(**plan.kinds.each()).widest_body
    if plan.most * SPARSE * body.longer * body.wider <= len(plan.grid.endpoints[2]):
        return plan.most
    robots = plan.most
    while robots > 1 and not _start(plan, robots):  # from above, since failures are found quickly
        robots = int(STEP * robots)
    return robots if robots == plan.most else max(1, int(MARGIN * robots))


def _start(plan: AdvicePlan, robots: int) -> bool:
    """Return whether this many robots find a start on every seed tried."""
    env = EnvConfig(num_agents=robots, planner=plan.planner)
    config = make_experiment(plan.policies[0], env, 1, plan.seconds, plan.seed, plan.given(robots)).config
    try:
        simulator = simulator_of(config, 1, plan.grid)
        for seed in range(plan.seed, plan.seed + PROBES):
            simulator.reset([seed])
    except ConfigError:
        return False
    return True


FIRST = 8  # robots in the first search
SCOUTS = 2  # episodes of each number of robots, to find the best
ROUNDS = 8  # of a race, at most
STEADY = 4  # episodes of each number of robots, for the knee and the jam
CONFIRMED = 12  # episodes of the choice on new seeds, if there is time
ALONE = 40  # episodes of one robot alone, which are quick and vary much; with orders they are long and vary little
LOOKS = (4, 8, 12, 16)  # episodes of a number, until it is clear whether it reaches the target
ANSWERS = 12  # episodes on new seeds of a number that may be the answer
TRIES = 3  # of such numbers, at most
SURE = 1 - 0.05 / TRIES  # of each interval, so that all together hold with 95%
_UP, _POLICY, _LOAD, _CONFIRM, _CURVE = 0.3, 0.4, 0.5, 0.58, 0.65  # of the time, when each part ends


class Capacity(NamedTuple):
    """How many robots a floor supports."""

    team: Team  # the best policy, and the fewest robots not significantly worse than the best
    goals: LoadPoint  # their throughput on new seeds
    alone: Interval  # goals per hour of one robot
    loads: list[LoadPoint]  # of the policy, in the episodes of the choice
    raced: bool  # whether policies were compared
    contacts: Interval  # per kilometre
    knee: Interval | None  # number of robots above which one more adds less than half of the first
    jam: LoadPoint | None
    stopped: list[str]  # parts for which there was no time
    driven: str  # with what the policy drives, for notes


def begun(plan: AdvicePlan, drive: Drive, clock: TimeBudget) -> TrialRuns:
    """Drive robots alone and the first number of them, then start the clock."""
    study = TrialRuns(plan, drive, clock)
    first = [Team(policy, min(FIRST, plan.most)) for policy in plan.policies]
    study.rows([Team(policy, 1) for policy in plan.policies], alone_seeds(plan))
    study.rows(first, plan.seeds(Use.CHOOSE, plan.at_most(SCOUTS)))
    study.restart()
    study.rows(first, plan.seeds(Use.CHOOSE, SCOUTS, plan.at_most(SCOUTS)))
    return study


def capacity(study: TrialRuns) -> Capacity:
    """Find the policy, the number of robots, the knee and the jam."""
    stopped, first, most = list[str](), study.plan.policies[0], study.plan.most
    powers = [number for number in rungs(min(FIRST, most), most) if number & (number - 1) == 0 or number == most]
    if not _sweep(study, first, powers, SCOUTS, _UP):
        stopped.append("all numbers of robots were tried")
    team, raced = _choose_policy(study, peak(study.loads(first)).robots, stopped)
    team = _choose_load(study, team, stopped)
    (rows,) = study.rows([Team(team.policy, 1)], alone_seeds(study.plan))
    alone = loads({1: rows}, study.plan.aim)[0].goals
    study.repeat([team], Use.CONFIRM, CONFIRMED, _CONFIRM)
    below, above = rungs(1, team.robots)[::-1], rungs(team.robots, most)
    for numbers, what in ((below, "the numbers below were driven"), (above, "the number that jams was found")):
        if not _sweep(study, team.policy, numbers, STEADY, _CURVE, until_jam=True):
            stopped.append(what)
    found = study.loads(team.policy)
    fall = knee(found, alone, study.plan.seed)
    own = study.of(team)
    contacts, driven = MEASURES["collisions_per_km"].interval(own), driven_with(own)
    return Capacity(
        team, confirmed(study, team), alone, found, raced, contacts, fall, jams_from(found), stopped, driven
    )


def _sweep(
    study: TrialRuns, policy: str, numbers: Sequence[int], episodes: int, share: float, until_jam: bool = False
) -> bool:
    """Drive these numbers of robots until throughput falls or a jam occurs; return whether there was time."""
    seeds = study.plan.seeds(Use.CHOOSE, study.plan.at_most(episodes))
    for number in numbers:
        team = Team(policy, number)
        if not study.affords([team], seeds, share):
            return False
        study.rows([team], seeds)
        found = [load for load in study.loads(policy) if load.robots <= number]
        if peak(found).robots < number and (found[-1].jammed or not until_jam):
            break
    return True


def _choose_policy(study: TrialRuns, robots: int, stopped: list[str]) -> tuple[Team, bool]:
    """Race all policies with this number of robots and half of it; return the best, and whether there was a race."""
    policies, counts = study.plan.policies, sorted({max(1, robots // 2), robots})
    teams = [Team(policy, count) for policy in policies for count in counts]
    raced = study.race(teams, ROUNDS, _POLICY, lambda left: len({team.policy for team in left}) == 1)
    best = best_of(raced)
    if raced[best]:
        return best, True
    if len(policies) > 1:
        stopped.append("the policies were raced")
    return Team(policies[0], robots), False


def _choose_load(study: TrialRuns, team: Team, stopped: list[str]) -> Team:
    """Race numbers around the best so far; return the fewest robots not significantly worse than the best."""
    centre = team.robots
    tried = set[int]()
    while True:
        tried.add(centre)
        jammed = {load.robots for load in study.loads(team.policy) if load.jammed and load.robots != centre}
        counts = [one for one in rungs(max(1, centre // 2), min(2 * centre, study.plan.most)) if one not in jammed]
        raced = study.race([Team(team.policy, count) for count in counts], ROUNDS, _LOAD)
        best = best_of(raced).robots
        if not any(raced.values()):
            if len(counts) > 1:
                stopped.append("numbers in between were tried")
            study.rows([Team(team.policy, centre)], study.plan.seeds(Use.CHOOSE, study.plan.at_most(SCOUTS)))
            return Team(team.policy, centre)
        if best not in (counts[0], counts[-1]) or best in tried:
            break
        centre = best
    return Team(team.policy, smallest({one.robots: float(np.mean(values)) for one, values in raced.items()}))


def alone_seeds(plan: AdvicePlan) -> range:
    """Return the seeds of one robot alone."""
    return plan.seeds(Use.ALONE, plan.at_most(ALONE if plan.aim is GOALS else STEADY))


def confirmed(study: TrialRuns, team: Team) -> LoadPoint:
    """Return the load of a team on new seeds."""
    return next(load for load in study.loads(team.policy, Use.CONFIRM) if load.robots == team.robots)


class RobotsNeeded(NamedTuple):
    """The robots needed for a target."""

    wanted: float  # goals, or orders, per hour
    robots: int | None  # that surely reach it, None if no number does
    goals: Interval  # their result, at SURE; else that of the best number

    @property
    def possible(self) -> bool:
        """Whether the floor may allow it."""
        return not self.goals.high < self.wanted


def robots_needed(study: TrialRuns, capacity: Capacity, share: float) -> RobotsNeeded:
    """Return the fewest robots of the chosen policy that reach the plan's target, if the floor allows it."""
    plan, policy = study.plan, capacity.team.policy
    wanted = plan.wanted or 0.0
    none = RobotsNeeded(wanted, None, capacity.goals.goals)
    ends = bracket(capacity.loads, wanted)
    if ends is None:
        return none

    def reaches(robots: int) -> bool:
        team, made = Team(policy, robots), Interval(0.0, -math.inf, math.inf, 0)
        for episodes in LOOKS:
            seeds = plan.seeds(Use.ASK, plan.at_most(episodes))
            if not made.low < wanted <= made.high or not study.affords([team], seeds, share):
                break
            made = mean_interval(map(plan.aim.made, *study.rows([team], seeds)))
        return made.low >= wanted

    number = fewest_that(reaches, *ends)
    for _ in range(TRIES):
        (rows,) = study.rows([Team(policy, number)], plan.seeds(Use.ANSWER, plan.at_most(ANSWERS)))
        made = mean_interval(map(plan.aim.made, rows), SURE)
        if made.low >= wanted:
            return RobotsNeeded(wanted, number, made)
        number = min(plan.most, number + max(1, number // 16))
    return none
