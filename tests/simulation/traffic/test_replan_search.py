"""The search for a cheapest way, against Dijkstra's algorithm as in a textbook, on floors crowded with robots."""

from __future__ import annotations

import heapq
from typing import Any

import pytest

from tests.simulation.traffic.test_live import crowd, prices_of
from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import MOVES
from warehouse_env.planning.cost_to_go import UNREACHABLE, octile
from warehouse_env.simulation.traffic.prices import ANY, ReplanQuery
from warehouse_env.simulation.traffic.replan_search import TURNS, Labels, make_labels, search

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
