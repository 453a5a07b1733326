"""Advice for robots that work: orders an hour, and the command."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.train.advice.floors import driver, floor_of, plan_of
from train.advice import capacity
from train.advice.aim import ORDERS, OrdersSoFar
from train.advice.answer import asked_text
from train.advice.curve import loads
from train.advice.study import TrialRuns
from train.advice.trials import TimeBudget, Trial
from train.cli import main
from train.reporting.rows import read_rows
from warehouse_env.maps.layouts import make_layout
from warehouse_env.simulation.tasks.orders import Order, write_orders
from warehouse_env.work import OrderSpec, ServiceSpec

HALL = floor_of(*["." * 48] * 48)
DRAWN: dict[str, Any] = {"orders": OrderSpec(per_hour=600.0), "arrival": "stop"}


def worked(trials: Sequence[Trial]) -> list[dict[str, Any]]:
    """Drop 20 orders an hour each, up to 600."""
    rows = driver({"ours": lambda robots: 100.0 * robots})(trials)
    for row, trial in zip(rows, trials, strict=True):
        made = min(20.0 * trial.robots, 600.0) / trial.robots
        row |= {"late_orders_per_robot_hour": made, "orders_per_robot_hour": made}
    return rows


def test_orders_are_counted_by_halves() -> None:
    watcher = OrdersSoFar(10)
    watcher._before = 5.0
    row = {"robots": 4, "orders_done": 25.0, "orders_per_hour": 50.0}
    read = watcher.row(row, 0.25)
    assert read == {"late_orders_per_robot_hour": 20.0, "orders_per_robot_hour": 12.5}
    assert ORDERS.made({**row, **read}) == 80.0


def test_fewer_orders_that_came_are_no_jam() -> None:
    rows = {
        robots: [{"late_orders_per_robot_hour": made / robots, "stuck": 0.0, "waiting_share": 0.0}] * 2
        for robots, made in ((8, 160.0), (16, 300.0), (32, 240.0))
    }
    assert not any(load.jammed for load in loads(rows, ORDERS))


def test_the_fewest_robots_that_carry_out_the_orders() -> None:
    plan = plan_of(HALL, wanted=560.0, work=DRAWN, most=128)
    study = TrialRuns(plan, worked, TimeBudget(None))
    found = capacity.capacity(study)
    assert found.team.robots == 32  # the first of the numbers tried that drop all 600 that come
    one = capacity.robots_needed(study, found, 1.0)
    assert one.robots in (28, 29)  # sought within a sixteenth
    said = asked_text(one, found, plan.aim)
    assert said.startswith(f"**560 orders an hour take {one.robots} robots**: they reach 5")


def test_a_trial_is_known_by_its_work(tmp_path: Path) -> None:
    file = tmp_path / "orders.csv"
    write_orders(file, [Order(0.0, ((1, 1),), (0, 0), 9.0, 1.0)])

    def trial(**work: Any) -> Trial:
        return Trial("as it is", HALL, "greedy", 1, 1, 5.0, "astar", work)

    served = trial(service=ServiceSpec(), arrival="stop")
    assert trial().identity["work"] == {}
    assert served.identity["work"]["service"]["pick"] == 30.0
    assert served.left([served.identity]) == ([served.identity], None)
    ordered = trial(orders=OrderSpec(file=str(file)), arrival="stop")
    assert ordered.files == ("greedy", "astar", str(file))
    before = ordered.identity
    write_orders(file, [Order(0.0, ((1, 1),), (0, 0), 8.0, 1.0)])
    assert ordered.identity != before


COMMON = ["advise", "--episodes", "2", "--most", "2", "--processes", "1", "--seed", "31000000", "--policy", "greedy"]


@pytest.mark.nightly
def test_the_command_carries_out_orders(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    grid = make_layout("open")
    picks, stations, _ = grid.endpoints
    orders = [Order(4.0 * k, (picks[4 * k],), stations[k % 3], 4.0 * k + 25.0, 10.0) for k in range(15)]
    write_orders(tmp_path / "orders.csv", orders)
    work = ["--service", "1", "--battery", "--orders", str(tmp_path / "orders.csv"), "--goals", "50"]
    command = [*COMMON, *work, "--layout", "open", "--seconds", "60", "--out", str(tmp_path)]
    assert main(command) == 0
    printed = capsys.readouterr().out
    rows = read_rows(tmp_path / "rows.jsonl")
    assert "50 orders an hour" in printed
    assert {row["work"]["battery"]["chargers"] for row in rows} == {4}
    assert all(row["late_orders_per_robot_hour"] >= 0.0 for row in rows)
    assert main([*command, "--resume"]) == 0
    assert read_rows(tmp_path / "rows.jsonl") == rows
