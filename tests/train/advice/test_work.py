"""Test advice for orders and for fleets of several kinds: orders per hour, fleets, fitted floors."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.train.advice.floors import RACKS, driver, floor_of, plan_of
from train.advice import capacity
from train.advice.answer import asked_text
from train.advice.capacity import for_kinds, most_with_a_start
from train.advice.curve import loads
from train.advice.study import TrialRuns
from train.advice.trials import ORDERS, AdvicePlan, TimeBudget, Trial, Use, orders_of
from train.cli import main
from train.commands import advise as command
from train.kinds import KindPart, Kinds
from train.reporting.rows import read_rows
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.errors import ConfigError, MapWarning
from warehouse_env.maps.layouts import make_layout
from warehouse_env.simulation.tasks.orders import Order, write_orders
from warehouse_env.work import OrderSpec, ServiceSpec

HALL = floor_of(*["." * 48] * 48)
DRAWN: dict[str, Any] = {"orders": OrderSpec(per_hour=600.0), "arrival": "stop"}


def drive_orders(trials: Sequence[Trial]) -> list[dict[str, Any]]:
    """Deliver 20 orders an hour per robot, 600 at most."""
    rows = driver({"ours": lambda robots: 100.0 * robots})(trials)
    for row, trial in zip(rows, trials, strict=True):
        made = min(20.0 * trial.robots, 600.0) / trial.robots
        row |= {"late_orders_per_robot_hour": made, "orders_per_robot_hour": made}
    return rows


def test_late_orders_are_those_of_the_second_half() -> None:
    row = {"robots": 4, "orders_done": 25.0, "orders_per_hour": 50.0}
    read = orders_of(row, 5.0, 0.25)
    assert read == {"late_orders_per_robot_hour": 20.0, "orders_per_robot_hour": 12.5}
    assert ORDERS.made({**row, **read}) == 80.0


def test_fewer_orders_are_no_jam() -> None:
    rows = {
        robots: [{"late_orders_per_robot_hour": made / robots, "stuck": 0.0, "waiting_share": 0.0}] * 2
        for robots, made in ((8, 160.0), (16, 300.0), (32, 240.0))
    }
    assert not any(load.jammed for load in loads(rows, ORDERS))


def test_fewest_robots_for_the_wanted_orders() -> None:
    plan = plan_of(HALL, wanted=560.0, work=DRAWN, most=128)
    study = TrialRuns(plan, drive_orders, TimeBudget(None))
    found = capacity.capacity(study)
    assert found.team.robots == 32  # the smallest tried number that delivers all 600
    one = capacity.robots_needed(study, found, 1.0)
    assert one.robots in (28, 29)  # exact to a sixteenth
    text = asked_text(one, found, plan.aim)
    assert text.startswith(f"**560 orders an hour take {one.robots} robots**: they reach 5")


def test_trial_identity_includes_its_work(tmp_path: Path) -> None:
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
def test_advise_carries_out_orders(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
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


LONG = RobotSpec(length=1.4, max_speed=0.8)
WIDE = RobotSpec(length=1.2, width=1.2)
# Racks with a dead-end aisle of one cell; wide robots pass on the three-cell ways around them.
RACKS_AND_WAYS = floor_of(
    *["................"] * 3, *["...#####.####..."] * 4, "...##########...", *["................"] * 3,
    picks=[(2, 3), (6, 8), (8, 6)], stations=[(4, 1)],
)  # fmt: skip


def kinds_of(plan: AdvicePlan, robots: int, seeds: range) -> list[tuple[RobotSpec, ...]]:
    trials = [plan.trial(plan.grid, "greedy", robots, seed) for seed in seeds]
    return [EnvConfig(num_agents=robots, **trial.work).robots for trial in trials]


def test_fleets_keep_shares_and_single_robots_cycle_kinds() -> None:
    plan = plan_of(RACKS, kinds=Kinds((KindPart(LONG, share=0.25),)), seed=7)
    for use in (Use.ALONE, Use.CHOOSE):
        alone = kinds_of(plan, 1, plan.seeds(use, 8))
        assert [robot == LONG for (robot,) in alone] == [False, False, True, False] * 2
    for robots in (4, 16):
        for fleet in kinds_of(plan, robots, plan.seeds(Use.CHOOSE, 3, 2)):
            assert fleet.count(LONG) == robots // 4


def test_trial_identity_includes_its_robots() -> None:
    plan = plan_of(RACKS, policies=("greedy",), seconds=2.0)
    usual = plan.trial(RACKS, "greedy", 2, 1)
    long = dataclasses.replace(plan, kinds=Kinds((KindPart(LONG, share=1.0),))).trial(RACKS, "greedy", 2, 1)
    assert usual.identity["work"] == {}
    assert long.identity["work"]["robot"]["length"] == 1.4
    (row,) = long.run(lambda *_: None).rows
    assert row["work"] == long.identity["work"]
    assert long.left([row]) == ([row], None)


def test_floor_is_fitted_to_the_widest_footprint() -> None:
    few = Kinds((KindPart(WIDE, share=0.05),))
    grid, narrow = for_kinds(RACKS_AND_WAYS, few)
    assert grid.tight is not None
    assert grid.tight[3:7, 8].all()
    assert grid.endpoints[0] == [(1, 3), (9, 6)]  # too close to shelves for half the width
    assert narrow[0].startswith("aisles are too narrow for bodies of 1.2 x 1.2 m: ")
    assert narrow[1] == "bodies of 1.2 x 1.2 m cannot reach 1 of 3 picks, which are left out"
    same, none = for_kinds(RACKS_AND_WAYS, Kinds((KindPart(LONG, share=0.05),)))
    assert (same.tight, none) == (None, ())
    with pytest.raises(ConfigError, match="bodies of 9 x 9 m reach no pick face or no station of hall"):
        for_kinds(RACKS_AND_WAYS, Kinds((KindPart(RobotSpec(length=9.0, width=9.0), share=1.0),)))


def test_large_footprints_find_fewer_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(capacity, "PROBES", 3)
    hall = floor_of(*["." * 14] * 8)
    usual = plan_of(hall, policies=("greedy",), most=len(hall.endpoints[2]) - 1)
    large = dataclasses.replace(
        usual, kinds=Kinds((KindPart(RobotSpec(length=2.4, width=1.4, wheelbase=1.6), share=1.0),))
    )
    assert 1 <= most_with_a_start(large) < most_with_a_start(usual) == usual.most


def test_tight_aisles_are_noted_before_driving(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object) -> None:
        raise ConfigError("nobody drives")

    monkeypatch.setattr(command, "advise", refuse)
    fleet, floor = tmp_path / "fleet.json", tmp_path / "hall.map"
    fleet.write_text('[{"share": 1, "robot": {"length": 1.4}}]', encoding="utf-8")
    floor.write_text("type octile\nheight 5\nwidth 8\nmap\n........\n........\n@@@.@@@@\n@.....@@\n@@@@@@@@\n", "utf-8")
    with pytest.warns(MapWarning, match=r"^hall: bodies of 1.4 x 0.6 m need aisles of 1.4 m to turn from one into"):
        assert main(["advise", "--map", str(floor), "--fleet", str(fleet), "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err == "warehouse: nobody drives\n"
