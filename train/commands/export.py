"""`warehouse export`: a trained policy in a form that other programs read."""

from dataclasses import dataclass
from pathlib import Path

from agents import weights_of
from agents.onnx_model import onnx_model
from train.job_files import OwnSensors
from warehouse_env.files import complete_file


@dataclass(frozen=True)
class Export(OwnSensors):
    """Write a trained policy as an ONNX model: its network, and what its numbers mean."""

    policy: str = "ppo"
    """A shipped policy with weights, or the folder of a trained one."""
    onnx: Path = Path("policy.onnx")
    """File to write."""

    def run(self) -> None:
        """Write the model."""
        directory = weights_of(self.policy)
        model = onnx_model(directory).SerializeToString()
        with complete_file(self.onnx) as part:
            part.write_bytes(model)
        print(f"wrote the network of {directory.name} to {self.onnx}")
