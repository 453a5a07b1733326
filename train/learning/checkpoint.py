"""Checkpoints without pickles: one safetensors file of arrays, and a JSON file that names it and is written last.

So a killed process leaves either the old checkpoint or the new one.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

from warehouse_env.errors import WeightsError, shown
from warehouse_env.files import MOST, complete_file, read_bytes, read_json, write_text

Arrays = Mapping[str, NDArray[Any]]
FORMAT = 1
_STATE, _LARGEST_STATE = "state.json", 16_000_000  # [bytes]


class Checkpoint(NamedTuple):
    """Arrays by name, and JSON data."""

    arrays: dict[str, NDArray[Any]]
    data: dict[str, Any]


def exists(directory: Path) -> bool:
    """Tell whether `directory` holds a complete checkpoint."""
    return (directory / _STATE).is_file()


def write(directory: Path, arrays: Arrays, data: Mapping[str, Any]) -> None:
    """Replace the checkpoint in `directory` (made if missing).

    Args:
        directory: of the checkpoint alone.
        arrays: of any shape and number type.
        data: JSON types; must hold "update", the number of updates done, which names the file.
    """
    name = f"arrays-{data['update']}.safetensors"
    with complete_file(directory / name) as part:
        part.write_bytes(save({key: np.ascontiguousarray(array) for key, array in arrays.items()}))
    write_text(directory / _STATE, json.dumps({"format": FORMAT, "arrays": name, **data}, indent=2) + "\n")
    for old in directory.iterdir():  # also what was left of one that was being written
        if old.suffix == ".safetensors" and old.name != name:
            old.unlink(missing_ok=True)


def read(directory: Path) -> Checkpoint:
    """Read the checkpoint; raises WeightsError in one sentence if there is none or it is damaged."""
    path = directory / _STATE
    if not path.is_file():
        raise WeightsError(f"{directory} holds no checkpoint to go on from: {_STATE} is missing")
    data = read_json(path, "checkpoint", _LARGEST_STATE, WeightsError)
    if not isinstance(data, dict) or data.get("format") != FORMAT or not isinstance(data.get("arrays"), str):
        raise WeightsError(f"the checkpoint {path} is damaged: it is not of format {FORMAT}")
    content = read_bytes(directory / Path(data["arrays"]).name, "checkpoint", MOST, WeightsError)
    try:
        arrays = load(content)
    except (ValueError, KeyError, SafetensorError) as error:
        raise WeightsError(f"the checkpoint {path} is damaged: {shown(error)}") from None
    return Checkpoint(arrays, data)


def optimizer_arrays(optimizer: torch.optim.Optimizer) -> dict[str, NDArray[Any]]:
    """Return the optimizer's state as arrays named optimizer.INDEX.NAME."""
    return {
        f"optimizer.{index}.{name}": value.detach().cpu().numpy()
        for index, state in optimizer.state_dict()["state"].items()
        for name, value in state.items()
        if isinstance(value, torch.Tensor)
    }


def load_optimizer(optimizer: torch.optim.Optimizer, arrays: Arrays) -> None:
    """Put the state of `optimizer_arrays` back."""
    state: dict[int, dict[str, torch.Tensor]] = {}
    for key, array in arrays.items():
        if key.startswith("optimizer."):
            _, index, name = key.split(".", 2)
            state.setdefault(int(index), {})[name] = torch.from_numpy(array.copy())
    optimizer.load_state_dict({"state": state, "param_groups": optimizer.state_dict()["param_groups"]})


def part_of(arrays: Arrays, prefix: str) -> dict[str, NDArray[Any]]:
    """Return the arrays whose name starts with `prefix`, without it."""
    return {key.removeprefix(prefix): array for key, array in arrays.items() if key.startswith(prefix)}
