"""Checkpoints without pickles: one safetensors file of arrays, and a JSON file that names it and is written last.

So a killed process leaves either the old checkpoint or the new one. CARD.md of a policy folder tells what it was
trained on, and for how long.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

from agents.weights_folder import PolicyRecord, read_record
from train.kinds import Kinds
from train.learning.config import HELD_OUT_SEED
from train.reporting.report import no_html
from warehouse_env.checked import from_plain
from warehouse_env.errors import WeightsError, shown
from warehouse_env.files import MOST, complete_file, read_bytes, read_json, write_text
from warehouse_env.traffic_spec import written_traffic

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
    """Replace the checkpoint in `directory`, which holds nothing else and is made if missing.

    arrays: of any shape and number type. data: JSON types, with "update", the number of updates done.
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


CARD = "CARD.md"
_ADVISED = (
    " The untrained policy prefers the fastest command for which the observation predicts no conflict; what training "
    "adds is the difference to that."
)
_END = f"""\
Training seeds lie below {HELD_OUT_SEED:,}, evaluation seeds from there on.

## Measured

Not measured yet: `warehouse evaluate --policy` this folder.

## Limits

One training run in simulation with exact sensing. It lowers collisions, it does not exclude them: a real vehicle needs
its own certified protective field.
"""


def write_card(directory: Path) -> Path:
    """Write the card of the policy in `directory` from its config.json; return its path. WeightsError if it is none."""
    record = read_record(directory)
    name = record.training.get("config", {}).get("name", "policy")
    parts = [f"# {name}", _origin(record), _options(record.training), _END]
    write_text(directory / CARD, "\n\n".join(parts))
    return directory / CARD


def _origin(record: PolicyRecord) -> str:
    env, network, training = record.env, record.network, record.training
    kind = "one of {} commands (speed x offset from the route)" if network.discrete else "{} real-valued commands"
    minutes, steps, updates = training.get("seconds", 0.0) / 60.0, training.get("steps", 0), training.get("updates", 0)
    config = training.get("config", {})
    fleet, start = config.get("fleet"), config.get("start")
    begun = f" It began as the policy {start}." if start else _ADVISED * env.sensor.predictions
    return (
        f"A policy for one robot among many: from its own observation of {network.observation_size} numbers to "
        f"{kind.format(network.actions)} every {env.time_step * env.action_repeat:g} s. Actions are chosen by: "
        f"{record.mode}. It drives with traffic `{written_traffic(env.traffic_spec)}`."
        f"\n\nTrained by {record.algorithm} for {minutes:.1f} minutes: {steps:,} agent-steps in {updates:,} updates"
        f"{f', with {from_plain(Kinds, fleet).words}' if fleet else ''}.{begun}"
    )


def _options(training: dict[str, Any]) -> str:
    lines = ["## How it was trained", "", "| option | value |", "|---|---|"]
    for name, value in training.get("config", {}).items():
        shown = ", ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)
        lines += [f"| {name} | {no_html(shown)} |"] * (name != "out")
    lines += [f"| {name} (version) | {value} |" for name, value in training.get("versions", {}).items()]
    figures = training.get("last_figures", {})
    if figures:
        shown = ", ".join(f"{name} {value:.4g}" for name, value in figures.items() if name != "steps_per_second")
        lines += ["", f"Last figures of the training itself (its own worlds, exploring; they flatter): {shown}."]
    return "\n".join(lines)
