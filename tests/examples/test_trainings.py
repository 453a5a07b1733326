"""The examples of trainings run for a few updates on the CPU, and every command drives what they save."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any

import pytest

from train.cli import main

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("ppo_gpu", {"device": "cpu", "steps": 600}, "768 agent-steps"),
        ("cleanrl_ppo", {"steps": 1200}, "1,152 agent-steps"),
        ("mappo", {"steps": 1200}, "1,152 agent-steps"),
        ("recurrent_ppo", {"steps": 600}, "512 agent-steps"),
    ],
)
def test_it_trains_and_saves_a_policy(
    name: str, options: dict[str, Any], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch, registries: None,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, name, example)
    spec.loader.exec_module(example)
    example.main(example.Options(worlds=2, robots=4, **options))
    assert said in capsys.readouterr().out
    if name == "ppo_gpu":
        with pytest.raises(SystemExit, match="device 'foo' must be 'cpu', 'cuda'"):
            example.main(example.Options(device="foo"))
    assert len((EXAMPLES / f"{name}.py").read_text().splitlines()) < 150
    policy = f"{EXAMPLES / name}.py:Remembering" if name == "recurrent_ppo" else f"runs/{name}"
    short = "--layout open --robots 2 --episodes 2 --seconds 2 --planner astar --traffic own:routes=false --no-pictures"
    assert main(["evaluate", "--policy", policy, *short.split()]) == 0
