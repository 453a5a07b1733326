"""`warehouse export`: a trained policy in a form that other programs read."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from agents import weights_of
from agents.learned import LearnedPolicy
from agents.onnx_model import INPUT, OUTPUT, onnx_model
from agents.weights_folder import read_record
from train.job_files import OwnSensors
from warehouse_env.errors import WarehouseError
from warehouse_env.files import complete_file

ROWS = 256  # random observations on which model and policy are compared
MOST_APART = 1e-5  # shares of the largest output: the sums behind logits of 30 are rounded by 1e-5 themselves


@dataclass(frozen=True)
class Export(OwnSensors):
    """Write a trained policy as an ONNX model: its network, and what its numbers mean."""

    policy: str = "ppo"
    """A shipped policy with weights, or the folder of a trained one."""
    onnx: Path = Path("policy.onnx")
    """File to write."""

    def run(self) -> None:
        """Write the model if it computes what the policy does, and say how nearly; WarehouseError if it does not."""
        directory = weights_of(self.policy)
        model = onnx_model(directory).SerializeToString()
        apart = largest_difference(model, directory)
        if not apart <= MOST_APART:
            raise WarehouseError(
                f"{self.onnx} was not written: its outputs differ from those of {directory} by up to {apart:.1e} "
                f"of the largest one, more than {MOST_APART:g}"
            )
        with complete_file(self.onnx) as part:
            part.write_bytes(model)
        print(
            f"wrote the network of {directory.name} to {self.onnx}: on {ROWS} random observations its outputs differ "
            f"from the policy's by {apart:.1e} of the largest one at most"
        )


def largest_difference(model: bytes, directory: Path) -> float:
    """Return by how much outputs of a model and of the policy's own forward pass differ at most.

    On random observations, in shares of the largest output, or of 1 where that is less.
    """
    from onnx.reference import ReferenceEvaluator

    record = read_record(directory)
    shape = (ROWS, record.network.observation_size)
    rng = np.random.default_rng(0)
    given = {INPUT: rng.uniform(-1.0, 1.0, shape).astype(np.float32)}
    own = LearnedPolicy(directory, record.env).output(given[INPUT])
    outputs: list[Any] = ReferenceEvaluator(model).run([OUTPUT], given)  # type: ignore[assignment]
    return float(np.abs(outputs[0] - own).max() / max(np.abs(own).max(), 1.0))
