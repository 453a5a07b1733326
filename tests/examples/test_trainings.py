"""Test that the example trainings run for a few updates on the CPU and save policies that can be evaluated."""

from __future__ import annotations

import importlib.util
import runpy
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

import warehouse_env
from train.cli import main
from warehouse_env import observation_layout

EXAMPLES = Path(__file__).parents[2] / "examples"


def loaded(name: str, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Import an example."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, name, example)
    spec.loader.exec_module(example)
    return example


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("ppo_gpu", {"device": "cpu", "steps": 600}, "768 agent-steps"),
        ("cleanrl_ppo", {"steps": 1200}, "1,152 agent-steps"),
        ("mappo", {"steps": 1200}, "1,152 agent-steps"),
        ("recurrent_ppo", {"steps": 600}, "512 agent-steps"),
        ("attention", {"steps": 1200}, "1,152 agent-steps"),
    ],
)
def test_example_trains_and_saves_a_policy(
    name: str, options: dict[str, Any], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch, registries: None,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    example = loaded(name, monkeypatch)
    example.main(example.Options(worlds=2, robots=4, **options))
    assert message in capsys.readouterr().out
    assert len((EXAMPLES / f"{name}.py").read_text().splitlines()) < 150
    made = {"recurrent_ppo": "Remembering", "attention": "Attending"}.get(name)
    policy = f"{EXAMPLES / name}.py:{made}" if made else f"runs/{name}"
    short = "--layout open --robots 2 --episodes 2 --seconds 2 --planner astar --traffic own:routes=false --no-pictures"
    assert main(["evaluate", "--policy", policy, *short.split()]) == 0


def test_attention_accepts_any_number_of_neighbours(monkeypatch: pytest.MonkeyPatch) -> None:
    """Use weights for three neighbours with seven: absent neighbours and their order do not matter."""
    example, learning = loaded("attention", monkeypatch), warehouse_env.LEARNING
    few, many = (learning.replace(sensor=replace(learning.sensor, neighbours=count)) for count in (3, 7))
    agent, other = example.Agent(few), example.Agent(many)
    other.load_state_dict(agent.state_dict())
    seen = torch.rand(5, observation_layout(few).size)
    part = observation_layout(few).slices["neighbours"]
    near = seen[:, part].view(5, 3, -1)
    near[:, :, -1] = 1.0
    spread = torch.cat((near.flip(1), torch.zeros(5, 4, near.shape[-1])), 1).flatten(1)
    more = torch.cat((seen[:, : part.start], spread, seen[:, part.stop :]), 1)
    for ours, theirs in zip(agent(seen), other(more), strict=True):
        assert torch.allclose(ours, theirs, atol=1e-6)
    near[0, 0, 0] += 1.0
    assert not torch.allclose(agent(seen)[1], other(more)[1], atol=1e-6)
    near[:, :, -1] = 0.0  # no neighbour is present
    assert agent(seen)[0].isfinite().all()


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
def test_wrong_option_is_one_sentence(
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
