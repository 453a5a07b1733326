"""How many robots find a start on a floor: a small hall has few pick faces and stations, and these lie side by side."""

from __future__ import annotations

from train.advice.trials import Plan
from train.books import simulator_of
from train.evaluation.rollout import make_experiment
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError

PROBES = 40  # seeds on which all must find a start
SPARSE = 4  # endpoints a robot, from which on nobody has trouble with that
MARGIN = 0.9  # of what was found, for other seeds


def most_with_a_start(plan: Plan) -> int:
    """Return the most robots, up to `plan.most`, that find starts that touch nothing, whatever the seed."""
    if plan.most * SPARSE <= len(plan.grid.endpoints[2]):
        return plan.most
    if _start(plan, plan.most):
        return plan.most
    low, high = 1, plan.most  # low do find one, high do not
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if _start(plan, middle) else (low, middle)
    return max(1, int(MARGIN * low))


def _start(plan: Plan, robots: int) -> bool:
    """Return whether so many robots find a start on every seed that is tried."""
    env = EnvConfig(num_agents=robots, planner=plan.planner)
    config = make_experiment(plan.policies[0], env, 1, plan.seconds, plan.seed, plan.work).config
    try:
        simulator = simulator_of(config, 1, plan.grid)
        for seed in range(plan.seed, plan.seed + PROBES):
            simulator.reset([seed])
    except ConfigError:
        return False
    return True
