"""Run the Python blocks of docs/ that need client packages (RLlib, TorchRL), shortened."""

from __future__ import annotations

import math

import pytest

from tests.clients.conftest import INSTALLED
from tests.pages import Block, python_blocks

BLOCKS = [block for block in python_blocks() if block.clients and "tune.Tuner" not in block.source]  # see test_sweep.py


def test_pages_have_blocks_for_each_client() -> None:
    assert {name for block in BLOCKS for name in block.clients} == {"ray", "supersuit", "torchrl"}


@pytest.mark.parametrize("block", BLOCKS, ids=str)
def test_python_block_runs(block: Block, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    if not all(INSTALLED[name] for name in block.clients):
        pytest.skip("`make clients` has an environment with what it needs")
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    result = block.run().get("result")  # of RLlib
    assert math.isfinite(result["learners"]["shared"]["total_loss"]) if result else capsys.readouterr().out
