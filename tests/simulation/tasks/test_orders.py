"""Orders: files read and written, orders drawn by chance, who gets which, and the account of them."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from warehouse_env.errors import ConfigError, MapWarning
from warehouse_env.maps.layouts import make_layout
from warehouse_env.simulation.tasks.ledger import Demand, Ledger
from warehouse_env.simulation.tasks.orders import (
    ALLOCATORS,
    Order,
    check_orders,
    make_allocator,
    read_orders,
    write_orders,
)
from warehouse_env.work import OrderSpec

FLOOR = make_layout("open")
PICK, DROP = FLOOR.endpoints[0][0], FLOOR.endpoints[1][0]
LINE = "0,1:1 1:4,9:1,600,120"
HEAD = "release_s,picks,drop,due_s,weight_kg"

CELLS = st.tuples(st.integers(0, 500), st.integers(0, 500))
SECONDS = st.integers(0, 10**5).map(float)
ORDERS = st.builds(
    lambda release, picks, drop, left, weight: Order(release, tuple(picks), drop, release + left, weight),
    SECONDS, st.lists(CELLS, min_size=1, max_size=4), CELLS, SECONDS, SECONDS,
)  # fmt: skip


@settings(max_examples=30)
@given(st.lists(ORDERS, min_size=1, max_size=5))
def test_what_is_written_is_read(tmp_path_factory: pytest.TempPathFactory, orders: list[Order]) -> None:
    path = tmp_path_factory.mktemp("orders") / "o.csv"
    write_orders(path, orders)
    assert read_orders(path) == tuple(sorted(orders, key=lambda order: order.release))


ONE = Order(0.0, ((1, 1), (1, 4)), (9, 1), 600.0, 120.0)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("o.CSV", f"{HEAD}\n{LINE}\n"),
        ("o.csv", f"{HEAD.replace(',', ';')}\n{LINE.replace(',', ';').replace('600', '600,0')}\n"),
        ("o.csv", f"{HEAD}\n{LINE}\n".replace(",", "\t")),
        ("o.csv", f"{HEAD.title()},,\n{LINE},,\n,,,,,,\n\n".replace(",", " , ")),
        ("o.csv", '"release_s","picks","drop","due_s","weight_kg"\n"0","1:1 1:4","9:1","600","120"\n'),
    ],
)
def test_what_other_programs_save_is_read(name: str, text: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    assert read_orders(tmp_path / name) == (ONE,)


def test_orders_to_cells_that_are_no_places_are_noted() -> None:
    stray = next(cell for cell in map(tuple, FLOOR.free_cells.tolist()) if cell not in map(tuple, FLOOR.endpoints[2]))
    with pytest.warns(MapWarning, match=r"open: orders lead to 1 cell that are neither .* \(\d+, \d+\) of order 2$"):
        check_orders([Order(0, (PICK,), DROP, 1, 5), Order(0, (stray,), DROP, 1, 5)], FLOOR, 500)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "line 1 must name the columns"),
        (HEAD, "hold none"),
        (f"{HEAD.replace('drop', 'dorp')}\n{LINE}\n", "line 1 must name the columns"),
        (f"{HEAD}\n{LINE},3\n", "line 2 must have exactly the fields"),
        (f"{HEAD}\n0,1:1,9:1,600,\n", "line 2 must have exactly the fields"),
        (f"{HEAD}\n0,,9:1,600,1\n", "line 2: picks"),
        (f"{HEAD}\n0,1:1,9:1 2:2,600,1\n", "line 2: the cell"),
        (f"{HEAD}\n0,1,9:1,600,1\n", "line 2: the cell"),
        (f"{HEAD}\nnan,1:1,9:1,600,1\n", "line 2: release_s"),
        (f"{HEAD}\n700,1:1,9:1,600,1\n", "must not be before release_s"),
    ],
)
def test_what_is_no_order_is_named_by_its_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "o.csv"
    path.write_text(text)
    with pytest.raises(ConfigError, match=said):
        read_orders(path)


@pytest.mark.filterwarnings("error")
def test_orders_that_nobody_can_carry_out_are_refused() -> None:
    check_orders([Order(0, (PICK,), DROP, 1, 500)], FLOOR, 500)
    with pytest.raises(ConfigError, match="order 1 weighs 501 kg"):
        check_orders([Order(0, (PICK,), DROP, 1, 501)], FLOOR, 500)
    with pytest.raises(Exception, match="pick of order 2"):
        check_orders([Order(0, (PICK,), DROP, 1, 5), Order(0, ((999, 0),), DROP, 1, 5)], FLOOR, 500)


def test_demand_comes_as_often_as_asked_and_from_the_classes_asked_for() -> None:
    spec = OrderSpec(per_hour=600, demand=(0.9, 0.1), faces=(0.25, 0.75), picks=3, weight=400)
    demand = Demand(spec, FLOOR, 500.0, np.random.default_rng(1))
    orders = list(itertools.takewhile(lambda order: order.release < 36_000.0, iter(demand.draw, None)))
    assert len(orders) == pytest.approx(6000, abs=4 * math.sqrt(6000))
    visits = Counter(pick for order in orders for pick in order.picks)
    often = sum(count for _, count in visits.most_common(len(FLOOR.picks) // 4))
    assert often / visits.total() == pytest.approx(0.9, abs=0.05)
    assert {len(order.picks) for order in orders} == {1, 2, 3}
    assert 0 <= min(order.weight for order in orders) <= max(order.weight for order in orders) == 500
    assert all(b.release >= a.release and a.due == a.release + 900 for a, b in itertools.pairwise(orders))


COSTS = st.integers(1, 5).flatmap(
    lambda rows: st.lists(st.lists(st.integers(0, 9), min_size=rows, max_size=rows), min_size=1, max_size=5)
)


@pytest.mark.parametrize("name", ALLOCATORS)
@given(COSTS)
def test_as_many_robots_as_possible_get_one_order_each(name: str, cost: list[list[int]]) -> None:
    table = np.array(cost, dtype=np.float64)
    pairs = make_allocator(name)(table)
    robots, orders = zip(*pairs, strict=True)
    assert len(set(robots)) == len(set(orders)) == len(pairs) == min(table.shape)


def test_rules_differ_where_they_should() -> None:
    cost = np.array([[2.0, 1.0], [9.0, 4.0]])  # robot 0 is nearer to both
    assert ALLOCATORS["fifo"](cost) == [(0, 0), (1, 1)]
    assert ALLOCATORS["nearest"](cost) == [(0, 1), (1, 0)]
    assert ALLOCATORS["optimal"](cost) == [(0, 0), (1, 1)]


def test_the_ledger_counts_by_hand() -> None:
    ledger = Ledger([Order(0, (PICK,), DROP, 50, 1), Order(10, (PICK,), DROP, 20, 1), Order(90, (PICK,), DROP, 99, 1)])
    ledger.release(10)
    assert list(ledger.open) == [0, 1]
    assert ledger.next_release == 90
    ledger.give(0)
    ledger.give_back(0)
    assert list(ledger.open) == [0, 1]
    for number, now in ((0, 40.0), (1, 60.0)):
        ledger.give(number)
        ledger.complete(number, now)
    row = ledger.row(72.0)
    assert (row["orders_done"], row["orders_per_hour"], row["orders_late"]) == (2, 100, 1)
    assert (row["order_median_s"], row["orders_open"], row["orders_released"]) == (45, 0, 2)
    assert (row["orders_due"], row["orders_in_time"]) == (2, 1)
    assert ledger.row(45.0)["orders_due"] == 1  # of 20 s; the one of 50 s is done before it is due
