"""Test that recorded and filmed episodes equal evaluated ones, and the page of the worst episodes."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents import make_policy
from train.cli import main
from train.evaluation import films
from train.evaluation.films import film
from train.evaluation.recorded import record, shares_of, why, worst_episodes
from train.evaluation.rollout import make_experiment, run
from train.reporting.rows import read_rows
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, WarehouseError
from warehouse_env.render.pages import write_replay_page
from warehouse_env.render.replay import replay_of
from warehouse_env.simulation.record.recording import Episode

BASE = EnvConfig(layout="open", num_agents=5, planner="astar")
FULL = {"traffic": "rules"}


@pytest.mark.parametrize(("policy", "chosen"), [("brake", {}), ("ppo", FULL)])
def test_recorded_episode_equals_the_evaluated_one(policy: str, chosen: dict[str, bool]) -> None:
    experiment = make_experiment(policy, BASE, 1, 12.0, 5, chosen)
    poses, steps = list[Any](), []
    (row,) = run(experiment, [lambda simulator, steps: poses.append(simulator.state.pose[0].copy())])
    episode = record(experiment, lambda: steps.append(1))
    np.testing.assert_array_equal(episode.pose[:, 0], np.stack(poses))
    assert (episode.policy, episode.seeds) == (policy, (5,))
    assert len(steps) == len(episode.actions) == experiment.config.max_steps
    *_, last = episode.replay()
    assert last.episode_metrics(0)["robot_km"] == row["robot_km"]


def test_breakdowns_are_not_recorded() -> None:
    with pytest.raises(ConfigError, match="break down"):
        record(make_experiment("brake", BASE, 1, 5.0, 5, {}, "breakdown"))


def test_shares_are_probabilities_and_none_without_preferences() -> None:
    config = make_experiment("ppo", BASE, 1, 5.0, 5).config
    observation = np.random.default_rng(1).uniform(-1, 1, (1, 5, 112)).astype(np.float32)
    learned = shares_of("ppo", config)
    assert learned is not None
    logits = make_policy("ppo", config).preferences(observation)  # type: ignore[attr-defined]
    chances = learned(observation)
    np.testing.assert_allclose(chances.sum(axis=-1), 1, atol=1e-9)
    np.testing.assert_array_equal(chances.argmax(axis=-1), logits.argmax(axis=-1))
    for without in ("", "follow"):
        assert shares_of(without, config) is None
    with pytest.raises(WarehouseError):
        shares_of("no/such/folder", config)


@pytest.mark.nightly
def test_64_robots_over_2000_steps_are_under_5_mb(tmp_path: Path) -> None:
    base = EnvConfig(num_agents=64, planner="astar_turns")
    experiment = make_experiment("ppo", base, 1, 200.0, 3, FULL)
    assert experiment.config.max_steps == 2000
    episode = record(experiment)
    replay = replay_of(episode, "ppo", shares_of("ppo", episode.config))
    assert replay.liked is not None
    write_replay_page(tmp_path / "one.html", [replay], "64 robots")
    write_replay_page(tmp_path / "two.html", [replay, replay], "64 robots twice")
    assert (tmp_path / "one.html").stat().st_size < 2_500_000
    assert (tmp_path / "two.html").stat().st_size < 5_000_000


@pytest.fixture
def _pictures() -> None:
    """Skip a test of pictures if their packages are missing."""
    for package in ("PIL.Image", "pygame", "imageio_ffmpeg"):
        pytest.importorskip(package)


SMALL: dict[str, Any] = {"layout": "open", "num_agents": 3, "planner": "astar"}


def frames(path: Path) -> list[np.ndarray[Any, Any]]:
    with pytest.importorskip("PIL.Image").open(path) as film:
        return [np.array((film.seek(k), film.convert("RGB"))[1]) for k in range(film.n_frames)]


@pytest.mark.usefixtures("_pictures")
def test_film_has_ten_frames_a_second(tmp_path: Path) -> None:
    film(tmp_path / "a.gif", "follow", seconds=4.0, speed=2.0, pixels=100, **SMALL)
    film(tmp_path / "b.gif", "follow", begin=2.0, seconds=2.0, speed=2.0, pixels=100, **SMALL)
    long, late = frames(tmp_path / "a.gif"), frames(tmp_path / "b.gif")
    assert (len(long), len(late)) == (21, 11)
    assert max(long[0].shape[:2]) <= 128 + 1  # with the caption
    assert np.abs(long[-1].astype(int) - late[-1]).mean() < 2  # the same moment; only the palette differs


@pytest.mark.usefixtures("_pictures")
def test_filmed_robots_drive_as_in_an_evaluation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    filmed, poses = list[Any](), list[Any]()
    draw = films.draw
    monkeypatch.setattr(films, "draw", lambda scene, scale: (filmed.append(scene.pose.copy()), draw(scene, scale))[1])
    options: dict[str, Any] = {"layout": "narrow", "num_agents": 12, "planner": "astar"}
    film(tmp_path / "a.gif", "ppo", seed=3, begin=20.0, seconds=0.0, pixels=100, **options)
    experiment = make_experiment("ppo", EnvConfig(**options), 1, 20.0, 3)
    run(experiment, [lambda simulator, steps: poses.append(simulator.state.pose[0].copy())])
    np.testing.assert_array_equal(filmed[0], poses[-1])


@pytest.mark.parametrize(
    ("policies", "options", "message"),
    [((), {}, "at least one policy"), (("folow",), {}, "follow")],
)
def test_wrong_names_are_refused(policies: tuple[str, ...], options: Any, message: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=message):
        film(tmp_path / "none.gif", *policies, **options)
    assert not list(tmp_path.iterdir())


def row(policy: str, seed: int, goals: float, hits: float = 0.0, **more: Any) -> dict[str, Any]:
    """Return the row of an episode of 16 robots and 2 km."""
    return {
        "policy": policy, "layout": "hall", "robots": 16, "tasks": "lifelong", "planner": "astar", "seed": seed,
        "seconds": 600.0, "robot_km": 2.0, "collisions_robot": hits, "collisions_shelf": 0.0,
        "collisions_per_km": hits / 2, "goals_per_robot_hour": goals, "stuck": 0.0, "waiting_share": 0.1,
        "longest_standing_s": 5.0, **more,
    }  # fmt: skip


def test_worst_episodes_alternate_between_policies() -> None:
    rows = [
        row("a", 0, 1.0, 4.0), row("a", 1, 1.0, 8.0), row("a", 2, 1.0, 6.0),
        row("b", 0, 1.0), row("b", 1, 1.0, stuck=0.125), row("b", 2, 1.0, longest_standing_s=70.0),
    ]  # fmt: skip
    found = worst_episodes(rows, 5)
    assert [(row["policy"], row["seed"]) for row in found] == [("a", 1), ("b", 1), ("a", 2), ("b", 2), ("a", 0)]
    assert why(found[0]) == "8 collisions, no robots stuck at the end, 5 s the longest standing"
    assert why(found[1]) == "no collisions, 2 robots stuck at the end, 5 s the longest standing"
    assert why(found[1] | {"longest_standing_why": "robot 0 drives"}).endswith(" standing: robot 0 drives")
    assert worst_episodes([], 5) == []


def test_report_links_its_replays(
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
    assert page.count("<svg role=") == 2  # over robots, and where robots wait
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
