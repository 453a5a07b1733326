"""Table 1 of paper 001, and its claims on the potential field: the fusion with an ant colony on 20 x 20 cells."""

from __future__ import annotations

import math

import numpy as np

from train.tables.maps import clutter, draw_rectangle
from train.tables.papers.six_agvs import SIX_AGVS
from train.tables.study import OPEN, Claim, ClaimVerdict, TableSetting, TableStudy, TableSystem, TableTask, published
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import make_layout

PAPER = "Han & He (2022), paths of several AGVs in an intelligent warehouse (in Chinese), 2095-2163(2022)05-0043-07"
OURS, SHIPPED = "apf_aco (paper)", "apf_aco (shipped)"
TRADITIONAL, BACKTRACKING, SHARP = "aco (ants die)", "aco (ants step back)", "aco (ants step back, beta 7)"
NO_WOLVES, NO_FIELD = "apf_aco, no wolf-pack rule", "apf_aco, no repulsion"
CLASSICAL, REPAIRED = "apf", "apf_improved (001)"
STRONG_CLASSICAL, STRONG_REPAIRED = "apf, strong repulsion", "apf_improved (001), strong repulsion"
SIZE, SHARE, MAPS = 20, 0.4, 24
SCATTERED, IN_BLOCKS = "20x20 40%", "20x20 40% in blocks"
_RUNS = 8
_LARGEST_BLOCK = 4  # cells of a side
_TRIES = 1_000

# The constants that the paper prints for all colonies: rho = 0.4 and Q = 10; its eq. 15 deposits rho * Q / L.
_PRINTED = {"evaporation": 0.4, "strength": 4.0}
SYSTEMS = (
    TableSystem(OURS, "apf_aco", {"dead_end": "die"}),
    TableSystem(SHIPPED, "apf_aco"),
    TableSystem(TRADITIONAL, "aco", {"dead_end": "die", **_PRINTED}),
    TableSystem(BACKTRACKING, "aco", _PRINTED),
    TableSystem(SHARP, "aco", {"exponent": 7, **_PRINTED}),
    TableSystem(NO_WOLVES, "apf_aco", {"wolf_pack": 0.0}),
    TableSystem(NO_FIELD, "apf_aco", {"repulsion_gain": 0.0}),
    TableSystem(CLASSICAL, "apf"),
    TableSystem(REPAIRED, "apf_improved", {"intermediate_point": False}),
    TableSystem("astar_turns", "astar_turns"),
    TableSystem("dijkstra", "dijkstra"),
)
MEASURES = ("best", "mean", "gap", "converged_at", "turns", "ms", "optimal_share", "found_share")

# Length [cells], iterations, time [ms], turns.
_COLUMNS = ("best", "converged_at", "ms", "turns")
_TABLE_1 = (
    (SCATTERED, "traditional ant colony", TRADITIONAL, (43.6984, 35, 24_305.0, 11)),
    (SCATTERED, "improved potential field ant colony [11]", "", (40.8701, 21, 20_890.2, 9)),
    (SCATTERED, "this paper", OURS, (37.4558, 17, 18_193.8, 6)),
)


def block_task(seed: int) -> TableTask:
    """Return a 20 x 20 floor, 40% of it under rectangles of 1 to 4 cells a side, with a way from corner to corner."""
    for draw in range(_TRIES):
        occupied = _blocks(np.random.default_rng([SIZE, seed, draw]))
        grid = GridMap(occupied, name=f"blocks {SIZE}x{SIZE} {100 * SHARE:g}% no. {seed + 1}")
        if math.isfinite(float(grid.distance_to((SIZE - 1, SIZE - 1))[0, 0])):
            return TableTask(grid, (0, 0), (SIZE - 1, SIZE - 1))
    raise AssertionError("most draws leave a way")  # pragma: no cover


def _blocks(rng: np.random.Generator) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    """Return bool[20, 20]: random rectangles until the share is reached to the cell; the two corners stay free."""
    occupied = np.zeros((SIZE, SIZE), dtype=np.bool_)
    while (missing := round(SHARE * SIZE * SIZE) - int(occupied.sum())) > 0:
        block = np.zeros_like(occupied)
        block[draw_rectangle(rng, SIZE, 1, _LARGEST_BLOCK)] = True
        block[0, 0] = block[-1, -1] = False
        if int((block & ~occupied).sum()) <= missing:
            occupied |= block
    return occupied


def settings() -> tuple[TableSetting, ...]:
    """Return both readings of "obstacles placed at random, free to occupied cells as 6 to 4", from corner to corner."""
    return clutter(SIZE, SHARE, MAPS), TableSetting(IN_BLOCKS, tuple(block_task(seed) for seed in range(MAPS)))


def _claims() -> tuple[Claim, ...]:
    """Return the four percentages against several traditional colonies, then the parts, then what cannot be told."""
    rows = []
    for other, which in (
        (TRADITIONAL, "the traditional colony, whose ants die at dead ends"),
        (BACKTRACKING, "a traditional colony whose ants step back"),
        (SHARP, "a traditional colony whose ants step back, with the same exponent 7"),
    ):
        for measure, by, what in (
            ("mean", -0.14, "14% shorter paths than"),
            ("converged_at", -0.51, "51% fewer iterations to converge than"),
            ("ms", -0.25, "25% less time than"),
            ("turns", -0.45, "45% fewer turns than"),
        ):
            rows.append(Claim(f"{what} {which}", OURS if other == TRADITIONAL else SHIPPED, other, measure, by))
    return (
        *rows,
        Claim("The wolf-pack rule of eq. 17 speeds up convergence", SHIPPED, NO_WOLVES, "converged_at"),
        Claim("The improved repulsion in the heuristic shortens paths", SHIPPED, NO_FIELD, "mean"),
        Claim(
            "8% shorter, 19% fewer iterations, 12% less time, 33% fewer turns than the colony of reference [11]",
            check=lambda _: ClaimVerdict(
                OPEN, "the paper does not print that colony's equations, so it is not rebuilt"
            ),
        ),
    )


BESIDE, IN_FRONT, LIGHT, WAREHOUSE = "goal before a shelf", "shelf in between", "20x20 10%", "narrow"
STRONG = {"repulsion_gain": 20.0, "repulsion_reach": 4.0}


def walker_settings() -> tuple[TableSetting, ...]:
    """Return maps for a walker along the force: shelves behind the goal, across its path, scattered, in rows."""
    beside, between = [], []
    for column in range(2, 18):
        behind = np.zeros((SIZE, SIZE), dtype=np.bool_)
        behind[0, column] = True
        beside.append(TableTask(GridMap(behind, name=f"{BESIDE} {column}"), (18, column), (1, column)))
        wall = np.zeros((SIZE, SIZE), dtype=np.bool_)
        half = 1 + column % 6  # of the wall's width, so that the detours differ
        wall[10, max(0, column - half) : column + half + 1] = True
        between.append(TableTask(GridMap(wall, name=f"{IN_FRONT} {column}"), (18, column), (1, column)))
    grid = make_layout("narrow")
    pairs = np.random.default_rng(1).integers(0, len(grid.free_cells), (48, 2))
    cells = [(int(row), int(column)) for row, column in grid.free_cells]
    return (
        TableSetting(BESIDE, tuple(beside)),
        TableSetting(IN_FRONT, tuple(between)),
        clutter(SIZE, 0.1, 48),
        TableSetting(WAREHOUSE, tuple(TableTask(grid, cells[a], cells[b]) for a, b in pairs)),
    )


def walker_claim(text: str, ours: str, other: str, *settings: str) -> Claim:
    """Return the claim that one walker finds its goal more often than another in some settings."""
    return Claim(text, ours, other, "found_share", settings=settings)


WALKER_MEASURES = ("found_share", "gap", "turns", "clearance", "ms")
STUDIES = (
    TableStudy(
        name="001_table_1", paper=PAPER, title="Table 1 of paper 001: 20 x 20 cells, four tenths of them occupied",
        settings=settings, systems=SYSTEMS, runs=_RUNS, measures=MEASURES, published=published(_COLUMNS, _TABLE_1),
        claims=_claims(),
        note="The paper prints its one map as a picture and says: 20 x 20 cells, free to occupied as 6 to 4, obstacles "
        f"at random. There are two reconstructions of {MAPS} maps each, from corner to corner: single cells (one draw "
        "in eighteen leaves a path), and rectangles, since the paper's path has only 6 turns. Its lengths are those of "
        "grid paths (12, 14 and 14 straight and 18, 19 and 21 diagonal steps) on a map that differs from ours. A "
        "sample is a map. The paper's times are those of Python.",
    ),
    TableStudy(
        name="001_walkers", paper=PAPER,
        title="Section 2.1 of paper 001: repulsion that lets a walker reach its goal", settings=walker_settings,
        systems=(
            TableSystem(CLASSICAL, "apf"),
            TableSystem(REPAIRED, "apf_improved", {"intermediate_point": False}),
            TableSystem(STRONG_CLASSICAL, "apf", STRONG),
            TableSystem(STRONG_REPAIRED, "apf_improved", {"intermediate_point": False, **STRONG}),
            TableSystem("dijkstra", "dijkstra"),
        ),
        runs=1, measures=WALKER_MEASURES,
        claims=(
            walker_claim(
                "The improved repulsion makes goals beside obstacles reachable",
                STRONG_REPAIRED, STRONG_CLASSICAL, BESIDE,
            ),
            walker_claim(
                "Beyond the claim: it makes other goals reachable, too", REPAIRED, CLASSICAL, LIGHT, WAREHOUSE
            ),
        ),
        note="The paper has no table of the field alone; the maps are ours. Strong: gain 20 within 4 cells, so that "
        "one shelf cell behind the goal repels more than the goal attracts on the cell before it; with gain 1 no "
        "single shelf does. A walk is the same in every run.",
    ),
    SIX_AGVS,
)  # fmt: skip
