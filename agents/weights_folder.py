"""A learned policy on disk: weights.safetensors, config.json, CARD.md. Read without torch and without pickles."""

import dataclasses
import itertools
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

from warehouse_env.checked import Checked, from_plain
from warehouse_env.config import EnvConfig
from warehouse_env.errors import WarehouseError, WeightsError
from warehouse_env.files import complete_file, read_bytes, read_json, write_text

FORMAT = 1
WEIGHTS, CONFIG = "weights.safetensors", "config.json"
_LARGEST_CONFIG, _LARGEST_WEIGHTS = 16_000_000, 2_000_000_000  # [bytes]
_SIZES = 1, 10**9
Mode = Literal["sample", "greedy"]
Activation = Literal["tanh", "relu", "leaky_relu", "elu", "silu", "sigmoid"]
Tensors = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Network(Checked):
    """Sizes of an actor and a critic, separate networks of dense layers, and the activation between the layers."""

    observation_size: int
    actions: int  # number of discrete actions, or length of a real-valued one
    discrete: bool
    hidden: tuple[int, ...] = (128, 128)  # of the actor; () for one layer alone
    activation: Activation = "tanh"  # after each layer but the last
    critic_hidden: tuple[int, ...] | None = None  # None: as the actor's
    ranges: ClassVar = {"observation_size": _SIZES, "actions": _SIZES, "hidden": _SIZES, "critic_hidden": _SIZES}

    def sizes(self, part: str) -> list[tuple[int, int]]:
        """Return (inputs, outputs) of each layer of the "actor" or the "critic"."""
        actor = part == "actor"
        hidden = self.hidden if actor or self.critic_hidden is None else self.critic_hidden
        return list(itertools.pairwise((self.observation_size, *hidden, self.actions if actor else 1)))

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the name and shape of every tensor of a weights file; those of the critic may all be missing."""
        shapes: dict[str, tuple[int, ...]] = {} if self.discrete else {"log_std": (self.actions,)}
        for part in ("actor", "critic"):
            for index, (inputs, outputs) in enumerate(self.sizes(part)):
                shapes |= {f"{part}.{index}.weight": (outputs, inputs), f"{part}.{index}.bias": (outputs,)}
        return shapes


@dataclass(frozen=True)
class PolicyRecord(Checked):
    """The content of config.json: enough to rebuild the policy, and its origin."""

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

    tensors: actor.K.weight [outputs, inputs] and actor.K.bias of layers K = 0, 1, ...; log_std of real-valued actions;
    critic.K.weight and critic.K.bias, which may be left out. Raises WeightsError if they do not fit `record.network`.
    """
    directory = Path(directory)
    given = checked_tensors(directory / WEIGHTS, record.network, tensors)
    directory.mkdir(parents=True, exist_ok=True)
    arrays = {name: np.ascontiguousarray(array) for name, array in given.items()}
    with complete_file(directory / WEIGHTS) as part:
        part.write_bytes(save(arrays))  # the library's own file would be readable by its owner alone
    write_text(directory / CONFIG, json.dumps(record.to_dict(), indent=2) + "\n")
    return directory


def read_record(directory: Path | str) -> PolicyRecord:
    """Read config.json; raises WeightsError with one sentence if it is missing, damaged or of another format."""
    path = Path(directory) / CONFIG
    if not path.is_file():
        raise WeightsError(f"{directory} is not a policy folder: it has no {CONFIG}")
    data = read_json(path, "policy record", _LARGEST_CONFIG, WeightsError)
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
    content = read_bytes(path, "weights", _LARGEST_WEIGHTS, WeightsError)
    try:
        tensors = load(content)
    except (SafetensorError, KeyError, ValueError) as error:
        raise WeightsError(f"{path} is damaged or no safetensors file: {error}") from None
    return checked_tensors(path, network, tensors)


def checked_tensors(path: Path | str, network: Network, tensors: Tensors) -> dict[str, NDArray[np.float32]]:
    """Return tensors as float32; WeightsError for the first that is missing, unknown, misshapen, or not finite."""
    shapes = network.shapes()
    if not any(name.startswith("critic.") for name in tensors):  # only a training asks for it
        shapes = {name: shape for name, shape in shapes.items() if not name.startswith("critic.")}
    missing, foreign = sorted(set(shapes) - set(tensors)), sorted(set(tensors) - set(shapes))
    if missing or foreign:
        wrong = f"lacks {missing[0]}" if missing else f"holds an unknown tensor {foreign[0]}"
        raise WeightsError(f"{path} {wrong}: it does not fit the network of {CONFIG}")
    for name, shape in shapes.items():
        if tuple(tensors[name].shape) != shape:
            raise WeightsError(f"{path}: {name} has shape {tuple(tensors[name].shape)}, {CONFIG} asks for {shape}")
        if not np.isfinite(np.asarray(tensors[name], dtype=np.float32)).all():
            raise WeightsError(f"{path}: {name} holds a value that is not finite")
    return {name: np.asarray(array, dtype=np.float32) for name, array in tensors.items()}
