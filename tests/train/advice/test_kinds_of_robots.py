"""Advice for other kinds of robots: the fleets of trials, the floor for their bodies, and the command."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from tests.train.advice.floors import RACKS, floor_of, plan_of
from train.advice import room
from train.advice.room import for_kinds, most_with_a_start
from train.advice.trials import AdvicePlan, Use
from train.cli import main
from train.commands import advise as command
from train.kinds import KindPart, Kinds
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.errors import ConfigError, MapWarning

LONG = RobotSpec(length=1.4, max_speed=0.8)
WIDE = RobotSpec(length=1.2, width=1.2)
# Racks with a blind aisle of one cell, and ways of three around them, where wide robots pass.
HALL = floor_of(
    *["................"] * 3, *["...#####.####..."] * 4, "...##########...", *["................"] * 3,
    picks=[(2, 3), (6, 8), (8, 6)], stations=[(4, 1)],
)  # fmt: skip


def kinds_of(plan: AdvicePlan, robots: int, seeds: range) -> list[tuple[RobotSpec, ...]]:
    trials = plan.trials(plan.grid, "greedy", robots, seeds)
    return [EnvConfig(num_agents=robots, **trial.work).robots for trial in trials]


def test_fleets_keep_their_shares_and_one_alone_is_of_each_kind_in_turn() -> None:
    plan = plan_of(RACKS, kinds=Kinds((KindPart(LONG, share=0.25),)), seed=7)
    for use in (Use.ALONE, Use.CHOOSE):
        alone = kinds_of(plan, 1, plan.seeds(use, 8))
        assert [robot == LONG for (robot,) in alone] == [False, False, True, False] * 2
    for robots in (4, 16):
        for fleet in kinds_of(plan, robots, plan.seeds(Use.CHOOSE, 3, 2)):
            assert fleet.count(LONG) == robots // 4


def test_a_trial_is_known_by_its_robots() -> None:
    plan = plan_of(RACKS, policies=("greedy",), seconds=2.0)
    (usual,) = plan.trials(RACKS, "greedy", 2, [1])
    (long,) = dataclasses.replace(plan, kinds=Kinds((KindPart(LONG, share=1.0),))).trials(RACKS, "greedy", 2, [1])
    assert usual.identity["work"] == {}
    assert long.identity["work"]["robot"]["length"] == 1.4
    (row,) = long.run(lambda *_: None).rows
    assert row["work"] == long.identity["work"]
    assert long.left([row]) == ([row], None)


def test_the_floor_is_for_the_widest_body_however_many_there_are() -> None:
    few = Kinds((KindPart(WIDE, share=0.05),))
    grid, narrow = for_kinds(HALL, few)
    assert grid.tight is not None
    assert grid.tight[3:7, 8].all()
    assert grid.endpoints[0] == [(1, 3), (9, 6)]  # beside shelves there is no room for half of the width
    assert narrow[0].startswith("aisles are too narrow for bodies of 1.2 x 1.2 m: ")
    assert narrow[1] == "bodies of 1.2 x 1.2 m cannot reach 1 of 3 picks, which are left out"
    same, none = for_kinds(HALL, Kinds((KindPart(LONG, share=0.05),)))
    assert (same.tight, none) == (None, ())
    with pytest.raises(ConfigError, match="bodies of 9 x 9 m reach no pick face or no station of hall"):
        for_kinds(HALL, Kinds((KindPart(RobotSpec(length=9.0, width=9.0), share=1.0),)))


def test_large_bodies_find_fewer_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "PROBES", 3)
    hall = floor_of(*["." * 14] * 8)
    usual = plan_of(hall, policies=("greedy",), most=len(hall.endpoints[2]) - 1)
    large = dataclasses.replace(
        usual, kinds=Kinds((KindPart(RobotSpec(length=2.4, width=1.4, wheelbase=1.6), share=1.0),))
    )
    assert 1 <= most_with_a_start(large) < most_with_a_start(usual) == usual.most


def test_what_is_not_for_the_bodies_is_said_before_anything_is_driven(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def nobody(*_: object) -> None:
        raise ConfigError("nobody drives")

    monkeypatch.setattr(command, "advise", nobody)
    fleet, floor = tmp_path / "fleet.json", tmp_path / "hall.map"
    fleet.write_text('[{"share": 1, "robot": {"length": 1.4}}]', encoding="utf-8")
    floor.write_text("type octile\nheight 5\nwidth 8\nmap\n........\n........\n@@@.@@@@\n@.....@@\n@@@@@@@@\n", "utf-8")
    with pytest.warns(MapWarning, match=r"^hall: bodies of 1.4 x 0.6 m need aisles of 1.4 m to turn from one into"):
        assert main(["advise", "--map", str(floor), "--fleet", str(fleet), "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err == "warehouse: nobody drives\n"
