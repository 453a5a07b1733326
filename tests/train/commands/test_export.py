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
from train.reporting.rows import read_rows

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


def test_the_command_writes_a_model_and_a_row(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target, row_file = tmp_path / "new" / "head.onnx", tmp_path / "rows.jsonl"
    arguments = ["export", "--policy", "reinforce", "--onnx", str(target), "--json", str(row_file), "--seed", "3"]
    assert main(arguments) == 0
    (row,) = read_rows(row_file)
    weights = POLICIES["reinforce"].weights
    assert weights is not None
    apart = row.pop("largest_difference")
    assert (
        apart
        == largest_difference(target.read_bytes(), weights, 3)
        != largest_difference(target.read_bytes(), weights, 4)
    )
    assert 0.0 < apart < 1e-5
    assert row == {
        "policy": "reinforce", "onnx": str(target), "bytes": target.stat().st_size, "observation_size": 112,
        "actions": 20, "discrete": True, "seed": 3,
    }  # fmt: skip
    said = capsys.readouterr().out
    assert said.startswith(f"wrote the network of reinforce to {target}: ")
    assert f"{apart:.1e} of the largest one" in said


def test_a_model_that_computes_something_else_is_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = onnx.load_from_string(shifted(0.01))
    monkeypatch.setattr(export, "onnx_model", lambda directory: wrong)
    assert main(["export", "--onnx", str(tmp_path / "a.onnx"), "--json", str(tmp_path / "rows.jsonl")]) == 2
    shown = capsys.readouterr()
    assert "a.onnx was not written: its outputs differ from those of" in shown.err
    assert "more than 1e-05" in shown.err
    assert list(tmp_path.iterdir()) == []
