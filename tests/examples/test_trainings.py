"""The examples of trainings run for a few updates on the CPU, and every command drives what they save."""

from __future__ import annotations

import importlib.util
import runpy
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
    assert len((EXAMPLES / f"{name}.py").read_text().splitlines()) < 150
    policy = f"{EXAMPLES / name}.py:Remembering" if name == "recurrent_ppo" else f"runs/{name}"
    short = "--layout open --robots 2 --episodes 2 --seconds 2 --planner astar --traffic own:routes=false --no-pictures"
    assert main(["evaluate", "--policy", policy, *short.split()]) == 0


WRONG = {
    "worlds 0": "worlds=0 must be a whole number from 1",
    "robots 0": "num_agents=0 must be",
    "robots 4000": "is too many for map",
    "steps -1": "steps=-1 must be a whole number from 1",
    "learning_rate nan": "learning_rate=nan must be a finite number",
    "seed -1": "seed=-1 must be a whole number from 0",
    "out /dev/null/policy": "/dev/null is no folder that can be written to",
    "layout nowhere": "unknown layout 'nowhere'",
    "device foo": "device 'foo' must be 'cpu', 'cuda'",
}
SCRIPTS = sorted(EXAMPLES.glob("*.py"))


@pytest.mark.parametrize(
    ("path", "wrong"),
    [(path, wrong) for path in SCRIPTS for wrong in WRONG if f"    {wrong.split()[0]}: " in path.read_text("utf-8")],
)
def test_a_wrong_option_is_one_sentence(
    path: Path, wrong: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    name, value = wrong.split()
    device = ["--device", "cpu"] if path.stem == "ppo_gpu" and name != "device" else []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(path), f"--{name}", value, *device])
    with pytest.raises(SystemExit) as stop:
        runpy.run_path(str(path), run_name="__main__")
    shown = capsys.readouterr()
    assert (stop.value.code, shown.out, shown.err.count("\n")) == (2, "", 1)
    assert WRONG[wrong] in shown.err
    assert not list(tmp_path.iterdir())
