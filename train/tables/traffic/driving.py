"""What routes made with a traffic cost map are worth when they are driven: episodes in the simulator."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

from train.evaluation.rollout import make_experiment
from train.evaluation.rollout import run as drive
from train.reporting.rows import Row
from train.tables.traffic.jobs import Piece, floor
from warehouse_env.config import EnvConfig
from warehouse_env.planning import Planner, make_planner
from warehouse_env.traffic.expected import WithCost, expected_traffic

DRIVEN = ("astar_turns", "pf_aco", "astar_turns, cost a cell", "astar_turns, cost a move", "pf_aco, cost a move")
DRIVEN_ROBOTS = (16, 32)
DRIVEN_PRICE = 4.0  # [cells] of detour that avoiding a conflict is worth
POLICY = "ppo"
SECONDS = 600.0  # of an episode


def measure_driving(job: Piece) -> Iterator[Row]:
    """Drive an episode with the shipped policy on routes of one system, and count what happens."""
    base = EnvConfig(layout=job.map, num_agents=job.robots)
    experiment = make_experiment(POLICY, base, 1, SECONDS, job.seed + job.number)
    (row,) = drive(experiment, planner=_driven_planner(job.map, job.system, job.robots))
    yield {name: value for name, value in row.items() if name not in ("config", "layout", "planner")} | {
        "system": job.system
    }


@cache
def _driven_planner(name: str, system: str, robots: int) -> Planner:
    planner, _, cost = system.partition(", cost a ")
    if not cost:
        return make_planner(planner)
    lanes = expected_traffic(floor(name), robots, DRIVEN_PRICE, directed=cost == "move")
    return WithCost(make_planner(planner), lanes)
