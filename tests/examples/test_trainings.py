"""The examples of trainings run for a few updates on the CPU, and save what every command takes."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any

import pytest

from agents import make_policy, policy_config
from warehouse_env import EnvConfig

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("ppo_gpu", {"device": "cpu", "steps": 600}, "768 agent-steps"),
        ("cleanrl_ppo", {"steps": 1200}, "1,152 agent-steps"),
        ("mappo", {"steps": 1200}, "1,152 agent-steps"),
    ],
)
def test_it_trains_and_saves_a_policy(
    name: str, options: dict[str, Any], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, name, example)
    spec.loader.exec_module(example)
    example.main(example.Options(worlds=2, robots=4, out=tmp_path / "mine", **options))
    assert said in capsys.readouterr().out
    assert len((EXAMPLES / f"{name}.py").read_text().splitlines()) < 150
    assert make_policy(tmp_path / "mine", policy_config(tmp_path / "mine", EnvConfig(num_agents=4))) is not None
