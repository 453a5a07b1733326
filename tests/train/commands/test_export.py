"""`warehouse export`: the model that it writes, what it says of it, and what it refuses to write."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agents import POLICIES
from agents.onnx_model import onnx_model
from train.cli import main
from train.commands import export
from train.commands.export import largest_difference

onnx = pytest.importorskip("onnx")
PPO = POLICIES["ppo"].weights


def shifted(by: float) -> bytes:
    """Return the model of `ppo` whose first output is too large by `by`."""
    assert PPO is not None
    model = onnx_model(PPO)
    (bias,) = (tensor for tensor in model.graph.initializer if tensor.name == "actor.2.bias")
    values = onnx.numpy_helper.to_array(bias).copy()
    values[0] += np.float32(by)
    bias.CopyFrom(onnx.numpy_helper.from_array(values, bias.name))
    return bytes(model.SerializeToString())


def test_the_command_writes_a_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target, weights = tmp_path / "new" / "head.onnx", POLICIES["reinforce"].weights
    assert main(["export", "--policy", "reinforce", "--onnx", str(target)]) == 0
    assert weights is not None
    apart = largest_difference(target.read_bytes(), weights)
    assert 0.0 < apart < 1e-5
    said = capsys.readouterr().out
    assert said.startswith(f"wrote the network of reinforce to {target}: ")
    assert f"{apart:.1e} of the largest one" in said


def test_a_model_that_computes_something_else_is_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = onnx.load_from_string(shifted(0.01))
    monkeypatch.setattr(export, "onnx_model", lambda directory: wrong)
    assert main(["export", "--onnx", str(tmp_path / "a.onnx")]) == 2
    shown = capsys.readouterr()
    assert "a.onnx was not written: its outputs differ from those of" in shown.err
    assert "more than 1e-05" in shown.err
    assert list(tmp_path.iterdir()) == []
