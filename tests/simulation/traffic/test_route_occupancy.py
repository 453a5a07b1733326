"""The table of who stands and passes where, kept up as robots drive; the cheapest way by it, as in a textbook."""

from __future__ import annotations

import heapq
import itertools
import math
from collections import Counter
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from tests.simulation.traffic.test_live import crowd, prices_of
from tests.simulation.worlds import write
from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import MOVES
from warehouse_env.planning.cost_to_go import UNREACHABLE, octile
from warehouse_env.simulation.state import PERSON, ROBOT
from warehouse_env.simulation.traffic import route_occupancy
from warehouse_env.simulation.traffic.prices import ANY, ReplanQuery
from warehouse_env.simulation.traffic.replan_search import TURNS, Labels, make_labels, search

ROWS, COLUMNS, SLOTS, ROBOTS = 9, 11, 16, 5
NOBODY_WALKS, ON_NOTHING = np.zeros((2, 0), PERSON), np.zeros((2, 0), np.int32)
SITE = route_occupancy.Site(np.float32(1.0), ROWS, COLUMNS, 6.0, np.full(ROBOTS, 0.2, np.float32))


def listed(table: route_occupancy.RouteOccupancy, world: int) -> Counter[tuple[int, int, int, int]]:
    """(cell, robot, way-points from its first one ahead, move back) of all that is listed, in any order."""
    found: Counter[tuple[int, int, int, int]] = Counter()
    for cell, first in enumerate(table.first[world]):
        slot, before = first, route_occupancy.NOTHING
        while slot != route_occupancy.NOTHING:
            robot = slot // SLOTS
            assert table.cell[world, slot] == cell
            assert table.before[world, slot] == before
            ahead = (slot % SLOTS - table.low[world, robot]) % SLOTS
            found[cell, int(robot), int(ahead), int(table.back[world, slot])] += 1
            slot, before = table.after[world, slot], slot
    return found


def new_route(rng: np.random.Generator, robots: Any, routes: Any, i: int) -> None:
    points = int(rng.integers(1, routes.shape[1] + 1))
    line = np.cumsum(rng.normal(0.0, 0.4, (points, 2)), axis=0) + rng.uniform(0, 9, 2)
    routes[i, :points] = np.clip(line, 0.1, (COLUMNS - 0.1, ROWS - 0.1))
    write(robots[i], points=points, spacing=0.5, position=0.0)


def test_the_nearest_move_of_a_direction() -> None:
    for row, column in itertools.product(range(-9, 10), repeat=2):
        assert route_occupancy.eighth(row, column) == round(math.atan2(-row, column) / (math.pi / 4)) % 8, (row, column)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6))
def test_a_table_that_is_kept_up_says_what_a_new_one_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    users = route_occupancy.RoadUsers(
        np.zeros((2, ROBOTS), ROBOT), np.zeros((2, ROBOTS, 40, 2), np.float32), NOBODY_WALKS, ON_NOTHING
    )
    robots, routes = users.robots[1], users.routes[1]
    robots["task"]["alive"] = 1
    kept = route_occupancy.make_occupancy(2, ROBOTS, ROWS * COLUMNS, SLOTS)
    for i in range(ROBOTS):
        new_route(rng, robots, routes, i)
    for step in range(20):
        for i, r in enumerate(robots):
            chance = rng.random()
            if chance < 0.1:
                route_occupancy.forget_route(kept, 1, i)
                new_route(rng, robots, routes, i)
            r["on_route"]["position"] = np.clip(
                r["on_route"]["position"] + rng.normal(0.4, 0.8), 0.0, max(r["on_route"]["points"] - 1, 0) * 0.5
            )
            write(r, x=rng.uniform(0, COLUMNS), y=rng.uniform(0, ROWS), cos=1.0, standing_time=rng.uniform(0.0, 12.0))
            r["task"]["alive"] = rng.random() < 0.9
        route_occupancy.keep_all_up(kept, 1, step, users, SITE)
        new = route_occupancy.make_occupancy(2, ROBOTS, ROWS * COLUMNS, SLOTS)
        route_occupancy.keep_all_up(new, 1, step, users, SITE)
        assert listed(kept, 1) == listed(new, 1)
        np.testing.assert_array_equal(kept.standing, new.standing)
        np.testing.assert_array_equal(kept.stands_on, new.stands_on)
        assert not listed(kept, 0)


def test_what_is_listed_by_hand() -> None:
    robots, routes = np.zeros((1, 1), ROBOT), np.zeros((1, 1, 40, 2), np.float32)
    write(robots, alive=1, points=7, spacing=0.5, position=0.6)
    routes[0, 0, :7, 0], routes[0, 0, :7, 1] = 0.25 + 0.5 * np.arange(7), 8.5  # along the first row, two points a cell
    table = route_occupancy.make_occupancy(1, 1, ROWS * COLUMNS, SLOTS)
    route_occupancy.keep_all_up(table, 0, 0, route_occupancy.RoadUsers(robots, routes, NOBODY_WALKS, ON_NOTHING), SITE)
    west = 4
    assert listed(table, 0) == {(1, 0, 0, west): 1, (2, 0, 2, west): 1, (3, 0, 4, west): 1}


START = 8


@kernel
def least(look: ReplanQuery, most: int, labels: Labels) -> tuple[int, int]:
    """Cost, and turns up to where what is looked at is left."""
    look.asked.looks[0] += 1
    state, cost = search(look, most, labels)
    return cost, labels.key[state] % TURNS if state >= 0 else -1


def by_textbook(look: ReplanQuery) -> tuple[int, int]:
    """The same by Dijkstra's algorithm over all states (cell, arriving move), with nothing left out."""
    look.asked.looks[0] += 1
    steps, field = (look.steps + prices_of(look)).tolist(), look.field.tolist()
    columns, best, done = look.steps.shape[1], (UNREACHABLE, 0), set[tuple[int, int]]()
    queue = [(0, 0, look.row * columns + look.column, START)]
    while queue:
        cost, turns, cell, arrived = heapq.heappop(queue)
        if (cell, arrived) in done or (cost, turns) >= best:
            continue
        done.add((cell, arrived))
        row, column = divmod(cell, columns)
        rest = field[row][column]
        if rest == 0 or octile(row - look.row, column - look.column) >= look.horizon:
            best = min(best, (cost + rest, turns))
            continue
        for move, (d_row, d_column) in enumerate(MOVES.tolist()):
            more = steps[row][column][move]
            if more == 0 or field[row + d_row][column + d_column] == UNREACHABLE:
                continue
            to = cell + d_row * columns + d_column
            turned = arrived not in (START, move)
            if turned and 3 <= (move - arrived) % 8 <= 5:
                more += look.hairpin
            heapq.heappush(queue, (cost + more, turns + turned, to, move))
    return best


@pytest.mark.parametrize(("layout", "steps"), [("narrow", 60), ("single_lane", 100), ("aisles:seed=3", 80)])
def test_a_search_finds_what_the_textbook_finds(layout: str, steps: int) -> None:
    simulator, looks = crowd(layout, 32, steps)
    labels: Any = make_labels(*simulator.grid.shape)
    assert [least(look, ANY, labels) for look in looks] == [by_textbook(look) for look in looks]
