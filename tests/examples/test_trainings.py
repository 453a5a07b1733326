"""The example of a training on a device learns on the CPU too, and saves what every command takes."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

from agents import make_policy
from warehouse_env import EnvConfig, SensorSpec

EXAMPLE = Path(__file__).parents[2] / "examples" / "ppo_gpu.py"


def test_it_trains_and_saves_a_policy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = importlib.util.spec_from_file_location("ppo_gpu", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "ppo_gpu", example)
    spec.loader.exec_module(example)
    example.main(example.Options(device="cpu", worlds=2, robots=4, steps=600, out=tmp_path / "mine"))
    assert "768 agent-steps" in capsys.readouterr().out
    config = EnvConfig(num_agents=4, sensor=SensorSpec(predictions=True))
    assert make_policy(tmp_path / "mine", config) is not None
