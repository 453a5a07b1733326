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
MEMORY, NEXT = "memory", "next_memory"


def onnx_model(directory: Path | str) -> ModelProto:
    """Return the actor of a policy folder as a checked ONNX model.

    Input `observation` float32[rows, D]; output `output` float32[rows, A]: logits, or means of real-valued actions,
    which then have a second output, `standard_deviation` float32[A]. A network with a memory also takes `memory`
    float32[rows, H], zeros at first, and gives `next_memory`. Its metadata say what the numbers mean, as JSON.
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
    if network.memory:
        kept = [
            helper.make_tensor_value_info(name, TensorProto.FLOAT, ["rows", network.memory]) for name in (MEMORY, NEXT)
        ]
        inputs.append(kept[0])
        outputs.append(kept[1])
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
    """Return the nodes of the actor: x W^T + b, the activation between its layers, and its memory after the first."""
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
        if k == 0 and network.memory:
            nodes += _remembering(x)
            x = "remembered"
    return nodes


def _remembering(x: str) -> list[NodeProto]:
    """Return the nodes of a gated recurrent unit that reads x, and of x and its next memory side by side.

    ONNX has an operator for it, but with other gates first and for whole sequences.
    """
    from onnx import helper

    given, kept = [f"given.{gate}" for gate in range(3)], [f"kept.{gate}" for gate in range(3)]
    steps = (
        ("Add", [given[0], kept[0]], "reset.sum"), ("Sigmoid", ["reset.sum"], "reset"),
        ("Add", [given[1], kept[1]], "keep.sum"), ("Sigmoid", ["keep.sum"], "keep"),
        ("Mul", ["reset", kept[2]], "new.kept"), ("Add", [given[2], "new.kept"], "new.sum"),
        ("Tanh", ["new.sum"], "new"), ("Sub", [MEMORY, "new"], "change"), ("Mul", ["keep", "change"], "held"),
        ("Add", ["new", "held"], NEXT),
    )  # fmt: skip
    return [
        helper.make_node("Gemm", [x, "memory.weight_ih", "memory.bias_ih"], ["given"], transB=1),
        helper.make_node("Gemm", [MEMORY, "memory.weight_hh", "memory.bias_hh"], ["kept"], transB=1),
        helper.make_node("Split", ["given"], given, axis=1),
        helper.make_node("Split", ["kept"], kept, axis=1),
        *(helper.make_node(operator, inputs, [output]) for operator, inputs, output in steps),
        helper.make_node("Concat", [x, NEXT], ["remembered"], axis=1),
    ]


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
