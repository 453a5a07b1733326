"""The report of an evaluation: its worst episodes and its page."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from train.cli import main
from train.evaluation.recorded import why, worst_episodes
from train.reporting.rows import read_rows
from warehouse_env.render.replay import replay_of
from warehouse_env.simulation.record.recording import Episode


def row(policy: str, seed: int, goals: float, hits: float = 0.0, **more: Any) -> dict[str, Any]:
    """One episode of 16 robots on a floor, 2 km driven."""
    return {
        "policy": policy, "layout": "hall", "robots": 16, "tasks": "lifelong", "planner": "astar", "seed": seed,
        "seconds": 600.0, "robot_km": 2.0, "collisions_robot": hits, "collisions_shelf": 0.0,
        "collisions_per_km": hits / 2, "goals_per_robot_hour": goals, "stuck": 0.0, "waiting_share": 0.1,
        "longest_standing_s": 5.0, **more,
    }  # fmt: skip


def test_the_worst_of_each_policy_come_in_turn() -> None:
    rows = [
        row("a", 0, 1.0, 4.0), row("a", 1, 1.0, 8.0), row("a", 2, 1.0, 6.0),
        row("b", 0, 1.0), row("b", 1, 1.0, stuck=0.125), row("b", 2, 1.0, longest_standing_s=70.0),
    ]  # fmt: skip
    found = worst_episodes(rows, 5)
    assert [(row["policy"], row["seed"]) for row in found] == [("a", 1), ("b", 1), ("a", 2), ("b", 2), ("a", 0)]
    assert why(found[0]) == "8 collisions, no robots stuck at the end, 5 s the longest standing"
    assert why(found[1]) == "no collisions, 2 robots stuck at the end, 5 s the longest standing"
    assert worst_episodes([], 5) == []
    assert worst_episodes([row("central_pibt", 0, 1.0)], 5) == []


def test_a_report_is_a_page_with_replays_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    options = "--policy brake follow --layout open --robots 2 4 --episodes 2 --seconds 10 --planner astar --seed 600"
    command = ["evaluate", *options.split(), "--no-pictures", "--out", str(tmp_path / "out")]
    report = tmp_path / "report"
    monkeypatch.setattr("sys.argv", ["warehouse", *command, "--report", str(report)])
    assert main([*command, "--report", str(report)]) == 0
    assert capsys.readouterr().out.endswith(f"the report to {report / 'index.html'}\n")
    page = (report / "index.html").read_text()
    links = re.findall(r'(?:href|src)="(?!#|data:)([^"]+)"', page)
    assert len(links) == 5
    assert "http://" not in page.replace("http://www.w3.org/", "")
    assert "<script" not in page
    assert page.count("<svg role=") == 2  # over robots, where
    for text in ("<td>brake</td>", "collisions/km", "600 to 601", f"--report {report}", "on open with 4 robots"):
        assert text in page, text
    rows = read_rows(report / "rows.jsonl")
    assert rows == read_rows(tmp_path / "out" / "rows.jsonl")
    for link in links:
        episode = Episode.load(report / link.replace(".html", ".npz"))
        last = list(episode.replay())[-1].episode_metrics(0)
        (driven,) = (
            one for one in rows
            if (one["policy"], one["robots"]) == (episode.policy, episode.config.num_agents)
            and one["seed"] == episode.seeds[0]
        )  # fmt: skip
        assert last["robot_km"] == driven["robot_km"]
        assert (report / link).stat().st_size > 20_000
        assert replay_of(episode, "x").pose.shape[0] == len(episode.actions) + 1
    assert "in 8 of 8 episodes" in page
    assert main([*command, "--report", str(report), "--resume"]) == 0
    assert "in 8 of 8 episodes" in (report / "index.html").read_text()
