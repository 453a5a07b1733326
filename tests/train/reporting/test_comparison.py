"""Test comparisons of runs and groups: intervals by hand and by simulation, pairing, and the commands."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from train.cli import main
from train.commands.compare import Line, compare, comparison_table, read_runs
from train.reporting.columns import crossed_interval, difference_of, interval_of, read_groups, regrouped
from train.reporting.rows import Interval, is_significant, mean_interval, read_rows, t_quantile, write_rows
from warehouse_env.errors import ConfigError, WarehouseError


def row(policy: str, seed: int, goals: float, hits: float = 0.0, layout: str = "hall") -> dict[str, Any]:
    return {
        "policy": policy, "layout": layout, "robots": 8, "tasks": "lifelong", "planner": "astar", "seed": seed,
        "robot_km": 2.0, "collisions_per_km": hits, "goals_per_robot_hour": goals, "stuck": 0.0, "version": "1",
    }  # fmt: skip


BEFORE = [row("ppo", seed, goals, hits) for seed, goals, hits in ((1, 100, 2), (2, 120, 1), (3, 90, 3), (4, 1, 9))]
AFTER = [row("ppo", seed, goals, hits) for seed, goals, hits in ((2, 131, 1.5), (3, 99, 2), (1, 110, 2), (9, 5, 5))]


def lines_of(before: list[dict[str, Any]], after: list[dict[str, Any]]) -> dict[str, Line]:
    lines = compare({"before": before, "after": after})
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


def test_single_policies_pair_under_any_name() -> None:
    other = [{**one, "policy": "greedy"} for one in AFTER]
    line = lines_of(BEFORE, other)["goals_per_robot_hour"]
    assert (line.ours.policy, line.other.policy) == ("greedy", "ppo")
    both = [*other, *({**one, "policy": "brake"} for one in AFTER)]
    with pytest.raises(WarehouseError, match="no policy in common"):
        lines_of(BEFORE, both)
    with pytest.raises(WarehouseError, match="no episode in common"):
        lines_of(BEFORE, [{**one, "layout": "yard"} for one in AFTER])


def test_differing_settings_are_listed() -> None:
    """Settings have present names and include the version; floors and robots are in the table."""
    old = [{**one, "config": {"reroute": True, "num_agents": 8}} for one in BEFORE]
    new = [{**one, "config": {"planner": "astar", "reward": {"contact": -2.0}}, "version": "2"} for one in AFTER]
    found = lines_of(old, new)["goals_per_robot_hour"].differing
    assert found == {
        "planner": ("astar", "pf_aco"), "traffic": ("none", "routes"), "reward.contact": ("-2.0", "-0.5"),
        "version": ("2", "1"),
    }  # fmt: skip
    assert (
        "after / before differ in planner astar / pf_aco; reward.contact -2.0 / -0.5; traffic none / routes;"
        in comparison_table(compare({"before": old, "after": new})).note
    )


def test_policies_of_one_run_are_compared_with_the_first() -> None:
    rows = [*BEFORE, *({**one, "policy": "greedy"} for one in AFTER)]
    lines = compare({"one": rows})
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
def test_invalid_run_is_named(content: str, reason: str, tmp_path: Path) -> None:
    write_rows(tmp_path / "good.jsonl", BEFORE)
    (tmp_path / "bad.jsonl").write_text(content)
    with pytest.raises(WarehouseError, match=reason):
        read_runs([tmp_path / "good.jsonl", tmp_path / "bad.jsonl"])


def test_duplicate_seeds_and_single_runs_are_refused(tmp_path: Path) -> None:
    write_rows(tmp_path / "twice.jsonl", [*BEFORE, BEFORE[0]])
    with pytest.raises(WarehouseError, match="2 rows of ppo with seed 1 on hall"):
        read_runs([tmp_path / "twice.jsonl", tmp_path / "other.jsonl"])
    with pytest.raises(WarehouseError, match="is named twice"):
        read_runs([tmp_path / "twice.jsonl", tmp_path / "twice.jsonl"])
    with pytest.raises(WarehouseError, match="name a second run"):
        compare({"before": BEFORE})


def test_compare_writes_table_and_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_rows(tmp_path / "before.jsonl", BEFORE)
    write_rows(tmp_path / "after.jsonl", AFTER)
    runs = [str(tmp_path / name) for name in ("before.jsonl", "after.jsonl")]
    assert main(["compare", *runs, "--json", str(tmp_path / "out.jsonl")]) == 0
    printed = capsys.readouterr().out
    assert "+10.0 [7.5, 12.5]" in printed
    assert "compared 3 pairs of episodes" in printed
    first = read_rows(tmp_path / "out.jsonl")[0]
    assert (first["measure"], first["episodes"], first["verdict"]) == ("goals_per_robot_hour", 3, "better")


def test_crossed_interval_by_hand() -> None:
    # rows 1, 3 and 3, 9: grand mean 4; trainings' means 2, 6: variance 8 / 2 = 4; episodes' means 2, 6: 4;
    # rest 1, -1, -1, 1: 4 / (1 * 1) / 4 = 1; 4 + 4 - 1 = 7 with 49 / (16 + 16) degrees of freedom
    found = crossed_interval(np.array([[1.0, 3.0, np.nan], [3.0, 9.0, 1.0]]))
    half = t_quantile(49 / 32) * 7**0.5
    assert found == pytest.approx((4.0, 4.0 - half, 4.0 + half, 2))
    same = crossed_interval(np.array([[1.0, 5.0], [1.0, 5.0]]), np.array([[0.0, 4.0]]))
    assert same == (1.0, 1.0, 1.0, 2)
    one = crossed_interval(np.array([[1.0, 2.0, 6.0]]))  # one training: Student's t over episodes
    assert one == pytest.approx(mean_interval([1.0, 2.0, 6.0]))


@pytest.mark.parametrize("scales", [(1.0, 1.0, 1.0), (1.0, 0.0, 1.0), (0.3, 1.0, 1.0), (0.1, 2.0, 0.1)])
@pytest.mark.parametrize("others", [0, 1, 4])
def test_simulated_intervals_cover_the_truth(scales: tuple[float, float, float], others: int) -> None:
    """scales: deviations of trainings, of shared episodes, and of the rest; others: number of other trainings."""
    rng, (training, episode, rest), covered = np.random.default_rng(3), scales, 0
    for _ in range(1000):
        shared = rng.normal(0.0, episode, 10)
        ours, other = (
            rng.normal(0.0, training * (count > 1), (count, 1)) + shared + rng.normal(0.0, rest, (count, 10))
            for count in (4, others)
        )
        found = crossed_interval(*((ours, other) if others else (ours,)))
        covered += found.low <= 0.0 <= found.high
    assert 925 <= covered <= 995


def test_group_rows_get_the_groups_name() -> None:
    rows = [
        row(name, seed, 10.0 * k + seed) for k, name in enumerate(("runs/a", "runs/b", "greedy")) for seed in (1, 2)
    ]
    shown = regrouped(rows, read_groups(["mine=runs/a,runs/b"]))
    assert [one["policy"] for one in shown] == ["greedy", "greedy", *["mine"] * 4]
    mine, greedy = shown[2:], shown[:2]
    goals = lambda one: one["goals_per_robot_hour"]  # noqa: E731
    assert interval_of(mine, goals) == pytest.approx(crossed_interval(np.array([[1.0, 2.0], [11.0, 12.0]])))
    gain = crossed_interval(np.array([[1.0, 2.0], [11.0, 12.0]]), np.array([[21.0, 22.0]]))
    assert difference_of(mine, greedy, goals) == pytest.approx(gain)
    assert len(regrouped(rows, read_groups(["mine=runs/a,runs/b"]), alone=["runs/b"])) == 8
    for text, why in (("mine=a", "two or more"), ("greedy=runs/a,runs/b", "greedy must"), ("mine=runs/a,c", "c must")):
        with pytest.raises(ConfigError, match=why):
            regrouped(rows, read_groups([text]))


def test_both_commands_take_groups(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = "--layout open --robots 2 --seconds 10 --planner astar --no-pictures --episodes 2 --policy follow"
    assert main(["evaluate", *options.split(), "--group", "mine=brake,orca", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "Groups (mine)" in printed
    assert "orca" not in (tmp_path / "table.md").read_text().partition("Driven")[0]
    assert len(read_rows(tmp_path / "rows.jsonl")) == 6
    write_rows(tmp_path / "one.jsonl", [row(name, s, 9.0 * s) for name in ("a", "b", "c", "d") for s in (1, 2)])
    assert main(["compare", str(tmp_path / "one.jsonl"), "--group", "old=a,b", "new=c,d"]) == 0
    assert "compared 2 pairs" in (printed := capsys.readouterr().out)
    assert "Groups (old, new)" in printed
    write_rows(tmp_path / "two.jsonl", [row(name, s, 8.0 * s) for name in ("e", "f") for s in (1, 2)])
    both = [str(tmp_path / name) for name in ("one.jsonl", "two.jsonl")]
    assert main(["compare", *both, "--group", "old=a,b", "new=e,f", "--policy", "old", "new"]) == 0
    assert "two: new" in capsys.readouterr().out
    assert main(["compare", *both, "--group", "old=x,y"]) == 2
