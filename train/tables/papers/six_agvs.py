"""Section 3.3 of paper 001: six AGVs, and what its rules for conflicts cost."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from train.tables.measures import ROUNDING, Figures
from train.tables.papers.fleet import ALONE, BODIES, BODIES_ALONE, SECONDS, drive_fleet
from train.tables.study import Claim, Setting, Study, System, TableTask, Verdict, published
from train.tables.verdicts import percent
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.layouts import make_layout

PRINTED, SAME_FLOOR = "as printed", "its floor, other tasks"
PAPER46, NARROW, DENSE = "paper46", "narrow", "narrow, 24 robots"
SIX = (PRINTED, SAME_FLOOR, PAPER46, NARROW)
OURS, PLANNED = "coordinator", "alone"
NO_ASIDE, NO_ROUTE = "coordinator, no step aside", "coordinator, no new route"
DRIVEN, DRIVEN_ALONE = "bodies, policy rules", "bodies, each alone"
LENGTH, TIME = (117.799, 119.6274), (27.2426, 28.0711)  # in print: alone, coordinated [m, s]
ROBOTS, DRAWS = 6, 24
_PRINT_ROUNDING = 1e-5  # relative

SIDE = 22  # columns, since cells 279, 301 and 323 of the paper are one below the other
_AISLES = ((0, 2), (4, 5), (7, 8), (10, 11), (13, 14), (16, 17), (19, 20))  # rows from, to
_CROSS_AISLES = ((4, 6), (9, 12), (16, 18))  # columns from, to

# AGV_0 to AGV_5: start, goal.
_TASKS: tuple[tuple[Cell, Cell], ...] = (
    ((16, 1), (19, 21)), ((4, 14), (14, 4)), ((21, 16), (6, 9)),
    ((16, 14), (4, 8)), ((16, 19), (20, 9)), ((7, 21), (20, 5)),
)  # fmt: skip


def printed_task() -> TableTask:
    """Return our reconstruction of the paper's floor and of its six tasks; see the study's note."""
    occupied = np.ones((SIDE, SIDE), dtype=np.bool_)
    for first, end in _AISLES:
        occupied[first:end] = False
    for first, end in _CROSS_AISLES:
        occupied[:, first:end] = False
    return _fleet(GridMap(occupied, name="six AGVs"), _TASKS)


def _fleet(grid: GridMap, tasks: Sequence[tuple[Cell, Cell]]) -> TableTask:
    return TableTask(grid, *tasks[0], others=tuple(tasks[1:]))


def _drawn(name: str, grid: GridMap, robots: int) -> Setting:
    """Return draws of tasks between endpoints, all of them different cells; starts two cells apart, room for bodies."""
    fleets = []
    for draw in range(DRAWS):
        order = np.random.default_rng([robots, draw]).permutation(len(grid.endpoints[2]))
        cells = [grid.endpoints[2][k] for k in order]
        starts: list[Cell] = []
        for row, column in cells:
            if all(max(abs(row - r), abs(column - c)) > 1 for r, c in starts) and len(starts) < robots:
                starts.append((row, column))
        goals = [cell for cell in cells if cell not in starts][:robots]
        fleets.append(_fleet(grid, list(zip(starts, goals, strict=True))))
    return Setting(name, tuple(fleets))


def settings() -> tuple[Setting, ...]:
    """Return the printed experiment, other tasks on its floor, on two of ours, and more robots than the paper has."""
    printed, narrow = printed_task(), make_layout("narrow")
    return (
        Setting(PRINTED, (printed,)),
        _drawn(SAME_FLOOR, printed.grid, ROBOTS),
        _drawn(PAPER46, make_layout("paper46"), ROBOTS),
        _drawn(NARROW, narrow, ROBOTS),
        _drawn(DENSE, narrow, 24),
    )


def cost_is_small(
    figures: Figures, ours: str, other: str, measure: str, most: float, settings: Sequence[str] = SIX
) -> Verdict:
    """Judge "`measure` of ours is at most `most` (relative) above other's": by the upper ends of the intervals.

    It holds if all are at most that, in part if some are. Only where both have a figure.
    """
    told = [(name, figures.relative(name, ours, other, measure)) for name in settings if figures.tasks(name, ours)]
    told = [(name, cost) for name, cost in told if math.isfinite(cost.mean)]
    most += _PRINT_ROUNDING + ROUNDING
    small = [cost.mean <= most and not cost.high > most for _, cost in told]
    why = "; ".join(f"{name}: {percent(cost)}" for name, cost in told)
    return Verdict.graded(small, why)


def resolves_all(figures: Figures, ours: str, settings: Sequence[str] = SIX) -> Verdict:
    """Judge "all arrive, and none touch": on every task of every setting, in part if so in some settings."""
    shares = {}
    for name in settings:
        rows = [row for task in figures.tasks(name, ours) for row in task]
        if rows:
            shares[name] = sum(row["success"] and not row["contacts"] for row in rows), len(rows)
    whole = [good == count for good, count in shares.values()]
    why = "; ".join(f"{name}: {good} of {count}" for name, (good, count) in shares.items())
    return Verdict.graded(whole, why)


def _claims() -> tuple[Claim, ...]:
    length, time = (after / before - 1 for before, after in (LENGTH, TIME))
    cost = partial(partial, cost_is_small, ours=OURS, other=PLANNED)
    resolves = partial(partial, resolves_all)
    fewer = "To step aside where that is quicker saves length over new routes alone"
    return (
        Claim("Its rules for conflicts cost six AGVs 1.5% of length", check=cost(measure="mean", most=length)),
        Claim("Its rules for conflicts cost six AGVs 3% of time", check=cost(measure="last", most=time)),
        Claim("Its rules resolve every conflict of six AGVs", check=resolves(ours=OURS)),
        Claim(fewer, OURS, NO_ASIDE, "mean", settings=(SAME_FLOOR, PAPER46, NARROW)),
        Claim(
            "Beyond the claim: they resolve every conflict of 24 robots in narrow aisles",
            check=resolves(ours=OURS, settings=(DENSE,)),
        ),
        Claim(
            "Beyond the claim: six bodies that see only what is near pay 3% of time at the most",
            check=cost(ours=DRIVEN, other=DRIVEN_ALONE, measure="last", most=time),
        ),
        Claim("Beyond the claim: six such bodies all arrive, and none touch", check=resolves(ours=DRIVEN)),
    )


SIX_AGVS = Study(
    name="001_six_agvs",
    paper="Han & He (2022), paths of several AGVs in an intelligent warehouse (in Chinese), 2095-2163(2022)05-0043-07",
    title="Section 3.3 of paper 001: six AGVs with its rules for conflicts",
    settings=settings,
    systems=(
        System(PLANNED, "astar_turns", mode=ALONE),
        System(OURS, "astar_turns", mode="coordinator"),
        System(NO_ASIDE, "astar_turns", mode="no step aside"),
        System(NO_ROUTE, "astar_turns", mode="no new route"),
        System("alone, routes by apf_aco", "apf_aco", mode=ALONE),
        System("coordinator, routes by apf_aco", "apf_aco", mode="coordinator"),
        System(DRIVEN_ALONE, "astar_turns", mode=BODIES_ALONE),
        System(DRIVEN, "astar_turns", mode=BODIES),
    ),
    runs=1,
    measures=("mean", "last", "contacts", "found_share"),
    published=published(
        ("mean", "last"),
        (
            (PRINTED, "without its rules", PLANNED, (LENGTH[0], TIME[0])),
            (PRINTED, "with its rules", OURS, (LENGTH[1], TIME[1])),
        ),
    ),
    claims=_claims(),
    note="The paper shows its floor as a picture only. Its text gives: cells 279, 301 and 323 one below the other, so "
    "22 columns; at step 9 AGV_0 and AGV_4 reach one cell (then 12.4142 and 3.4142 m before them), AGV_2 and AGV_5 "
    "meet head-on on another (11.8284 and 17.8284 m before them); 117.799 m for all, 27.2426 s for the last, which is "
    "AGV_5's length at 1 m/s. Floor and tasks of *as printed* were searched for until all of these come out with the "
    "routes of `astar_turns`, and what the rules cost, too: the print's 1.8284 m are AGV_5's two diagonals instead of "
    "two straight steps, and a wait of AGV_0 counted as a metre. About one in six of those with the other figures has "
    "it. So the first lines show that the rules can be read as they are here, and no more; whether they cost as little "
    f"elsewhere the other settings show, {DRAWS} draws of tasks each. Costs are judged where all arrived. Lengths on "
    "the grid hold waits, as the paper's do; those of bodies are metres driven. Contacts: pairs that touch on the "
    f"grid; touches of bodies, shelves included. Found: all arrived, bodies within {SECONDS:g} s; who has arrived "
    "stays. Bodies have the policy `rules`, together or each in a world of its own, where in aisles of one cell some "
    "do not arrive either.",
    experiment=drive_fleet,
)
