"""A learned policy on disk: weights.safetensors, config.json, CARD.md. Read without torch and without pickles."""

from __future__ import annotations

import dataclasses
import itertools
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load_file, save

from warehouse_env.checked import Checked, from_plain
from warehouse_env.config import EnvConfig
from warehouse_env.errors import WarehouseError, WeightsError
from warehouse_env.files import complete_file

FORMAT = 1
WEIGHTS, CONFIG = "weights.safetensors", "config.json"
Mode = Literal["sample", "greedy"]
Tensors = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Network(Checked):
    """Sizes of an actor and a critic that are separate tanh networks."""

    observation_size: int
    actions: int  # number of discrete actions, or length of a real-valued one
    discrete: bool
    hidden: tuple[int, ...] = (128, 128)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._between(1, 10**9, "observation_size", "actions", "hidden")

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the name and shape of every tensor that a weights file must hold."""
        shapes: dict[str, tuple[int, ...]] = {} if self.discrete else {"log_std": (self.actions,)}
        for part, last in (("actor", self.actions), ("critic", 1)):
            sizes = (self.observation_size, *self.hidden, last)
            for index, (inputs, outputs) in enumerate(itertools.pairwise(sizes)):
                shapes[f"{part}.{index}.weight"] = (outputs, inputs)
                shapes[f"{part}.{index}.bias"] = (outputs,)
        return shapes


@dataclass(frozen=True)
class PolicyRecord(Checked):
    """What config.json holds: enough to rebuild the policy and to know where it came from."""

    algorithm: str
    network: Network
    env: EnvConfig  # of the training; the policy needs its action and sensor
    mode: Mode = "sample"  # how actions are chosen, and how the measured figures were made
    training: dict[str, Any] = field(default_factory=dict)  # steps, seconds, seed, trainer's config ...

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON types."""
        return {"format": FORMAT, **dataclasses.asdict(self)}


def save_policy(directory: Path | str, record: PolicyRecord, tensors: Tensors) -> Path:
    """Write the policy into `directory` (made if missing), each file as a whole or not at all.

    Raises WeightsError if the tensors are not those that `record.network` asks for.
    """
    directory = Path(directory)
    _check_tensors(directory / WEIGHTS, record.network, tensors)
    directory.mkdir(parents=True, exist_ok=True)
    arrays = {name: np.ascontiguousarray(array, dtype=np.float32) for name, array in tensors.items()}
    with complete_file(directory / WEIGHTS) as part:
        part.write_bytes(save(arrays))  # the library's own file would be readable by its owner alone
    write_text(directory / CONFIG, json.dumps(record.to_dict(), indent=2) + "\n")
    return directory


def write_text(path: Path, text: str) -> None:
    """Write a text file as a whole or not at all."""
    with complete_file(path) as part:
        part.write_text(text, encoding="utf-8")


def read_record(directory: Path | str) -> PolicyRecord:
    """Read config.json; raises WeightsError with one sentence if it is missing, damaged or of another format."""
    path = Path(directory) / CONFIG
    if not path.is_file():
        raise WeightsError(f"{directory} is not a policy folder: it has no {CONFIG}")
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise WeightsError(f"{path} cannot be read as JSON: {error}") from None
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        found = data.get("format") if isinstance(data, dict) else None
        raise WeightsError(f"{path} has format {found!r}; this version reads format {FORMAT}")
    try:
        return from_plain(PolicyRecord, {name: value for name, value in data.items() if name != "format"})
    except WarehouseError as error:
        raise WeightsError(f"{path}: {error}") from None


def read_tensors(directory: Path | str, network: Network) -> dict[str, NDArray[np.float32]]:
    """Read weights.safetensors; raises WeightsError if it is missing, truncated, or has other names or shapes."""
    path = Path(directory) / WEIGHTS
    if not path.is_file():
        raise WeightsError(f"{directory} is not a policy folder: it has no {WEIGHTS}")
    try:
        tensors = load_file(path)
    except (SafetensorError, OSError, ValueError) as error:
        raise WeightsError(f"{path} is damaged or no safetensors file: {error}") from None
    _check_tensors(path, network, tensors)
    return {name: np.asarray(array, dtype=np.float32) for name, array in tensors.items()}


def _check_tensors(path: Path, network: Network, tensors: Tensors) -> None:
    """Raise WeightsError for the first tensor that is missing, unknown, of the wrong shape, or not finite."""
    shapes = network.shapes()
    missing, foreign = sorted(set(shapes) - set(tensors)), sorted(set(tensors) - set(shapes))
    if missing or foreign:
        wrong = f"lacks {missing[0]}" if missing else f"holds an unknown tensor {foreign[0]}"
        raise WeightsError(f"{path} {wrong}: it does not fit the network of {CONFIG}")
    for name, shape in shapes.items():
        if tuple(tensors[name].shape) != shape:
            raise WeightsError(f"{path}: {name} has shape {tuple(tensors[name].shape)}, {CONFIG} asks for {shape}")
        if not np.isfinite(np.asarray(tensors[name], dtype=np.float32)).all():
            raise WeightsError(f"{path}: {name} holds a value that is not finite")
