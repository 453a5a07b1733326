"""The comparisons of paper 002: ant colony fused with an improved potential field on 30 x 30 cells, and its walker."""

from __future__ import annotations

from train.tables.maps import clutter
from train.tables.papers import paper001
from train.tables.papers.avoidance import MOVING_OBSTACLE
from train.tables.papers.paper001 import BESIDE, IN_FRONT, LIGHT, WAREHOUSE, walker_claim, walker_settings
from train.tables.study import Claim, TableSetting, TableStudy, TableSystem
from warehouse_env.maps.grid_map import Cell

PAPER = "Paper 002 (about 2023), ant colony and improved artificial potential field for agricultural transport robots"
OURS, SHIPPED = "fusion_aco (paper)", "fusion_aco (shipped)"
WITH_POINT, NO_FIELD = "fusion_aco, intermediate point", "fusion_aco, no field"
TRADITIONAL, BACKTRACKING = "aco (1/d to next cell, ants die)", "aco (1/d to next cell)"
TO_GOAL = "aco (1/d to goal)"
CLASSICAL, REPAIRED = "apf", "apf_improved (002)"
SIZE, SHARES, MAPS = 30, (0.2, 0.3), 16
START: Cell = (0, 0)  # ditu.qishi = [1, 1]
GOAL: Cell = (29, 27)  # ditu.mubiao = [30, 28]
_RUNS = 6

# The paper prints 100 ants, beta 3, rho 0.5, Q 1; its alpha of 1.5 belongs to the fusion.
_PRINTED = {"ants": 100, "exponent": 3, "evaporation": 0.5, "strength": 1.0}
_FIELD = {"repulsion_gain": 0.3, "repulsion_reach": 2.0}
_DISTANCE = {"exponent": 1.0, "intermediate_point": False}
_POINT_ONLY, _DISTANCE_ONLY = "apf_improved, intermediate point only", "apf_improved, relative distance only"
STRONG_DISTANCE = f"{_DISTANCE_ONLY}, strong repulsion"

SYSTEMS = (
    TableSystem(OURS, "fusion_aco", {"dead_end": "die", "intermediate_point": True}),
    TableSystem(SHIPPED, "fusion_aco"),
    TableSystem(WITH_POINT, "fusion_aco", {"intermediate_point": True}),
    TableSystem(NO_FIELD, "fusion_aco", {"field_weight": 0.0}),
    TableSystem(TRADITIONAL, "aco", {"heuristic": "next_cell", "dead_end": "die", **_PRINTED}),
    TableSystem(BACKTRACKING, "aco", {"heuristic": "next_cell", **_PRINTED}),
    TableSystem(TO_GOAL, "aco", _PRINTED),
    TableSystem(REPAIRED, "apf_improved", {"exponent": 1.0, **_FIELD}),
    TableSystem("dijkstra", "dijkstra"),
)


def settings() -> tuple[TableSetting, ...]:
    """Return floors of 30 x 30 cells with random clutter, and the paper's start and goal."""
    return tuple(clutter(SIZE, share, MAPS, START, GOAL) for share in SHARES)


def _claims() -> tuple[Claim, ...]:
    """Return the four claims of the abstract, against the paper's traditional colony and against fairer ones."""
    return tuple(
        Claim(f"The fusion has {what} than a traditional colony {which}", ours, other, measure)
        for ours, other, which in (
            (OURS, TRADITIONAL, "with 1/d to the next cell, whose ants die at dead ends"),
            (SHIPPED, BACKTRACKING, "with 1/d to the next cell, whose ants step back"),
            (SHIPPED, TO_GOAL, "with 1/d to the goal, whose ants step back"),
        )
        for measure, what in (
            ("worst", "a shorter longest path"),
            ("best", "a shorter best path"),
            ("ms", "a shorter running time"),
            ("converged_at", "fewer iterations"),
        )
    )


STUDIES = (
    TableStudy(
        name="002_comparison", paper=PAPER, title="Paper 002: 30 x 30 cells from (1, 1) to (30, 28)", settings=settings,
        systems=SYSTEMS, runs=_RUNS,
        measures=("worst", "best", "ms", "converged_at", "mean", "gap", "turns", "optimal_share", "found_share"),
        claims=(
            *_claims(),
            Claim("The potential field in the heuristic shortens paths", SHIPPED, NO_FIELD, "mean"),
            Claim("The intermediate point in the field shortens paths", WITH_POINT, SHIPPED, "mean"),
        ),
        note="Our copy of the paper names these measures and says that the fusion is better in each, but its figures "
        "and the picture of its map are lost. It prints the size, start and goal; the floors here are random clutter "
        f"of 20% and 30% (our choice), {MAPS} maps each. A sample is a map. Only the fusion uses the paper's alpha of "
        "1.5; the fusion without field is a traditional colony with it.",
    ),
    TableStudy(
        name="002_walkers", paper=PAPER, title="Paper 002: the walker along the force and its two repairs",
        settings=walker_settings,
        systems=(
            TableSystem(CLASSICAL, "apf", _FIELD),
            TableSystem(_DISTANCE_ONLY, "apf_improved", {**_DISTANCE, **_FIELD}),
            TableSystem(_POINT_ONLY, "apf_improved", {"relative_distance": False, **_FIELD}),
            TableSystem(REPAIRED, "apf_improved", {"exponent": 1.0, **_FIELD}),
            TableSystem(paper001.STRONG_CLASSICAL, "apf", paper001.STRONG),
            TableSystem(STRONG_DISTANCE, "apf_improved", {**_DISTANCE, **paper001.STRONG}),
            TableSystem("dijkstra", "dijkstra"),
        ),
        runs=1, measures=paper001.WALKER_MEASURES,
        claims=(
            walker_claim(
                "The intermediate point leads out of local minima", _POINT_ONLY, CLASSICAL, IN_FRONT, LIGHT, WAREHOUSE
            ),
            walker_claim(
                "The relative distance makes goals beside obstacles reachable",
                STRONG_DISTANCE, paper001.STRONG_CLASSICAL, BESIDE,
            ),
            walker_claim(
                "Beyond the claim: it makes other goals reachable, too", _DISTANCE_ONLY, CLASSICAL, LIGHT, WAREHOUSE
            ),
        ),
        note="The paper prints no figures of the walker; the maps and the gain of 0.3 within 2 cells are ours. At that "
        "gain no shelf keeps a walker from a goal beside it; strong is a gain of 20 within 4 cells. A walk is the same "
        "in every run; its length includes detours.",
    ),
    MOVING_OBSTACLE,
)  # fmt: skip
