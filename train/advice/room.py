"""The room of a floor for robots: where their bodies fit, and how many find a start and a goal of their own."""

from __future__ import annotations

from train.advice.trials import AdvicePlan
from train.books import simulator_of
from train.evaluation.rollout import make_experiment
from train.kinds import Kinds
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.errors import ConfigError
from warehouse_env.maps.fitting import fitted
from warehouse_env.maps.grid_map import GridMap

PROBES = 40  # seeds on which all robots must find a start
SPARSE = 4  # endpoints a robot of the default size, from which on all find a start
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
