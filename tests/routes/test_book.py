"""Test routes: smooth, clear of shelves, keeping right, planned once; a damaged plan table is ignored."""

from __future__ import annotations

import math
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from decimal import Context, Decimal
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.simulation.worlds import drawn
from warehouse_env.config import EnvConfig
from warehouse_env.errors import PlanError
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.maps.layouts import LAYOUTS, make_layout
from warehouse_env.planning import Plan, make_planner
from warehouse_env.routes import book as route_book
from warehouse_env.routes.book import RouteBook
from warehouse_env.routes.lanes import distance, resample
from warehouse_env.routes.many import known_plan
from warehouse_env.threads import set_num_threads

EAST, NORTH, WEST, SOUTH = 0.0, math.pi / 2, math.pi, -math.pi / 2


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give each test its own plan cache."""
    monkeypatch.setenv("WAREHOUSE_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache"


def book(grid: GridMap, planner: str = "astar", **settings: float) -> RouteBook:
    return RouteBook(grid, make_planner(planner), **settings)  # type: ignore[arg-type]


def shelf_distance(grid: GridMap, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance [m] of each point [K, 2] to the nearest shelf or rim, cell by cell."""
    solid = np.pad(grid.occupied[::-1], 1, constant_values=True)
    rows, columns = np.nonzero(solid)
    low = np.stack([columns - 1.0, rows - 1.0], -1)
    away = np.maximum(np.maximum(low - points[:, None], points[:, None] - low - 1.0), 0.0)
    return np.asarray(np.hypot(away[..., 0], away[..., 1]).min(axis=1))


def some_tasks(grid: GridMap, count: int) -> list[tuple[Cell, Cell]]:
    ends = np.concatenate([grid.picks, grid.stations])
    rng = np.random.default_rng(0)
    chosen = [rng.choice(len(ends), 2, replace=False) for _ in range(count)]
    return [(tuple(ends[a].tolist()), tuple(ends[b].tolist())) for a, b in chosen]


@pytest.mark.parametrize("name", LAYOUTS)
def test_routes_are_even_and_clear_of_shelves(name: str) -> None:
    grid = make_layout(name)
    known = book(grid)
    # half the robot's width is 0.3 m; scattered shelves and single lanes leave little more room
    nearest = {"single_lane": (0.42, 0.38), "random": (0.35, 0.33), "pillars": (0.35, 0.33)}.get(name, (0.43, 0.398))
    shortest = {"aisles": 0.37}.get(name, 0.40)  # bends into one-cell aisles have short chords
    for start, goal in some_tasks(grid, 12):
        route = known.route(start, goal).line
        assert route.dtype == np.float32
        np.testing.assert_allclose(route[[0, -1]], grid.centre([start, goal]), atol=1e-5)
        steps = np.hypot(*np.diff(route.astype(np.float64), axis=0).T)
        assert steps.max() < 0.56
        assert steps.min() > shortest
        points = route.astype(np.float64)
        assert shelf_distance(grid, points).min() > nearest[0]
        assert shelf_distance(grid, resample(points, 0.05)).min() > nearest[1]
        # about as long as the plan: smoothing shortens it, lanes lengthen it
        planned = np.hypot(*np.diff(grid.centre(known.cells(start, goal)), axis=0).T).sum()
        assert 0.85 * planned - 0.5 < steps.sum() < 1.1 * planned + 2.0


def aisle(width: int, length: int = 30) -> GridMap:
    return drawn(["#" * length, *["." * length] * width, "#" * length])


@pytest.mark.parametrize(("width", "from_wall"), [(2, 0.55), (3, 0.75)])
@pytest.mark.parametrize("upright", [False, True])
def test_opposite_routes_keep_right(width: int, from_wall: float, upright: bool) -> None:
    # The line is a quarter of the aisle's width from the right-hand wall, at least 0.55 m: robots of 0.6 m can pass.
    grid = aisle(width)
    near, far = (1 + width // 2, 1), (1 + width // 2, 28)
    if upright:
        grid = GridMap(grid.occupied.T.copy(), name="upright")
        near, far = near[::-1], far[::-1]
    known = book(grid)
    there, back = known.route(near, far).line.astype(np.float64), known.route(far, near).line.astype(np.float64)
    across, along = (0, 1) if upright else (1, 0)
    low, high = 1.0, 1.0 + width  # the aisle's walls
    first = there[np.abs(there[:, along] - 15.0) < 8.0][:, across]
    second = back[np.abs(back[:, along] - 15.0) < 8.0][:, across]
    # east has south to its right; upright, `near` is at the north end, and south has west to its right
    np.testing.assert_allclose(first, low + from_wall, atol=0.06)
    np.testing.assert_allclose(second, high - from_wall, atol=0.06)


def test_missing_path_is_a_plan_error_on_request() -> None:
    known = book(GridMap(np.array([[False, False, False, True, False]] * 3), name="drawn"))
    known.prepare([((0, 0), (0, 4), ()), ((0, 0), (0, 1), ()), ((0, 1), (0, 4), ())])
    assert known.route((0, 0), (0, 1)).cells.tolist() == [[0, 0], [0, 1]]
    with pytest.raises(PlanError, match=r"astar found no path from \(0, 0\) to \(0, 4\) on map 'drawn'"):
        known.route((0, 0), (0, 4))
    with pytest.raises(PlanError):
        known.route((0, 0), (0, 4), EAST)


# A single lane with a detour through the wide part, and a dead end.
LOOP = drawn(["............", ".##########.", "............", "............"])
DEAD_END = drawn(["############", "........####", "############"])


def test_robot_in_a_single_lane_continues_ahead() -> None:
    known = book(LOOP)
    start, goal = (0, 6), (0, 2)
    ahead, there = known.route(start, goal, EAST).line, known.route(start, goal, WEST).line
    assert ahead[1, 0] > 6.5 > there[1, 0]
    assert np.hypot(*np.diff(ahead, axis=0).T).sum() > 20.0  # round the block
    assert len(there) == 9
    np.testing.assert_array_equal(known.route(start, goal).line, there)  # no heading: the shortest
    np.testing.assert_array_equal(known.route(start, goal, 0.785).line, there)  # neither along nor across
    np.testing.assert_array_equal(known.route(start, goal, 0.3).line, ahead)  # nearly east


def test_robot_backs_out_of_a_dead_end() -> None:
    known = book(DEAD_END)
    route = known.route((1, 5), (1, 1), EAST).line
    np.testing.assert_array_equal(route, known.route((1, 5), (1, 1)).line)


@pytest.mark.parametrize(
    ("lines", "start", "goal"),
    [
        (("......", ".####.", "......"), (0, 1), (2, 2)),  # the first free cell is behind the robot
        (("...#####", "..##....", ".......#"), (2, 3), (1, 6)),  # without (2, 2) it is cut off
    ],
)
def test_first_free_cell_is_no_special_case(lines: tuple[str, ...], start: Cell, goal: Cell) -> None:
    grid = drawn(lines)
    route = book(grid).route(start, goal, EAST).line
    np.testing.assert_allclose(route[[0, -1]], grid.centre([start, goal]), atol=1e-5)


@dataclass
class Counting:
    """A* that counts its plans."""

    name: str = "counting"
    key: str = "counting(1)"
    plans: int = 0

    def plan(self, grid: GridMap, start: Cell, goal: Cell, rng: np.random.Generator) -> Plan:
        self.plans += 1
        return make_planner("astar").plan(grid, start, goal, rng)


def test_each_route_is_planned_once() -> None:
    planner, expected = Counting(), book(LOOP)
    known = RouteBook(LOOP, planner)
    tasks = [((0, 0), (3, 11)), ((2, 3), (0, 6)), ((3, 0), (0, 11))]
    for start, goal in tasks * 2:
        np.testing.assert_array_equal(known.route(start, goal).line, expected.route(start, goal).line)
    assert planner.plans == len(tasks)


def test_threads_share_a_route_book(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(route_book, "MEMORY", 1)  # so that each new route evicts another
    grid = make_layout("open")
    cells = [(int(r), int(c)) for r, c in grid.picks[:12]]
    pairs = [(start, goal) for start in cells for goal in cells if start != goal]
    alone, shared = (RouteBook(grid, make_planner("astar")) for _ in range(2))
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as pool:
            found = list(pool.map(lambda pair: shared.route(*pair), 10 * pairs))
    finally:
        sys.setswitchinterval(before)
    for pair, route in zip(10 * pairs, found, strict=True):
        np.testing.assert_array_equal(route.line, alone.route(*pair).line)
    assert len(shared._routes) == 1


def test_parallel_plans_equal_sequential_ones() -> None:
    grid = make_layout("paper46")
    rng = np.random.default_rng(8)
    ends = grid.free_cells[rng.integers(0, len(grid.free_cells), (12, 2))].tolist()
    tasks = [((a[0], a[1]), (b[0], b[1])) for a, b in ends]
    books = []
    for threads in (1, 2):
        set_num_threads(threads)
        try:
            routes_of = RouteBook(grid, make_planner("pf_aco", ants=10, iterations=8))
            routes_of.prepare([(*task, ()) for task in tasks])
            assert len(routes_of._routes) == (0 if threads == 1 else len(set(tasks)))
            books.append([routes_of.route(*task).line for task in tasks])
        finally:
            set_num_threads(2)
    for one, two in zip(*books, strict=True):
        np.testing.assert_array_equal(one, two)


ROOM = drawn(["........", ".##.##..", "........", ".##.##..", "........"])
PLACES = ROOM.endpoints[2]


@pytest.mark.parametrize("damage", [None, b"", b"no archive", "truncated"])
def test_plan_table_replaces_planning_unless_damaged(own_cache: Path, damage: object) -> None:
    planner = Counting()
    RouteBook(ROOM, planner).plan_all()
    assert planner.plans == len(PLACES) ** 2
    (file,) = own_cache.glob("plans-*.npz")
    if damage is not None:
        file.write_bytes(file.read_bytes()[:900] if damage == "truncated" else damage)  # type: ignore[arg-type]
        route_book._read.cache_clear()
    planner.plans, known, alone = 0, RouteBook(ROOM, planner), RouteBook(ROOM, make_planner("astar"))
    assert known.has_table == (damage is None)
    tasks = [(start, goal) for start in PLACES[:6] for goal in PLACES[-6:]]
    for task in tasks:
        np.testing.assert_array_equal(known.cells(*task), alone.cells(*task))
    assert planner.plans == (0 if damage is None else len(tasks))


def test_plan_table_belongs_to_one_planner_and_floor() -> None:
    RouteBook(ROOM, Counting()).plan_all()
    other = GridMap(ROOM.occupied, picks=ROOM.picks[1:], stations=ROOM.stations)
    assert not RouteBook(ROOM, Counting(key="counting(2)")).has_table
    assert not RouteBook(other, Counting()).has_table


def test_plan_table_handles_missing_paths_and_jumps() -> None:
    """A planner may find no path, or jump."""

    class Odd(Counting):
        def plan(self, grid: GridMap, start: Cell, goal: Cell, rng: np.random.Generator) -> Plan:
            found = super().plan(grid, start, goal, rng)
            if start == PLACES[0]:
                return found._replace(cells=found.cells[:0])
            return found._replace(cells=found.cells[[0, -1]]) if start == PLACES[1] else found

    known = RouteBook(ROOM, Odd())
    known.plan_all()
    with pytest.raises(PlanError):
        known.cells(PLACES[0], PLACES[-1])
    assert known.cells(PLACES[1], PLACES[-1]).tolist() == [list(PLACES[1]), list(PLACES[-1])]


def test_shipped_plan_table_equals_the_planner() -> None:
    """A changed planner needs a new table from `RouteBook.plan_all`."""
    grid = make_layout("paper46")
    known = RouteBook(grid, make_planner(EnvConfig.planner))
    assert known.has_table
    picks, stations, _ = grid.endpoints
    tasks = [(pick, station)[::way] for pick in picks[::57] for station in stations[::13] for way in (1, -1)]
    columns = grid.shape[1]
    kept = [(s, g) for s, g in tasks if len(known_plan(s[0] * columns + s[1], g[0] * columns + g[1], known._plans))]
    assert len(kept) > 10
    for task in kept:
        np.testing.assert_array_equal(known.cells(*task), known._plan(*task).cells)


@pytest.mark.parametrize(("x", "y"), [(1.3, 1.0), (-1.9, 1.55), (0.8, -2.45), (0.0, 0.0), (0.0, -0.1)])
def test_way_point_distances_are_correctly_rounded(x: float, y: float) -> None:
    exact = (Decimal(x) ** 2 + Decimal(y) ** 2).sqrt(Context(prec=60))
    assert distance(x, y) == float(exact)
