"""Test goal poses and routes to them, Reeds-Shepp curves of known lengths, and the growing route table."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.simulation.worlds import drawn
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.errors import PlanError
from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.layouts import LAYOUTS, make_layout
from warehouse_env.planning import make_planner
from warehouse_env.routes import route_table
from warehouse_env.routes.book import RouteBook
from warehouse_env.routes.goals import Goal, face, facing
from warehouse_env.routes.reeds_shepp import SEGMENTS, TURNS, WORDS, distance, rolled, seen_from, word, wrapped
from warehouse_env.routes.route_table import behind_of, key_of, slot_of
from warehouse_env.simulation.physics.floor import floor_of
from warehouse_env.simulation.physics.footprint import body_touches_shelf
from warehouse_env.simulation.physics.geometry import body_of, grown
from warehouse_env.simulation.state import every_kind

ROBOT = RobotSpec()
FLOOR = drawn(["......", ".###..", "......", "......", "......"])


def test_robots_stand_parallel_to_a_shelf_in_both_headings() -> None:
    goal = face(FLOOR, (2, 2), ROBOT)  # south of the shelf, whose row is y = 3 to 4
    # the axle is 0.3 m ahead of the footprint's centre, which is the cell's: (2.5, 2.5)
    assert goal.poses == (pytest.approx((2.8, 2.5, 0.0)), pytest.approx((2.2, 2.5, -math.pi)))
    goal = face(FLOOR, (1, 4), ROBOT)  # east of it
    assert goal.poses == (pytest.approx((4.5, 3.8, math.pi / 2)), pytest.approx((4.5, 3.2, -math.pi / 2)))


def test_open_floor_has_no_pose_and_dead_ends_have_two() -> None:
    assert face(FLOOR, (3, 3), ROBOT) == Goal((3, 3))
    # in a dead end, robots stand along it although the end wall is beside them, too
    heads = [heading for _, _, heading in face(drawn(["####", "#...", "####"]), (1, 1), ROBOT).poses]
    assert heads == pytest.approx([0.0, -math.pi])


def test_goal_pose_continues_the_approach_direction() -> None:
    poses = face(FLOOR, (2, 2), ROBOT).poses
    assert facing(poses, np.array([(2, 5), (2, 4), (2, 3), (2, 2)]))[2] == pytest.approx(-math.pi)
    assert facing(poses, np.array([(2, 0), (2, 1), (2, 2)]))[2] == 0.0
    assert facing(poses, np.array([(4, 2), (3, 2), (2, 2)]))[2] == 0.0  # from the side: the first pose
    assert facing(poses, np.array([(2, 2)]))[2] == 0.0


def test_route_ends_at_its_goal_pose() -> None:
    book = RouteBook(FLOOR, make_planner("astar"))
    poses = face(FLOOR, (2, 2), ROBOT).poses
    there = book.route((2, 5), (2, 2), ends=poses)
    assert there.end == poses[1]
    np.testing.assert_allclose(there.line[-1], poses[1][:2], atol=1e-6)
    plain = book.route((2, 5), (2, 2))
    assert plain.end is None
    np.testing.assert_array_equal(plain.line[-1], np.array([2.5, 2.5], np.float32))
    assert book.route((2, 5), (2, 2), ends=poses) is there


@pytest.mark.parametrize("name", LAYOUTS)
def test_footprints_at_endpoints_clear_the_shelves(name: str) -> None:
    grid, config = make_layout(name), EnvConfig()
    p, floor = every_kind(config, grid.cell_size)[0], floor_of(grid, 1.0)
    many = 0
    for cell in grid.endpoints[2]:
        for x, y, heading in face(grid, cell, ROBOT).poses:
            many += 1
            c, s = np.float32(math.cos(heading)), np.float32(math.sin(heading))
            body = grown(body_of(np.float32(x), np.float32(y), c, s, p), np.float32(0.03))
            assert not body_touches_shelf(body, floor)
    assert many > 0 or name == "open"


@kernel
def entry(start, goal, behind, cells, lines):  # type: ignore[no-untyped-def]
    """Return a route's key and the start and count of its way-points; a count of 0 means unknown."""
    key = key_of(start, goal, behind, cells)
    slot = slot_of(key, lines.keys)
    return key, lines.begins[slot], lines.counts[slot] if lines.keys[slot] == key else 0


def keys_between(cells: int, lines: route_table.Lines) -> list[int]:
    return [entry(start, goal, 0, cells, lines)[0] for start in range(cells) for goal in range(cells)]


@pytest.mark.parametrize("robot", [None, RobotSpec()])
def test_growing_table_holds_the_cached_routes(robot: RobotSpec | None) -> None:
    grid = GridMap(np.zeros((6, 9), dtype=bool), name="empty")
    book = RouteBook(grid, make_planner("astar"), keep_right=EnvConfig.keep_right)
    table, cells = book.table(robot), grid.occupied.size
    keys = np.array(keys_between(cells, table.lines))
    for part in (keys[:1], keys[:700], keys):  # replaces the arrays in between
        table.fill(part)
    assert table.count == len(keys) > route_table._SLOTS // 2
    for start, goal in np.random.default_rng(0).integers(0, cells, (40, 2)).tolist():
        _, first, count = entry(start, goal, 0, cells, table.lines)
        ends = () if robot is None else book.ends(divmod(goal, 9), robot)
        wanted = book.route(divmod(start, 9), divmod(goal, 9), None, ends).line
        np.testing.assert_array_equal(table.lines.points[first : first + count], wanted)
    assert table.longest == max(table.lines.counts)


@pytest.mark.parametrize("planner", ["astar_turns", "astar"])
def test_bulk_routes_equal_single_routes(planner: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Cover routes from the plan table, off its endpoints, and in single lanes, one with a dead end."""
    monkeypatch.setenv("WAREHOUSE_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(route_table, "PART", 7)
    grid = drawn(["........", ".######.", ".#......", ".#.####.", "...#....", ".#.####.", "........"])
    book = RouteBook(grid, make_planner(planner))
    book.plan_all()
    table, tracked, (rows, columns) = book.table(None), list[int](), grid.shape

    def track(keys: Sequence[int]) -> Iterator[int]:
        for key in keys:
            tracked.append(key)
            yield key

    free = [tuple(cell) for cell in grid.free_cells.tolist()]
    wanted = set[int]()
    for (row, column), goal in itertools.product(free, free[::3]):
        for quarter in range(4):
            behind = behind_of(grid.closed, row, column, *goal, quarter * math.pi / 2)
            start, last = row * columns + column, goal[0] * columns + goal[1]
            wanted.add(int(entry(start, last, behind, rows * columns, table.lines)[0]))
    assert sum((key - 1) % 5 != 0 for key in wanted) > 100
    keys, found = np.array(sorted(wanted)), list[dict[int, bytes]]()
    for many, make_many in ((0, None), (len(keys) + 1, table._make_many), (1, table._make_many)):
        monkeypatch.setattr(route_table, "BULK", many)
        monkeypatch.setattr(table, "_make_many", make_many)
        table._clear()
        table.fill(keys[:1])  # replaces the arrays
        table.fill(keys, track)
        found.append(way_points_of(table))
    assert sorted(found[0]) == keys.tolist()
    assert found[0] == found[1] == found[2]
    assert sorted(tracked) == sorted(keys[1:].tolist() * 3)
    assert table.longest == max(table.lines.counts)


def way_points_of(table: route_table.RouteTable) -> dict[int, bytes]:
    """Return the way-points of each route by its key."""
    lines = table.lines
    return {
        int(lines.keys[slot]): lines.points[lines.begins[slot] : lines.begins[slot] + lines.counts[slot]].tobytes()
        for slot in table.slots[: table.count]
    }


def test_plan_table_gives_all_routes_between_endpoints(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("WAREHOUSE_CACHE_DIR", str(tmp_path))
    book = RouteBook(FLOOR, make_planner("astar"))
    book.make_all()
    assert book.table(None).count == 0  # no plan table yet
    book.plan_all()
    book.make_all()
    places = [row * 6 + column for row, column in FLOOR.endpoints[2]]
    keys = [entry(*pair, 0, 30, book.table(None).lines)[0] for pair in itertools.permutations(places, 2)]
    table = book.table(None)
    assert sorted(way_points_of(table)) == sorted(keys)
    monkeypatch.setattr(route_table, "BULK", 1)
    size = len(table.lines.keys), len(table.lines.points)
    off = [entry(start, goal, 0, 30, table.lines)[0] for start in (20, 21) for goal in places]
    for key in off:  # small fills
        table.fill(np.array([key]))
    assert {*off} <= {*way_points_of(table)}
    assert (len(table.lines.keys), len(table.lines.points)) == size


def test_trim_empties_an_overfull_table(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(route_table, "MOST", 20)
    grid = GridMap(np.zeros((3, 3), dtype=bool), name="empty")
    book = RouteBook(grid, make_planner("astar"))
    table = book.table(None)
    keys = np.array(keys_between(9, table.lines))
    table.fill(keys)
    assert table.count == 81
    table.trim()
    assert table.count == 0
    assert entry(0, 8, 0, 9, table.lines)[2] == 0
    table.fill(np.array([0, -keys[8]]))  # 0 is no key; negative keys come from driving robots
    assert (table.count, entry(0, 8, 0, 9, table.lines)[2]) == (1, table.longest)


def test_goal_without_a_path_is_named() -> None:
    grid = GridMap(np.array([[False, False, False, True, False]] * 3), name="split")
    book = RouteBook(grid, make_planner("astar"))
    table = book.table(None)
    with pytest.raises(PlanError, match=r"found no path from \(0, 0\) to \(0, 4\)"):
        table.fill(np.array([entry(0, 4, 0, 15, table.lines)[0]]))


PLACE = st.floats(-12.0, 12.0)
HEADING = st.floats(-7.0, 7.0)
RADIUS = st.floats(0.3, 5.0)
POSE = st.tuples(PLACE, PLACE, HEADING)


def end_of(lengths: tuple[float, ...], n: int, radius: float) -> tuple[float, float, float]:
    pose = (0.0, 0.0, 0.0)
    for k in range(SEGMENTS):
        pose = rolled(*pose, lengths[k], TURNS[n, k] / radius)
    return pose


@pytest.mark.parametrize(
    ("goal", "length"),
    [
        ((5.0, 0.0, 0.0), 5.0),
        ((-5.0, 0.0, 0.0), 5.0),
        ((1.0, 1.0, math.pi / 2), math.pi / 2),  # a quarter of a circle to the left
        ((-1.0, 1.0, -math.pi / 2), math.pi / 2),  # the same in reverse
        ((0.0, 2.0, math.pi), math.pi),
        ((0.0, 0.0, math.pi), math.pi),  # a turn on the spot by three arcs of pi / 3
        ((0.0, 0.0, 0.0), 0.0),
        ((11.0, 1.0, math.pi / 2), 10.0 + math.pi / 2),
    ],
)
def test_curves_have_known_lengths(goal: tuple[float, float, float], length: float) -> None:
    assert distance(*goal, 1.0) == pytest.approx(length, abs=1e-9)
    assert distance(3.0 * goal[0], 3.0 * goal[1], goal[2], 3.0) == pytest.approx(3.0 * length, abs=1e-8)


@given(PLACE, PLACE, HEADING, RADIUS)
def test_every_reeds_shepp_word_reaches_its_goal(ahead: float, left: float, turn: float, radius: float) -> None:
    lengths = []
    for n in range(WORDS):
        length, *parts = word(n, ahead, left, turn, radius)
        if math.isfinite(length):
            x, y, heading = end_of(tuple(parts), n, radius)
            assert (x, y) == (pytest.approx(ahead, abs=1e-5), pytest.approx(left, abs=1e-5))
            assert wrapped(heading - turn) == pytest.approx(0.0, abs=1e-5)
            assert length == pytest.approx(sum(map(abs, parts)))
            lengths.append(length)
    assert min(lengths) == distance(ahead, left, turn, radius)


@given(POSE, POSE, RADIUS)
def test_curve_length_is_invariant_under_mirror_and_reversal(
    a: tuple[float, float, float], b: tuple[float, float, float], radius: float
) -> None:
    there = distance(*seen_from(*a, *b), radius)
    assert there == pytest.approx(distance(*seen_from(*b, *a), radius), abs=1e-5)
    ahead, left, turn = seen_from(*a, *b)
    assert there == pytest.approx(distance(ahead, -left, -turn, radius), abs=1e-5)
    assert there == pytest.approx(distance(-ahead, left, -turn, radius), abs=1e-5)
    assert there >= math.hypot(ahead, left) - 1e-9
    assert there >= radius * abs(wrapped(turn)) - 1e-6
