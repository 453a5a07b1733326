"""Tables 1 and 2 of paper 000: the potential-field ant colony against the traditional one on a 46 x 46 warehouse."""

from __future__ import annotations

from functools import partial

from train.tables.study import Claim, Published, TableSetting, TableStudy, TableSystem, TableTask, published
from train.tables.verdicts import reaches_print
from warehouse_env.maps.grid_map import Cell
from warehouse_env.maps.layouts import NAMED_TASKS, make_layout

PAPER = "Wang & Xie (2024), potential field ant colony, doi 10.35633/inmateh-73-66"
PAPER_MODE, SHIPPED = "pf_aco (paper)", "pf_aco (shipped)"
GOAL, NEXT = "aco (1/d to goal)", "aco (1/d to next cell, dying)"
NO_GRADIENT = "pf_aco (paper, even start)"
_PF, _TRADITIONAL = "potential field ant colony", "traditional ant colony"
_RUNS = 100  # ten times the paper's ten, so that "the best of ten" has an interval

_PAPER = {"local_search": False, "patience": None}  # nothing of ours added
SYSTEMS = (
    TableSystem(PAPER_MODE, "pf_aco", _PAPER),
    TableSystem(SHIPPED, "pf_aco"),
    TableSystem(NO_GRADIENT, "pf_aco", {**_PAPER, "initial_boost": 1.0}),
    TableSystem(GOAL, "aco"),
    TableSystem(NEXT, "aco", {"heuristic": "next_cell", "dead_end": "die"}),
    TableSystem("astar_turns", "astar_turns"),
    TableSystem("dijkstra", "dijkstra"),
)
MEASURES = (
    "best_of_10", "best_of_10_turns", "best_of_10_converged_at", "mean", "turns", "converged_at", "optimal_share",
    "found_share", "ms",
)  # fmt: skip
# Length, turns and convergence of each path, of the potential field colony and of the traditional one.
_TABLE_1 = {
    "path 1": ((26.9706, 6, 76), (28.7872, 15, 90)),
    "path 2": ((26.3848, 8, 77), (29.0018, 16, 91)),
    "path 3": ((27.5563, 8, 79), (29.7441, 13, 90)),
    "path 4": ((26.6820, 6, 75), (28.3184, 15, 92)),
}
_TABLE_2 = {
    "path 1": ((59.4264, 18, 85), (65.8400, 36, 101)),
    "path 2": ((62.5980, 18, 88), (66.2972, 39, 106)),
}
# No path on a grid is 26.6820 long. This task has the next shorter length on our map, 11 + 11 sqrt 2.
_PATH_4: tuple[Cell, Cell] = ((1, 0), (13, 21))
_RECONSTRUCTION = (
    "The map and the tasks are reconstructions, since the paper prints the map only as a picture. `paper46` has its "
    "size and four zones, and tasks whose shortest lengths are those printed for the potential field colony. "
)
_BASELINES = (
    "The paper does not define its traditional colony: its text describes 1/d to the next cell; 1/d to the goal is the "
    "stronger baseline. The paper prints the best of 10 runs; ours is the mean of that over all groups of 10 runs. "
)


def _published(table: dict[str, tuple[tuple[float, int, int], tuple[float, int, int]]]) -> tuple[Published, ...]:
    lines = (
        (setting, *system, line)
        for setting, both in table.items()
        for system, line in zip(((_PF, PAPER_MODE), (_TRADITIONAL, NEXT)), both, strict=True)
    )
    return published(MEASURES[:3], lines)


def _claims(printed: tuple[Published, ...], length: float, turned: float, converged: float) -> tuple[Claim, ...]:
    """Return the claims of a table; the claimed sizes are the least relative gains of its lines."""
    rows = []
    for other, which in ((GOAL, "with 1/d to the goal"), (NEXT, "with 1/d to the next cell")):
        for measure, by, what in (
            ("best_of_10", length, "is shorter"),
            ("best_of_10_turns", turned, "has fewer turns"),
            ("best_of_10_converged_at", converged, "is found in an earlier iteration"),
        ):
            text = f"The best path {what} (by {-100 * by:.0f}% or more) than that of a traditional colony {which}"
            rows.append(Claim(text, PAPER_MODE, other, measure, by))
    start = "The gradient of the initial pheromone greatly reduces the iterations (no figure given)"
    rows.append(Claim(start, PAPER_MODE, NO_GRADIENT, "converged_at"))
    reach = "Our potential field colony, as in the paper, reaches or beats every figure that the paper prints for it"
    return (*rows, Claim(reach, check=partial(reaches_print, published=printed, ours=PAPER_MODE)))


def _settings(*tasks: str | tuple[Cell, Cell]) -> tuple[TableSetting, ...]:
    """Return "path 1", "path 2" and so on: named tasks of paper46, or a start and a goal there."""
    grid, named = make_layout("paper46"), NAMED_TASKS["paper46"]
    ends = [(named[task].start, named[task].goal) if isinstance(task, str) else task for task in tasks]
    return tuple(TableSetting(f"path {k}", (TableTask(grid, *one),)) for k, one in enumerate(ends, start=1))


def in_zone() -> tuple[TableSetting, ...]:
    """Return the four tasks within a zone, in the order of table 1."""
    return _settings("in_zone_2", "in_zone_1", "in_zone_3", _PATH_4)


def cross_zone() -> tuple[TableSetting, ...]:
    """Return the two tasks across zones, in the order of table 2."""
    return _settings("cross_zone_1", "cross_zone_2")


_table = partial(TableStudy, paper=PAPER, systems=SYSTEMS, runs=_RUNS, measures=MEASURES)
STUDIES = (
    _table(
        name="000_table_1", title="Table 1 of paper 000: paths within a zone of the warehouse", settings=in_zone,
        published=_published(_TABLE_1), claims=_claims(_published(_TABLE_1), -0.058, -0.38, -0.12),
        note=_RECONSTRUCTION + "The printed 26.6820 of path 4 is no length on a grid; our task has 26.5563, the next "
        "shorter length between two cells of one zone. " + _BASELINES,
    ),
    _table(
        name="000_table_2", title="Table 2 of paper 000: paths across the zones of the warehouse", settings=cross_zone,
        published=_published(_TABLE_2), claims=_claims(_published(_TABLE_2), -0.055, -0.5, -0.158),
        note=_RECONSTRUCTION + _BASELINES + "The printed convergences of the traditional colony, 101 and 106, exceed "
        "our 100 iterations; the paper does not print its number of iterations.",
    ),
)  # fmt: skip
