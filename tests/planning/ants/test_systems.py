"""Test the ant systems of the papers: equations against hand-computed numbers, and optimal paths."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.planning.ants.colonies import EAST, SOUTH, SOUTH_EAST, WEST, search, walked
from warehouse_env.maps.generators import random_floor
from warehouse_env.maps.grid_map import MOVES, GridMap
from warehouse_env.maps.layouts import make_layout
from warehouse_env.planning.ants.aco import Aco, AntSystem, ApfAco
from warehouse_env.planning.ants.acs import ShaaAcs, draw_towards_best, rise, settle
from warehouse_env.planning.ants.fusion_aco import FusionAco
from warehouse_env.planning.ants.iaco import Iaco, smooth
from warehouse_env.planning.ants.walks import make_floor
from warehouse_env.planning.plan import path_length, validate, validate_line

START = 0


@pytest.mark.parametrize(
    ("system", "ahead", "at_goal"),
    [
        (Aco(exponent=1), 1 / math.sqrt(13), 10),
        # Eq. 16: 13^(1/2) straight, 1 + 2 * 2^(1/2) down the field. Of the goal itself: 0.1 + 0.
        (ApfAco(), (math.sqrt(13) + 1 + 2 * math.sqrt(2)) ** -7, 0.1**-7),
        (Iaco(), (10 / math.sqrt(13)) ** 7, 100.0**7),  # eq. 7
    ],
    ids=("aco", "apf_aco", "iaco"),
)
def test_attraction_on_an_open_floor(system: AntSystem, ahead: float, at_goal: float) -> None:
    """Of (1, 1), sqrt(13) before the goal, and of the goal (3, 4), whose distance counts as 0.1."""
    grid = GridMap(np.zeros((4, 5), dtype=bool))
    turning, straight = system.colony(grid, make_floor(grid, (3, 4)), START).attraction(3)
    assert turning is straight
    assert turning[0, SOUTH_EAST] == pytest.approx(ahead)
    assert turning[2 * 5 + 3, SOUTH_EAST] == pytest.approx(at_goal)


def test_distance_heuristics_of_the_traditional_colony() -> None:
    grid = GridMap(np.zeros((4, 5), dtype=bool))
    floor = make_floor(grid, (3, 4))
    to_goal, _ = Aco(exponent=1).colony(grid, floor, START).attraction(0)
    assert to_goal[0, EAST] == pytest.approx(1 / math.sqrt(18))
    next_cell, _ = Aco(heuristic="next_cell").colony(grid, floor, START).attraction(7)
    assert next_cell[0, [EAST, SOUTH_EAST]] == pytest.approx([1, 1 / 2])  # (1/d)^2


@pytest.mark.parametrize(
    ("system", "kept", "strength"),
    [(Aco(), 0.9, 1.0), (FusionAco(), 0.5, 1.0), (Iaco(), 1 - 0.5 * math.exp(-3 / 400), 100.0)],
)
def test_pheromone_evaporates_and_all_ants_deposit(system: AntSystem, kept: float, strength: float) -> None:
    """Eq. 3 of paper 004, eqs. 7 to 9 of paper 002."""
    grid = GridMap(np.zeros((2, 3), dtype=bool))
    floor = make_floor(grid, (1, 2))
    colony = system.colony(grid, floor, 0)
    pheromone = colony.pheromone.copy()
    assert (pheromone == 1).all()
    colony.update(floor, 0, pheromone, walked(floor, [EAST, SOUTH_EAST], [EAST, EAST, SOUTH]), walked(floor))
    diagonal, straight = strength / (1 + math.sqrt(2)), strength / 3
    assert pheromone[0, EAST] == pytest.approx(kept + diagonal + straight)
    assert pheromone[1, SOUTH_EAST] == pytest.approx(kept + diagonal)
    assert pheromone[1, EAST] == pytest.approx(kept + straight)
    assert pheromone[4, WEST] == pytest.approx(kept)


def test_dying_ants_may_find_no_path() -> None:
    # A comb of dead ends: with one ant and one iteration, some seeds die in one.
    drawing = ("." * 9, "#.#.#.#.#", "#.#.#.#.#", "#.#.#.#..")
    grid = GridMap(np.array([[c == "#" for c in row] for row in drawing]))
    ants = {"ants": 1, "iterations": 1}
    dying = [search("aco", grid, (0, 0), (0, 8), seed, dead_end="die", **ants) for seed in range(30)]
    assert any(plan.found for plan in dying)
    assert not all(plan.found for plan in dying)
    assert all(search("aco", grid, (0, 0), (0, 8), seed, **ants).found for seed in range(30))


def test_heuristic_penalises_a_local_minimum() -> None:
    occupied = np.zeros((3, 7), dtype=bool)
    occupied[0:2, 4] = True
    grid = GridMap(occupied)
    floor = make_floor(grid, (0, 6))
    colony = ApfAco(repulsion_gain=0.0).colony(grid, floor, START)
    # Ways down from the west end on (0, 3), 3 cells before the goal: 3 + 4 * 3, from (0, 2) one more.
    assert colony.attraction(0)[0][2, EAST] == pytest.approx((3 + 12) ** -7)
    assert colony.attraction(0)[0][1, EAST] == pytest.approx((4 + 13) ** -7)


def test_update_eqs_15_and_17_by_hand() -> None:
    floor = make_floor(GridMap(np.zeros((2, 3), dtype=bool)), (1, 2))
    pheromone = np.ones((6, 8))
    short, long = [EAST, SOUTH_EAST], [EAST, EAST, SOUTH]
    walks = walked(floor, short, long, short)
    ApfAco()._update(floor, 0, pheromone, walks, walks)
    a, b = 4 / (1 + math.sqrt(2)), 4 / 3  # rho * Q / L
    assert pheromone[1, SOUTH_EAST] == pytest.approx(0.6 + 2 * a + 2 * (a - b))  # two ants as good as the best
    assert pheromone[1, EAST] == pytest.approx(0.6 + b - 1 * (a - b))
    assert pheromone[0, EAST] == pytest.approx(0.6 + 2 * a + b + 2 * (a - b) - (a - b))
    assert pheromone[4, WEST] == pytest.approx(0.6)


@pytest.mark.parametrize(("iteration", "fr"), [(0, 1.0), (25, 0.75), (99, 0.01)])
def test_heuristic_eqs_22_and_23(iteration: int, fr: float) -> None:
    grid = GridMap(np.zeros((4, 9), dtype=bool))
    colony = FusionAco().colony(grid, make_floor(grid, (1, 7)), START)
    turning, straight = colony.attraction(iteration)
    assert turning is straight
    cell = 9 + 3  # the goal lies 4 east
    assert turning[cell, EAST] == pytest.approx(math.exp(fr) / 3**3)
    assert turning[cell, WEST] == pytest.approx(math.exp(-fr) / 5**3)
    assert turning[cell, SOUTH_EAST] == pytest.approx(math.exp(fr * math.sqrt(0.5)) / 10**1.5)
    assert colony.trail_power == 1.5


def test_force_eqs_12_and_17_to_20_by_hand() -> None:
    occupied = np.zeros((3, 6), dtype=bool)
    occupied[2, 1] = True
    force = FusionAco().force(GridMap(occupied), (1, 4))
    # (1, 1), 3 before the goal, the shelf 1 below: it pushes up with 0.3 (1 - 1/2) * 3; the pull is 3 and
    # 1/2 * 0.3 (1 - 1/2)^2 more.
    assert force[1, 1] == pytest.approx((-0.45, 3 + 0.0375))
    assert force[1, 4] == pytest.approx((0, 0))


def wall() -> GridMap:
    occupied = np.zeros((6, 9), dtype=bool)
    occupied[2, 2:7] = True
    return GridMap(occupied)


def test_intermediate_point_turns_the_force_round_a_wall() -> None:
    grid, goal = wall(), (0, 4)
    bare = FusionAco(repulsion_gain=0.0).force(grid, goal)
    led = FusionAco(repulsion_gain=0.0, intermediate_point=True).force(grid, goal)
    # Stuck on (3, 4), the point beside the wall is (2, 1) or (2, 7), three columns away and one up.
    side = int(np.sign(led[3, 4, 1]))
    assert led[3, 4] == pytest.approx((-1, 3 * side))
    assert led[3, 4 + side] == pytest.approx((-1, 2 * side))
    assert bare[3, 4] == pytest.approx((-3, 0))
    np.testing.assert_array_equal(led[0], bare[0])
    cosine_to_the_side = MOVES[EAST if side > 0 else WEST] @ led[3, 4] / math.sqrt(10)
    assert cosine_to_the_side == pytest.approx(3 / math.sqrt(10))


def test_greed_of_equation_14() -> None:
    planner = Iaco()
    assert [planner.greedy_share(k) for k in range(20)] == [0.15] * 8 + [0.8] * 3 + [0.1] * 9


def test_evaporation_of_equation_9() -> None:
    scaled, printed = Iaco(), Iaco(schedule="printed", evaporation=5.0)
    assert scaled.evaporated(0) == pytest.approx(0.5 * math.exp(-3 / 400))
    assert scaled.evaporated(9) == pytest.approx(0.5 * math.exp(-0.75))
    assert scaled.evaporated(19) == pytest.approx(0.5 * math.exp(-3))
    assert [printed.evaporated(k) for k in range(3)] == pytest.approx([1.0, 5 * math.exp(-4), 5 * math.exp(-9)])


@pytest.mark.parametrize("norms", ["squared", "printed"])
@pytest.mark.parametrize("where", ["paper46", "random", "single_lane"])
def test_iaco_line_is_the_smoothed_path(where: str, norms: str) -> None:
    grid = make_layout(where)
    start, goal = (tuple(grid.free_cells[k].tolist()) for k in (10, -30))
    plan = search("iaco", grid, start, goal, norms=norms)
    assert plan.line is not None
    validate_line(grid, plan.line, start, goal, 0.35 - 1e-6)
    np.testing.assert_array_equal(plan.line, smooth(plan.cells, grid.occupied, power=2 if norms == "squared" else 1))
    assert plan.line_length < path_length(plan.cells)


DIAGONAL = 10.0 ** (1 - math.sqrt(2))


def open_floor(rows: int, columns: int) -> GridMap:
    return GridMap(np.zeros((rows, columns), dtype=bool))


def test_only_the_best_path_is_marked() -> None:
    floor = make_floor(open_floor(2, 3), (1, 2))
    pheromone = np.full((6, 8), 0.5)
    draw_towards_best(floor, pheromone, walked(floor, [EAST, SOUTH_EAST]), 0.1)
    marked = 0.9 * 0.5 + 0.1 / (1 + math.sqrt(2))
    assert pheromone[0, EAST] == pytest.approx(marked)
    assert pheromone[1, SOUTH_EAST] == pytest.approx(marked)
    assert (pheromone == 0.5).sum() == 46


def test_evaporation_rises_from_first_to_last_iteration() -> None:
    assert [ShaaAcs(iterations=4).evaporates(i) for i in range(4)] == pytest.approx([0.1, 0.2, 0.3, 0.4])
    assert ShaaAcs(iterations=1).evaporates(0) == 0.1


def states(grid: GridMap, goal: tuple[int, int], planner: ShaaAcs) -> np.ndarray:
    floor = make_floor(grid, goal)
    strongest = planner.excitation == "strongest"
    activity = settle(floor, planner.network_weights(floor), planner.decay, planner.source, strongest)
    return np.ldexp(activity.mantissa, activity.exponent.clip(-1000).astype(np.int32)).reshape(grid.shape)


@pytest.mark.parametrize("weights", ["length", "inverse"])
@pytest.mark.parametrize("excitation", ["strongest", "sum"])
def test_network_settles_at_its_fixed_point(weights: str, excitation: str) -> None:
    # Every state against its own equation, x = S / (A + S), by plain loops over the neighbours.
    grid = random_floor(9, 9, 0.2, 3)
    goal = tuple(grid.free_cells[0].tolist())
    x = states(grid, goal, ShaaAcs(weights=weights, excitation=excitation))
    near = {"length": DIAGONAL, "inverse": math.sqrt(0.5)}[weights]
    for row, column in grid.free_cells.tolist():
        arriving = [100.0] if (row, column) == goal else [0.0]
        for d_row in (-1, 0, 1):
            for d_column in (-1, 0, 1):
                to = (row + d_row, column + d_column)
                inside = 0 <= to[0] < 9 and 0 <= to[1] < 9
                if (
                    to != (row, column)
                    and inside
                    and not grid.occupied[[to[0], row, to[0]], [to[1], to[1], column]].any()
                ):
                    arriving.append((near if d_row and d_column else 1.0) * x[to])
        excited = max(arriving) if excitation == "strongest" else sum(arriving)
        assert x[row, column] == pytest.approx(excited / (10 + excited), rel=2e-3)


def test_activity_exceeds_the_range_of_floats() -> None:
    floor = make_floor(open_floor(1, 2000), (0, 0))
    for planner in (ShaaAcs(), ShaaAcs(excitation="sum")):
        activity = settle(floor, planner.network_weights(floor), 10.0, 100.0, planner.excitation == "strongest")
        assert activity.exponent[-1] < -6000
        ratio = rise(floor, activity)
        assert ratio[1500, 4] == pytest.approx(10.0, rel=0.02 if planner.excitation == "strongest" else 0.1)
    plan = ShaaAcs(ants=1, iterations=1).plan(open_floor(1, 2000), (0, 1999), (0, 0), np.random.default_rng(0))
    assert path_length(plan.cells) == 1999


@pytest.mark.parametrize("local_search", [True, False])
def test_shaa_acs_is_optimal_on_cluttered_floors(local_search: bool) -> None:
    for seed in range(6):
        grid = random_floor(40, 40, 0.3, seed)
        start, goal = (tuple(grid.free_cells[k].tolist()) for k in (0, -1))
        plan = ShaaAcs(local_search=local_search).plan(grid, start, goal, np.random.default_rng(seed))
        validate(grid, plan.cells, start, goal)
        assert path_length(plan.cells) == pytest.approx(grid.distance_to(goal)[start])
