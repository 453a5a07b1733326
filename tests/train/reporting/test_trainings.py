"""Groups of trainings: intervals by hand and by simulation, and both commands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.train.reporting.test_comparison import row
from train.cli import main
from train.reporting.rows import mean_interval, read_rows, t_quantile, write_rows
from train.reporting.trainings import crossed_interval, difference_of, interval_of, read_groups, regrouped
from warehouse_env.errors import ConfigError


def test_an_interval_over_trainings_and_episodes_by_hand() -> None:
    # rows 1, 3 and 3, 9: grand mean 4; trainings' means 2, 6: variance 8 / 2 = 4; episodes' means 2, 6: 4;
    # rest 1, -1, -1, 1: 4 / (1 * 1) / 4 = 1; 4 + 4 - 1 = 7 with 49 / (16 + 16) degrees of freedom
    found = crossed_interval(np.array([[1.0, 3.0, np.nan], [3.0, 9.0, 1.0]]))
    half = t_quantile(49 / 32) * 7**0.5
    assert found == pytest.approx((4.0, 4.0 - half, 4.0 + half, 2))
    same = crossed_interval(np.array([[1.0, 5.0], [1.0, 5.0]]), np.array([[0.0, 4.0]]))
    assert same == (1.0, 1.0, 1.0, 2)
    one = crossed_interval(np.array([[1.0, 2.0, 6.0]]))  # a single policy: Student's t over episodes
    assert one == pytest.approx(mean_interval([1.0, 2.0, 6.0]))


@pytest.mark.parametrize("scales", [(1.0, 1.0, 1.0), (1.0, 0.0, 1.0), (0.3, 1.0, 1.0), (0.1, 2.0, 0.1)])
@pytest.mark.parametrize("others", [0, 1, 4])
def test_simulated_intervals_cover_the_truth(scales: tuple[float, float, float], others: int) -> None:
    """Standard deviations: of trainings, of episodes (shared by all), of single episodes; others: trainings."""
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


def test_rows_of_a_group_stand_under_its_name() -> None:
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
    for text, said in (("mine=a", "two or more"), ("greedy=runs/a,runs/b", "greedy must"), ("mine=runs/a,c", "c must")):
        with pytest.raises(ConfigError, match=said):
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
