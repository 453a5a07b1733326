"""The table of routes that kernels read: the RouteBook's routes, however it grows."""

from __future__ import annotations

import numpy as np
import pytest

from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.errors import PlanError
from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.planning import make_planner
from warehouse_env.routes import route_table
from warehouse_env.routes.book import RouteBook
from warehouse_env.routes.route_table import key_of, slot_of


@kernel
def entry(start, goal, behind, cells, lines):  # type: ignore[no-untyped-def]
    """Return the key of a route, and where its way-points begin and how many there are; 0 if it is not known."""
    key = key_of(start, goal, behind, cells)
    slot = slot_of(key, lines.keys)
    return key, lines.begins[slot], lines.counts[slot] if lines.keys[slot] == key else 0


def keys_between(cells: int, lines: route_table.Lines) -> list[int]:
    return [entry(start, goal, 0, cells, lines)[0] for start in range(cells) for goal in range(cells)]


@pytest.mark.parametrize("robot", [None, RobotSpec()])
def test_it_holds_the_routes_of_the_cache_while_it_grows(robot: RobotSpec | None) -> None:
    grid = GridMap(np.zeros((6, 9), dtype=bool), name="empty")
    book = RouteBook(grid, make_planner("astar"), keep_right=EnvConfig.keep_right)
    table, cells = book.table(robot), grid.occupied.size
    keys = np.array(keys_between(cells, table.lines))
    for part in (keys[:1], keys[:700], keys):  # so that the arrays are replaced in between
        table.fill(part)
    assert table.count == len(keys) > route_table._SLOTS // 2
    for start, goal in np.random.default_rng(0).integers(0, cells, (40, 2)).tolist():
        _, first, count = entry(start, goal, 0, cells, table.lines)
        ends = () if robot is None else book.ends(divmod(goal, 9), robot)
        wanted = book.route(divmod(start, 9), divmod(goal, 9), None, ends).line
        np.testing.assert_array_equal(table.lines.points[first : first + count], wanted)
    assert table.longest == max(table.lines.counts)


def test_one_that_is_too_full_begins_anew_but_only_when_told(monkeypatch: pytest.MonkeyPatch) -> None:
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
    table.fill(np.array([0, -keys[8]]))  # no route, and one that a robot wants on its way
    assert (table.count, entry(0, 8, 0, 9, table.lines)[2]) == (1, table.longest)


def test_a_goal_without_a_path_is_named() -> None:
    grid = GridMap(np.array([[False, False, False, True, False]] * 3), name="split")
    book = RouteBook(grid, make_planner("astar"))
    table = book.table(None)
    with pytest.raises(PlanError, match=r"found no path from \(0, 0\) to \(0, 4\)"):
        table.fill(np.array([entry(0, 4, 0, 15, table.lines)[0]]))
