"""A policy folder's actor as an ONNX model, for programs without this project or Python."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from agents.weights_folder import Activation, Network, PolicyRecord, read_record, read_tensors
from warehouse_env.errors import ConfigError
from warehouse_env.observation import observation_layout

if TYPE_CHECKING:
    from onnx import ModelProto, NodeProto

OPSET = 17  # of ONNX's operators: old enough for every runtime of the last years
INPUT, OUTPUT, DEVIATION = "observation", "output", "standard_deviation"


def onnx_model(directory: Path | str) -> ModelProto:
    """Return the actor of a policy folder as a checked ONNX model.

    Input `observation` float32[rows, D]; output `output` float32[rows, A]: logits, or means of real-valued actions,
    which then have a second output, `standard_deviation` float32[A]. Its metadata say what the numbers mean, as JSON.
    Raises WeightsError for a folder that is none, ConfigError where the library `onnx` is missing.
    """
    try:
        from onnx import TensorProto, checker, helper, numpy_helper
    except ImportError:
        raise ConfigError("ONNX models need the library onnx: pip install warehouse-env[onnx]") from None
    record = read_record(directory)
    network = record.network
    tensors = read_tensors(directory, network).items()
    outputs = [helper.make_tensor_value_info(OUTPUT, TensorProto.FLOAT, ["rows", network.actions])]
    nodes = _layers(network)
    if not network.discrete:
        nodes.append(helper.make_node("Exp", ["log_std"], [DEVIATION]))
        outputs.append(helper.make_tensor_value_info(DEVIATION, TensorProto.FLOAT, [network.actions]))
    inputs = [helper.make_tensor_value_info(INPUT, TensorProto.FLOAT, ["rows", network.observation_size])]
    actor = [(name, np.ascontiguousarray(array)) for name, array in tensors if not name.startswith("critic.")]
    weights = [numpy_helper.from_array(array, name) for name, array in actor]
    graph = helper.make_graph(nodes, record.algorithm, inputs, outputs, weights)
    model = helper.make_model(graph, producer_name="warehouse_env", opset_imports=[helper.make_opsetid("", OPSET)])
    model.ir_version = 8  # that of this set of operators
    helper.set_model_props(model, {name: json.dumps(value) for name, value in _meaning(record).items()})
    checker.check_model(model, full_check=True)
    return model


_OPERATORS: dict[Activation, str] = {
    "tanh": "Tanh", "relu": "Relu", "leaky_relu": "LeakyRelu", "elu": "Elu", "sigmoid": "Sigmoid",
}  # fmt: skip


def _layers(network: Network) -> list[NodeProto]:
    """Return the nodes of the actor: x W^T + b and the activation between its layers."""
    from onnx import helper

    nodes, x = [], INPUT
    depth, activation = len(network.hidden) + 1, network.activation
    for k in range(depth):
        last = k == depth - 1
        y = OUTPUT if last else f"sum.{k}"
        nodes.append(helper.make_node("Gemm", [x, f"actor.{k}.weight", f"actor.{k}.bias"], [y], transB=1))
        if not last:
            x = f"hidden.{k}"
            if activation == "silu":  # the operators of this age have none: x sigmoid(x)
                nodes.append(helper.make_node("Sigmoid", [y], [f"share.{k}"]))
                nodes.append(helper.make_node("Mul", [y, f"share.{k}"], [x]))
            else:
                nodes.append(helper.make_node(_OPERATORS[activation], [y], [x]))
    return nodes


def _meaning(record: PolicyRecord) -> dict[str, object]:
    """Return the meaning of the model's numbers: the observation's slices, and the actions."""
    env = record.env
    slices = {name: [part.start, part.stop] for name, part in observation_layout(env).slices.items()}
    seen = {name: ends for name, ends in slices.items() if ends[1] <= record.network.observation_size}
    meaning: dict[str, object] = {
        "observation": seen, "action_type": env.action_type, "mode": record.mode,
        "decision_seconds": env.time_step * env.action_repeat,
    }  # fmt: skip
    if record.network.discrete:
        meaning["actions"] = [[speed, offset] for speed in env.speed_levels for offset in env.lateral_offsets]
    return meaning
