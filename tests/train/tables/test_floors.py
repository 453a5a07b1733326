"""Policies on many floors: the table by hand, and the whole study, small."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from train.cli import main
from train.reporting.rows import Row, read_rows
from train.tables import floors
from train.tables.floors import DRAWN, LARGE, FloorsTable, floors_table
from train.tables.planners import movingai_warehouse
from warehouse_env.maps.movingai import read_map


def row(policy: str, layout: str, seed: int, late: float, robots: int = 4, **more: Any) -> Row:
    return {
        "policy": policy, "layout": layout, "robots": robots, "seed": seed,
        "late_goals_per_robot_hour": late,
        "stuck": 0.0, "longest_standing_s": 10.0, "collisions_robot": 0.0, "collisions_shelf": 0.0, "robot_km": 2.5,
        **more,
    }  # fmt: skip


ROWS = [
    row("greedy", "aisles:seed=1", 0, 100.0, robots=1),
    row("greedy", "aisles:seed=2", 1, 100.0, robots=1),
    row("greedy", "aisles:seed=1", 0, 60.0),
    row("greedy", "aisles:seed=2", 1, 80.0, longest_standing_s=33.0),
    row("ppo", "aisles:seed=1", 0, 66.0, stuck=0.25, collisions_robot=2.0),
    row("ppo", "aisles:seed=2", 1, 88.0),
]


def test_the_table_by_hand() -> None:
    table = floors_table(ROWS, ["ppo"])
    rule, ours = (dict(zip(table.header, line, strict=True)) for line in table.cells)
    assert (rule["floor"], rule["robots"], rule["policy"]) == ("drawn at random", "4", "greedy")
    assert (rule["% of alone"], rule["above the rule"], rule["stood s"], rule["km"]) == ("70", "", "33", "5")
    assert rule["late goals/h"] == "70 [0, 197]"  # 60 and 80, +- 12.706 * 14.14 / 1.414; fewer than none cannot be
    # paired 6 and 8: 7 +- 12.706 * 1.414 / 1.414 = 12.7
    assert ours["above the rule"] == "+7.0 [-5.7, 19.7], may be chance"
    assert (ours["in %"], ours["% of alone"]) == ("+10.0", "77")
    assert (ours["stuck %"], ours["contacts"]) == ("12", "2")
    assert len(floors_table(ROWS, ["greedy", "ppo"]).cells) == 2  # the rule once


def test_every_floor_has_the_same_seeds_for_the_rule_and_the_policies(tmp_path: Path) -> None:
    made = list(FloorsTable(out=tmp_path, policy=("ppo", "brake")).experiments(tmp_path))
    seeds: dict[tuple[str, int], set[tuple[int, ...]]] = {}
    for one in made:
        seeds.setdefault((one.config.layout, one.config.num_agents), set()).add(tuple(one.seeds))
    assert all(len(group) == 1 for group in seeds.values())
    assert len({place for place, _ in seeds}) == 3 + len(DRAWN) + 2 + len(LARGE)
    crowds = {robots for place, robots in seeds if place.startswith("blocks")}
    assert crowds == {1, 256, 512, 1024}
    assert all(one.seed >= floors.SEED for one in made)
    for aisle, shape in ((1, (63, 161)), (2, (84, 170))):  # shapes as in the archive of Stern et al.
        written, grid = read_map(tmp_path / f"warehouse-10-20-10-2-{aisle}.map"), movingai_warehouse(aisle)
        assert (written.occupied == grid.occupied).all()
        assert grid.shape == shape


def test_the_whole_study_small(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(floors, "SECONDS", 8.0)
    monkeypatch.setattr(floors, "ALONE", 3)
    asked = [
        "tables", "floors", "--maps", "open", "aisles:seed=3", "--policy", "follow", "--robots", "2", "--runs", "2",
        "--out", str(tmp_path), "--processes", "1",
    ]  # fmt: skip
    assert main(asked) == 0
    assert main(asked) == 0  # plays nothing again
    rows = read_rows(tmp_path / "floors" / "rows.jsonl")
    assert len(rows) == (3 + 2) * 2 + (3 + 2)  # alone, and driven by both, on the one floor twice as often
    assert "drawn at random" in (tmp_path / "floors" / "README.md").read_text()
    assert main([*asked, "--maps", "aisle:seed=3"]) != 0
    assert "aisles" in capsys.readouterr().err
