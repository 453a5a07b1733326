"""Test that a killed sweep of docs/how_to/sweep.md, made small, finishes every trial when restarted."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from agents.weights_folder import read_record
from tests.pages import ROOT, python_blocks
from train.learning import checkpoint
from train.learning.config import ThreadedPPOConfig
from train.trainers import train

pytest.importorskip("ray.tune")
SMALL: dict[str, Any] = {
    "layouts": ("open",), "robots": (4,), "rows": 64, "planner": "astar", "episode_seconds": 10.0, "hidden": (24,),
    "checkpoint_seconds": 0.0, "evaluation_seconds": 0.01,
}  # fmt: skip
SHORTER = {"STEPS = 10_000_000": "STEPS = 150_000", "num_samples=12": "num_samples=2"}


def script() -> str:
    """Return the page's script with trainings of a few seconds."""
    source = next(block.source for block in python_blocks() if "tune.Tuner" in block.source)
    for long, short in SHORTER.items():
        assert long in source
        source = source.replace(long, short)
    begun = source.index("OPTIONS = ")
    return source[:begun] + f"OPTIONS = {SMALL!r}" + source[source.index("\n", begun) :]


def begin(folder: Path) -> subprocess.Popen[str]:
    """Start the script in its own process group."""
    settings = {
        "PYTHONPATH": str(ROOT), "HOME": str(folder), "RAY_USAGE_STATS_ENABLED": "0", "RAY_AUTH_MODE": "disabled",
    }  # fmt: skip
    words = [sys.executable, "sweep.py"]
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    return subprocess.Popen(words, cwd=folder, env=os.environ | settings, start_new_session=True, **pipes)


def updates(policies: Path) -> list[int]:
    """Return the number of updates in each trial's checkpoint."""
    return [checkpoint.read(path.parent).data["update"] for path in policies.glob("*/checkpoint/state.json")]


def test_killed_sweep_resumes_to_its_end(tmp_path: Path) -> None:
    (tmp_path / "sweep.py").write_text(script())
    policies, deadline = tmp_path / "sweep" / "policies", time.monotonic() + 240.0
    killed = begin(tmp_path)
    while killed.poll() is None and max(updates(policies), default=0) < 3 and time.monotonic() < deadline:
        time.sleep(0.05)
    os.killpg(killed.pid, signal.SIGKILL)
    killed.communicate()
    assert killed.returncode == -signal.SIGKILL
    begun = {path.name for path in policies.iterdir()}
    time.sleep(3.0)  # its workers need time to notice
    again = begin(tmp_path)
    printed, _ = again.communicate(timeout=240.0)
    assert again.returncode == 0, printed
    assert "goes on with" in printed
    trials = {path.name: read_record(path).training for path in policies.iterdir()}
    assert len(trials) == 2
    assert begun <= trials.keys()
    assert [training["spent"] for training in trials.values()] == [1.0, 1.0]
    name = min(begun)
    options = {option: trials[name]["config"][option] for option in ("learning_rate", "entropy_first")}
    whole = train(
        ThreadedPPOConfig(out=tmp_path, name="whole", steps=150_000, threads=1, progress=False, **SMALL, **options)
    )
    assert (whole / "weights.safetensors").read_bytes() == (policies / name / "weights.safetensors").read_bytes()
