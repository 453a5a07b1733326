"""`warehouse export`: a trained policy in a form that other programs read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from agents import POLICIES
from agents.onnx_model import onnx_model
from train.reporting.rows import check_writable
from warehouse_env.errors import ConfigError
from warehouse_env.files import complete_file


@dataclass(frozen=True)
class Export:
    """Write a trained policy as an ONNX model: its network, and what its numbers mean."""

    policy: str = "ppo"
    """A shipped policy with weights, or the folder of a trained one."""
    onnx: Path = Path("policy.onnx")
    """File to write."""

    def run(self) -> None:
        """Write the model, and say where."""
        entry = POLICIES.get(self.policy)
        if entry is not None and entry.weights is None:
            learned = ", ".join(name for name, other in POLICIES.items() if other.weights is not None)
            raise ConfigError(f"{self.policy} is a rule without weights; shipped policies with weights are: {learned}")
        directory = entry.weights if entry is not None and entry.weights is not None else Path(self.policy)
        check_writable(self.onnx)
        model = onnx_model(directory)
        with complete_file(self.onnx) as part:
            part.write_bytes(model.SerializeToString())
        print(f"wrote the network of {directory.name} to {self.onnx}")
