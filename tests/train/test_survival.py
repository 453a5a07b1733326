"""Trainings that are killed, run out of disk, or go wrong: the last good weights stay, and one sentence says why."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load_file

from agents import make_policy, policy_config
from tests.train.trainings import SMALL
from train import ppo, reinforce
from train.learning import checkpoint
from train.learning.config import PPOConfig, ReinforceConfig
from warehouse_env.config import EnvConfig
from warehouse_env.errors import WarehouseError

ROOT = Path(__file__).parents[2]
REINFORCE = (sys.executable, "-m", "train.cli", "train", "reinforce")
KILLS = int(os.environ.get("WAREHOUSE_TEST_KILLS", "3"))


def weights(folder: Path) -> dict[str, np.ndarray[Any, Any]]:
    return load_file(folder / "weights.safetensors")


def arguments(config: ReinforceConfig) -> list[str]:
    """Return a command line that begins the training `config`."""
    words = [*REINFORCE, "--out", str(config.out), "--steps", str(config.steps)]
    for name, value in SMALL.items():
        if name != "progress":
            words += [f"--{name.replace('_', '-')}", *map(str, value if isinstance(value, tuple) else (value,))]
    return [*words, "--no-progress"]


@pytest.mark.nightly
def test_killed_again_and_again_it_comes_to_the_same_bits(tmp_path: Path) -> None:
    """In each round it is killed 0 to 0.1 s after its first save: between saves, in one, or some updates later.

    The first round begins it, and its first save comes before any update; the others resume, and so does the end.
    """
    steps = 48 * 8 * (KILLS + 4)
    whole = reinforce.train(ReinforceConfig(out=tmp_path / "whole", steps=steps, **SMALL))
    config = ReinforceConfig(out=tmp_path / "killed", steps=steps)
    folder, rng, begun = config.directory, np.random.default_rng(0), arguments(config)
    for _ in range(KILLS):
        state = folder / "checkpoint" / "state.json"
        again = [*REINFORCE, "--resume", str(folder), "--no-progress"]
        before = state.stat().st_mtime_ns if state.is_file() else None
        process = subprocess.Popen(again if before else begun, cwd=ROOT, stderr=subprocess.PIPE)
        deadline = time.monotonic() + 120.0  # until it has saved, so that every round gets on
        while process.poll() is None and time.monotonic() < deadline:
            if state.is_file() and state.stat().st_mtime_ns != before:
                break
            time.sleep(0.005)
        time.sleep(rng.uniform(0.0, 0.1))
        process.send_signal(signal.SIGKILL)
        _, said = process.communicate()
        assert b"Error" not in said, said
        assert process.returncode == -signal.SIGKILL  # not through yet
    assert reinforce.train(ReinforceConfig(resume=folder, progress=False)) == folder
    for name, tensor in weights(whole).items():
        np.testing.assert_array_equal(weights(folder)[name], tensor)


def test_weights_that_are_no_numbers_are_not_saved(tmp_path: Path) -> None:
    begun = ppo.train(PPOConfig(out=tmp_path, steps=8 * 6, **SMALL))
    good = weights(begun)
    saved = checkpoint.read(begun / "checkpoint")
    data = saved.data | {"config": saved.data["config"] | {"learning_rate": 1e9, "gradient_clip": 1e9, "steps": 10**6}}
    arrays = saved.arrays | {
        name: array * 1e38 for name, array in saved.arrays.items() if "critic" in name and name.endswith("weight")
    }
    checkpoint.write(begun / "checkpoint", arrays, data)
    config = PPOConfig(resume=begun, progress=False)
    with pytest.raises(WarehouseError, match=r"weights that are not finite.*last good ones.*--learning-rate"):
        ppo.train(config)
    for name, tensor in weights(begun).items():
        np.testing.assert_array_equal(tensor, good[name])
    make_policy(begun, policy_config(begun, EnvConfig()))


def test_a_full_disk_is_one_sentence_and_the_last_checkpoint_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = reinforce.train(ReinforceConfig(out=tmp_path, steps=8 * 6, **SMALL))
    before = (folder / "checkpoint" / "state.json").read_bytes()
    saved = checkpoint.read(folder / "checkpoint")
    longer = saved.data["config"] | {"steps": 8 * 6 * 4}
    checkpoint.write(folder / "checkpoint", saved.arrays, saved.data | {"config": longer})
    kept = (folder / "checkpoint" / "state.json").read_bytes()
    assert kept != before

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    config = ReinforceConfig(resume=folder, progress=False)
    with pytest.raises(WarehouseError, match=r"cannot write .*No space left on device"):
        reinforce.train(config)
    assert (folder / "checkpoint" / "state.json").read_bytes() == kept
    monkeypatch.undo()
    assert reinforce.train(config) == folder
