"""All planners over one set of maps, each as it is shipped: what a millisecond buys."""

from __future__ import annotations

from train.tables.benchmark.maps import make_map, make_tasks
from train.tables.study import Setting, Study, System, TableTask
from warehouse_env.planning import PLANNERS
from warehouse_env.planning.ants.system import AntSystem

NAME = "all_planners"
_MAPS = ("paper46", "narrow", "clutter20", "clutter35")
_TASKS = 20  # of each map
_RUNS = 3  # of each task

_FAMILIES = {
    "dijkstra": "exact search",
    "astar": "exact search",
    "astar_turns": "exact search",
    "theta_star": "any-angle search",
    "apf": "potential field",
    "apf_improved": "potential field",
    "pso": "swarm",
    "afsa": "swarm",
}


def family(planner: str) -> str:
    """Return the kind of a planner of PLANNERS, in a word or two."""
    made = PLANNERS[planner]
    if isinstance(made, type) and issubclass(made, AntSystem):
        return "ant colony"
    return _FAMILIES.get(planner, "other")


def settings() -> tuple[Setting, ...]:
    """Return the floors of 46 x 46 cells of the benchmark, each with the same random pairs of cells."""
    return tuple(
        Setting(name, tuple(TableTask(make_map(name), task.start, task.goal) for task in make_tasks(name, _TASKS, 0)))
        for name in _MAPS
    )


STUDIES = (
    Study(
        name=NAME,
        paper="all five papers, and the exact searches",
        title="All planners over one set of maps",
        settings=settings,
        systems=tuple(System(name, name) for name in PLANNERS),
        runs=_RUNS,
        measures=("found_share", "gap", "optimal_share", "turns", "line_length", "clearance", "converged_at", "ms"),
        note=f"Each planner with its shipped constants, on {_TASKS} random pairs of cells of each 46 x 46 floor, "
        f"{_RUNS} runs each: two warehouses, and 20% and 35% of random clutter. A sample is a pair. "
        "`shaa_acs` is a special case: its ants are led by a neural network's activity, which spreads from the goal "
        "around the shelves and so amounts to the true distance; they know the way beforehand.",
        pictured=("clutter20",),
    ),
)
