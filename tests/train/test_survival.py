"""Trainings that are killed, run out of disk, or go wrong: the last good weights stay, and one sentence says why."""

from __future__ import annotations

import subprocess
import sys
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


def weights(folder: Path) -> dict[str, np.ndarray[Any, Any]]:
    return load_file(folder / "weights.safetensors")


@pytest.mark.nightly
def test_killed_again_and_again_commands_come_to_the_same_files() -> None:
    command = [sys.executable, "-m", "tests.kills", "--kills", "8"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "to the same files as undisturbed" in done.stdout


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
