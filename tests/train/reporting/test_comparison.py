"""Runs side by side: paired differences by hand, what pairs with what, the command and its page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from train.cli import main
from train.reporting.comparison import ComparedRun, Line, compare, comparison_table, read_runs
from train.reporting.rows import Interval, is_significant, read_rows, write_rows
from train.reporting.trainings import difference_of
from warehouse_env.errors import WarehouseError


def row(policy: str, seed: int, goals: float, hits: float = 0.0, layout: str = "hall") -> dict[str, Any]:
    return {
        "policy": policy, "layout": layout, "robots": 8, "tasks": "lifelong", "planner": "astar", "seed": seed,
        "robot_km": 2.0, "collisions_per_km": hits, "goals_per_robot_hour": goals, "stuck": 0.0, "version": "1",
    }  # fmt: skip


BEFORE = [row("ppo", seed, goals, hits) for seed, goals, hits in ((1, 100, 2), (2, 120, 1), (3, 90, 3), (4, 1, 9))]
AFTER = [row("ppo", seed, goals, hits) for seed, goals, hits in ((2, 131, 1.5), (3, 99, 2), (1, 110, 2), (9, 5, 5))]


def lines_of(before: list[dict[str, Any]], after: list[dict[str, Any]]) -> dict[str, Line]:
    lines = compare([ComparedRun("before", before), ComparedRun("after", after)])
    return {line.measure.name: line for line in lines}


def test_paired_differences_by_hand() -> None:
    found = difference_of(AFTER, BEFORE, lambda one: one["goals_per_robot_hour"], ("seed",))
    # differences 11, 9, 10: mean 10, standard deviation 1, half width 4.3027 / sqrt(3)
    assert found == pytest.approx((10.0, 10 - 2.4841, 10 + 2.4841, 3), abs=1e-3)
    assert is_significant(found)
    assert not is_significant(Interval(1.0, float("nan"), float("nan"), 1))
    assert difference_of(AFTER, BEFORE, lambda one: None, ("seed",)).samples == 0


def test_only_common_episodes_count() -> None:
    lines = lines_of(BEFORE, AFTER)
    goals, hits = lines["goals_per_robot_hour"], lines["collisions_per_km"]
    assert goals.difference.samples == 3
    assert (goals.base.mean, goals.found.mean) == pytest.approx((310 / 3, 340 / 3))
    assert goals.verdict == "better"
    assert (hits.difference.mean, hits.verdict) == (pytest.approx(-0.5 / 3), "may be chance")
    assert lines["stuck"].verdict == "equal"
    assert lines_of(AFTER, BEFORE)["goals_per_robot_hour"].verdict == "worse"
    assert goals.differing == {}
    assert goals.row()["difference_low"] == pytest.approx(10 - 2.4841, abs=1e-3)


def test_single_policies_pair_whatever_they_are_called() -> None:
    other = [{**one, "policy": "greedy"} for one in AFTER]
    line = lines_of(BEFORE, other)["goals_per_robot_hour"]
    assert (line.ours.policy, line.other.policy) == ("greedy", "ppo")
    both = [*other, *({**one, "policy": "brake"} for one in AFTER)]
    with pytest.raises(WarehouseError, match="no policy in common"):
        lines_of(BEFORE, both)
    with pytest.raises(WarehouseError, match="no episode in common"):
        lines_of(BEFORE, [{**one, "layout": "yard"} for one in AFTER])


def test_differing_settings_are_listed() -> None:
    """By today's names, flat, with the version; floors and robots stand in the table."""
    old = [{**one, "config": {"reroute": True, "num_agents": 8}} for one in BEFORE]
    new = [{**one, "config": {"planner": "astar", "reward": {"contact": -2.0}}, "version": "2"} for one in AFTER]
    found = lines_of(old, new)["goals_per_robot_hour"].differing
    assert found == {
        "planner": ("astar", "pf_aco"), "traffic": ("none", "routes"), "reward.contact": ("-2.0", "-0.5"),
        "version": ("2", "1"),
    }  # fmt: skip
    runs = [ComparedRun(name, rows) for name, rows in (("before", old), ("after", new))]
    assert (
        "after / before differ in planner astar / pf_aco; reward.contact -2.0 / -0.5; traffic none / routes;"
        in comparison_table(compare(runs)).note
    )


def test_in_one_run_policies_are_compared_with_the_first() -> None:
    rows = [*BEFORE, *({**one, "policy": "greedy"} for one in AFTER)]
    lines = compare([ComparedRun("one", rows)])
    assert {(line.ours.policy, line.other.policy) for line in lines} == {("greedy", "ppo")}
    assert comparison_table(lines).cells[0][3:6:2] == ("greedy", "ppo")


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("", "it is empty"),
        ('{"part": 1}\n', "lack 'policy'"),
        ("nonsense\n", "line 1: not a JSON object"),
    ],
)
def test_what_is_no_run_is_named(content: str, reason: str, tmp_path: Path) -> None:
    write_rows(tmp_path / "good.jsonl", BEFORE)
    (tmp_path / "bad.jsonl").write_text(content)
    with pytest.raises(WarehouseError, match=reason):
        read_runs([tmp_path / "good.jsonl", tmp_path / "bad.jsonl"])


def test_a_seed_twice_is_refused_and_so_is_a_single_run(tmp_path: Path) -> None:
    write_rows(tmp_path / "twice.jsonl", [*BEFORE, BEFORE[0]])
    with pytest.raises(WarehouseError, match="2 rows of ppo with seed 1 on hall"):
        read_runs([tmp_path / "twice.jsonl", tmp_path / "other.jsonl"])
    with pytest.raises(WarehouseError, match="is named twice"):
        read_runs([tmp_path / "twice.jsonl", tmp_path / "twice.jsonl"])
    with pytest.raises(WarehouseError, match="name a second run"):
        compare([ComparedRun("before", BEFORE)])


def test_the_command_writes_table_and_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_rows(tmp_path / "before.jsonl", BEFORE)
    write_rows(tmp_path / "after.jsonl", AFTER)
    runs = [str(tmp_path / name) for name in ("before.jsonl", "after.jsonl")]
    assert main(["compare", *runs, "--json", str(tmp_path / "out.jsonl")]) == 0
    printed = capsys.readouterr().out
    assert "+10.0 [7.5, 12.5]" in printed
    assert "compared 3 pairs of episodes" in printed
    first = read_rows(tmp_path / "out.jsonl")[0]
    assert (first["measure"], first["episodes"], first["verdict"]) == ("goals_per_robot_hour", 3, "better")
