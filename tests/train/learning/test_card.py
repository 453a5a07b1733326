"""The card says where a policy comes from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from agents import Network, PolicyRecord, save_policy
from agents.weights_folder import read_record, read_tensors
from train.learning.card import write_card
from warehouse_env.config import EnvConfig, SensorSpec


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a policy folder with a training record."""
    network = Network(3, 2, True, (4,))
    tensors = {name: np.zeros(shape, np.float32) for name, shape in network.shapes().items()}
    config = {"seed": 7, "threads": 2, "layouts": ["narrow"], "robots": [8, 16], "planner": "astar"}
    training = {"steps": 1_234_567, "updates": 89, "seconds": 600.0, "config": config, "last_figures": {"reward": 0.5}}
    env = EnvConfig(action_repeat=2, sensor=SensorSpec(predictions=True))
    return save_policy(tmp_path, PolicyRecord("reinforce", network, env, "sample", training), tensors)


def test_the_card_says_how_it_was_trained(folder: Path) -> None:
    text = write_card(folder).read_text()
    for part in (
        "10.0 minutes",
        "1,234,567 agent-steps",
        "| seed | 7 |",
        "| robots | 8, 16 |",
        "every 0.2 s",
        "no conflict",
    ):
        assert part in text
    assert "Not measured yet" in text
    assert "reward 0.5" in text


def test_the_card_tells_the_beginning(folder: Path) -> None:
    record = read_record(folder)
    record = replace(record, training=record.training | {"config": {"start": "ppo"}})
    text = write_card(save_policy(folder, record, read_tensors(folder, record.network))).read_text()
    assert "It began as the policy ppo." in text
    assert "no conflict" not in text
