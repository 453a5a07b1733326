"""Test `warehouse benchmark`: each version fixes the set; tables add policies to the shipped rows."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

from train.cli import main
from train.evaluation import fixed_set
from train.evaluation.rollout import config_of
from train.reporting.rows import read_rows
from warehouse_env.config import EnvConfig
from warehouse_env.maps.layouts import make_layout

COLUMNS = ("track", "layout", "robots", "seed")


def test_set_matches_its_version() -> None:
    """A changed floor, fleet or seed needs a new VERSION and new shipped rows."""
    content = hashlib.sha256(
        json.dumps([fixed_set.SECONDS, fixed_set.SEED, fixed_set.PLANNER, fixed_set.CASES]).encode()
    )
    for layout in dict.fromkeys(case.layout for case in fixed_set.CASES):
        grid = make_layout(layout)
        content.update(grid.occupied.tobytes() + json.dumps(grid.endpoints[:2]).encode())
    assert (fixed_set.VERSION, content.hexdigest()[:16]) == (2, "f7c0d2ce55f6ec03")


def test_shipped_policies_drove_the_whole_set() -> None:
    rows = read_rows(fixed_set.SHIPPED)
    wanted = {
        (track, one.config.layout, one.config.num_agents, seed)
        for track, one in fixed_set.experiments("follow")
        for seed in one.seeds
    }
    driven: dict[tuple[str, str], set[tuple[object, ...]]] = {}
    for row in rows:
        driven.setdefault((row["policy"], row["track"]), set()).add(tuple(row[name] for name in COLUMNS))
    assert {policy for policy, _ in driven} == {"busy", "careful", "greedy", "orca", "ppo", "shielded", "unshielded"}
    for (_, track), known in driven.items():
        assert known == {one for one in wanted if one[0] == track}


def test_track_sets_one_traffic_for_all_policies() -> None:
    for policy in ("follow", "greedy", "ppo", "shielded", "orca"):
        spec = config_of(policy, EnvConfig(), fixed_set.options(policy, "with_shield")).traffic_spec
        assert (spec.shield, spec.right_of_way, spec.routes) == (True, True, True)
        assert config_of(policy, EnvConfig(), fixed_set.options(policy, "routes_only")).traffic == "routes"
    assert [fixed_set.tracks(policy) for policy in ("greedy", "shielded")] == [
        ["with_shield", "routes_only"],
        ["with_shield"],
    ]


def test_tables_list_the_best_first() -> None:
    rows = read_rows(fixed_set.SHIPPED)
    config = EnvConfig(traffic="shield", action_repeat=3).to_dict()
    better = [
        {**row, "policy": "better", "late_goals_per_robot_hour": 999.0, "config": config}
        for row in rows if row["policy"] == "ppo"
    ]  # fmt: skip
    tables = fixed_set.benchmark_tables([*rows, *better])
    assert [table.title.partition(":")[0] for table in tables] == list(fixed_set.TRACKS)
    for table in tables:
        assert table.cells[0][:2] == ("better", "shield, 0.3 s")
    assert ("ppo", "routes, 0.1 s") in [line[:2] for line in tables[1].cells]
    assert "shielded" not in [line[0] for line in tables[1].cells]


def test_benchmark_drives_resumes_and_tabulates(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small = (fixed_set.Case("few", "open", 2, 2), fixed_set.Case("more", "aisles:seed=801", 3, 1))
    monkeypatch.setattr(fixed_set, "SECONDS", 8.0)
    monkeypatch.setattr("train.commands.evaluate.SHIPPED", tmp_path / "none.jsonl")
    (tmp_path / "none.jsonl").write_text("")
    monkeypatch.setattr("train.commands.evaluate.experiments", lambda policy: fixed_set.experiments(policy, small))
    monkeypatch.setattr(
        "train.commands.evaluate.benchmark_tables", lambda rows: fixed_set.benchmark_tables(rows, small)
    )
    arguments = ["benchmark", "--policy", "follow", "follow", "--processes", "1", "--out", str(tmp_path)]
    assert main(arguments) == 0
    before = (tmp_path / "table.md").read_text()
    assert before.count("| follow |") == 2
    assert len(read_rows(tmp_path / "rows.jsonl")) == 6
    assert main(arguments) == 2  # existing rows are not replaced
    (tmp_path / "rows.jsonl").write_bytes(b"".join((tmp_path / "rows.jsonl").read_bytes().splitlines(True)[:4]))
    assert main([*arguments, "--resume"]) == 0
    assert (tmp_path / "table.md").read_text() == before


def test_benchmark_shows_the_shipped_policies(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["benchmark"]) == 0
    assert "shielded" in capsys.readouterr().out
