"""Test that BenchMARL trains on our layouts and reports a wrong option in one sentence."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.pages import ROOT

SHORT = (
    "task=warehouse/open", "task.num_agents=3", "task.max_steps=40", "task.planner=astar", "experiment.max_n_iters=2",
    "experiment.on_policy_collected_frames_per_batch=400", "experiment.on_policy_n_envs_per_worker=4",
    "experiment.on_policy_n_minibatch_iters=1", "experiment.on_policy_minibatch_size=200",
    "experiment.evaluation_interval=400", "experiment.evaluation_episodes=2", "experiment.loggers=[csv]",
)  # fmt: skip


def command(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run the command in a folder, into which it writes."""
    line = [sys.executable, "-m", "warehouse_env.benchmarl", *SHORT, *words]
    settings = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(line, cwd=folder, env=settings, capture_output=True, text=True, check=False, timeout=300)


@pytest.mark.parametrize("continuous", [False, True])
@pytest.mark.parametrize("algorithm", ["mappo", "ippo"])
def test_benchmarl_trains(tmp_path: Path, algorithm: str, continuous: bool) -> None:
    ran = command(tmp_path, f"algorithm={algorithm}", f"experiment.prefer_continuous_actions={continuous}")
    assert ran.returncode == 0, ran.stderr
    for name in ("collection_robots_reward_episode_reward_mean", "eval_reward_episode_reward_mean"):
        (rows,) = tmp_path.rglob(f"{name}.csv")
        returns = [float(row.split(",")[1]) for row in rows.read_text().splitlines()]
        assert len(returns) == 2
        assert all(abs(value) < 1e3 for value in returns)


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("task.num_agents=0", "num_agents=0 must be a whole number"),
        ("task.layout=nowhere", "nowhere"),
        ("experiment.evaluation_interval=300", "evaluation_interval (300) is not a multiple"),
        ("task.num_agnts=3", "Could not override 'task.num_agnts'"),
    ],
)
def test_wrong_option_is_one_sentence(tmp_path: Path, word: str, message: str) -> None:
    ran = command(tmp_path, "algorithm=ippo", word)
    assert ran.returncode == 1
    assert message in ran.stderr
    assert "Traceback" not in ran.stderr
