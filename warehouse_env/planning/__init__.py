"""Global planners: from a map, a start and a goal to a path of cells. A new planner is one line in PLANNERS.

Which to take when; `warehouse tables planners` has the figures (200 pairs of cells on each of five floors):

1. `astar_turns`: always a shortest path, with the fewest turns, 0.1 to 0.6 ms.
2. Floor heights: `astar_turns` with gentleness=10; the default `pf_aco` finds the same paths, 40 times slower.
3. A cost map, such as other robots' traffic: `astar_turns` is exact, every colony nearly.
4. Lines off the lattice: `theta_star`, 2.5 to 4.6% shorter, close to the shelves' corners.
5. Of the colonies `pf_aco`: optimal in 88 to 100% of the runs, never more than 0.21% longer in the mean, 8 to 46 ms.
   The ants of `shaa_acs` follow nearly the true distance. The others are for comparison.
"""

from collections.abc import Callable
from typing import Any

from warehouse_env import plugins
from warehouse_env.planning.ants.aco import Aco, ApfAco
from warehouse_env.planning.ants.acs import Acs, ShaaAcs
from warehouse_env.planning.ants.fusion_aco import FusionAco
from warehouse_env.planning.ants.iaco import Iaco
from warehouse_env.planning.ants.pf_aco import PfAco
from warehouse_env.planning.any_angle import ThetaStar
from warehouse_env.planning.base import BasePlanner
from warehouse_env.planning.field_walkers import Apf, ApfImproved
from warehouse_env.planning.graph_search import AStar, AStarTurns, Dijkstra, min_turns
from warehouse_env.planning.plan import Plan, Planner, climb, path_length, turns, validate
from warehouse_env.planning.swarms.fish_swarm import FishSwarm
from warehouse_env.planning.swarms.waypoints import ParticleSwarm

__all__ = [
    "PLANNERS", "BasePlanner", "Plan", "Planner", "add_planner", "climb", "make_planner", "min_turns", "path_length",
    "turns", "validate",
]  # fmt: skip

PLANNERS: dict[str, Callable[..., Planner]] = {
    "dijkstra": Dijkstra, "astar": AStar, "astar_turns": AStarTurns, "theta_star": ThetaStar, "apf": Apf,
    "apf_improved": ApfImproved, "aco": Aco, "pf_aco": PfAco, "apf_aco": ApfAco, "fusion_aco": FusionAco, "acs": Acs,
    "shaa_acs": ShaaAcs, "iaco": Iaco, "pso": ParticleSwarm, "afsa": FishSwarm,
}  # fmt: skip


_MEMBERS = ("plan(grid, start, goal, rng, cost=None)", "takes_cost", "name", "key")  # of a Planner


def add_planner(text: str) -> None:
    """Load a user's planner, "my_planner.py:Mine" or "module:Mine", into PLANNERS; ConfigError if it is none."""
    plugins.add(text, "planner", PLANNERS, _MEMBERS)


def make_planner(name: str, **parameters: Any) -> Planner:
    """Build a planner of PLANNERS; ConfigError for an unknown name, an unknown parameter or a bad value.

    The name may carry parameters, as in "pf_aco:ants=20,local_search=false". Values are JSON; words need no quotes.
    `parameters` override them.
    """
    planner: Planner = plugins.make(name, "planner", PLANNERS, parameters)
    plugins.check_has(name, "planner", planner, _MEMBERS)
    return planner
