"""Policies of stable-baselines3 (PPO, A2C and DQN with MlpPolicy): from a model or its .zip file to our own tensors.

A .zip file of the library holds pickles, which can run any code, and none of them is opened here: tensors are read by
torch's reader of plain weights, the rest from the JSON beside them.
"""

from __future__ import annotations

import io
import json
import re
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from numpy.typing import NDArray

from agents.weights_folder import Activation, Mode, Network, PolicyRecord, save_policy
from warehouse_env.config import ActionType, EnvConfig, SensorSpec
from warehouse_env.errors import ConfigError, WarehouseError, WeightsError, shown
from warehouse_env.files import MOST, open_regular, zip_member
from warehouse_env.observation import observation_layout
from warehouse_env.traffic_spec import TrafficSpec

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

NOTED = "warehouse_env"  # attribute of a model, as `MetricsCallback` sets it: the EnvConfig that it is trained in
_DATA, _WEIGHTS, _MOST = "data", "policy.pth", 2**28  # [bytes] of each, unpacked
_TORCHS: dict[str, Activation] = {"LeakyReLU": "leaky_relu", "SiLU": "silu"}  # and by their names in lower case
_ZIP = b"PK\x03\x04"
_LAYER = re.compile(
    r"(?:(mlp_extractor\.(?:policy|value)_net|q_net\.q_net)\.(\d?\d?[02468])|action_net|value_net)\.(weight|bias)"
)
_UNUSED = re.compile(r"q_net_target\.")
_DAMAGE = (
    OSError, KeyError, ValueError, TypeError, EOFError, OverflowError, MemoryError, RuntimeError, RecursionError,
    AttributeError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip
_HOW = "agents.save_model(FOLDER, model, config) writes a folder that says so"

Tensors = dict[str, NDArray[Any]]


def save_model(
    directory: Path | str, model: BaseAlgorithm, config: EnvConfig | None = None, mode: Mode | None = None
) -> Path:
    """Write the policy of a model of stable-baselines3 as a policy folder, which every command takes as --policy.

    config: of the environment, where the model's own does not tell. mode: how actions are chosen, drawn from its
    chances if left out, of DQN the best. Raises WeightsError for a policy other than an MlpPolicy of PPO, A2C or DQN.
    """
    if config is None and model.get_env() is not None:
        config = model.get_env().get_attr("config")[0]  # type: ignore[union-attr]
    scaled = model.get_vec_normalize_env()
    if scaled is not None and scaled.norm_obs:
        raise WeightsError("the model sees normalised observations, which a policy folder does not hold")
    if config is None:
        raise ConfigError("the model has no environment; say as config=EnvConfig(...) in which one it was trained")
    state = {name: tensor.detach().cpu().numpy() for name, tensor in model.policy.state_dict().items()}
    kwargs = {**(model.policy_kwargs or {}), "activation_fn": _function(model)}
    about = {**vars(model), "policy_kwargs": kwargs, NOTED: config.to_dict()}
    record, tensors = _policy(f"this {type(model).__name__}", state, about)
    if mode is not None:
        record = PolicyRecord(record.algorithm, record.network, record.env, mode)
    return save_policy(directory, record, tensors)


def _function(model: BaseAlgorithm) -> str:
    """Return the class of a model's activation, as a .zip file names it."""
    found = getattr(model.policy, "activation_fn", None)
    return "" if found is None else str(found)


def read_model(path: Path) -> tuple[PolicyRecord, Tensors]:
    """Read a .zip file that `model.save` wrote, without its pickles; WeightsError with one sentence if that fails."""
    import torch

    try:
        with open_regular(path, "model", MOST, WeightsError) as file, zipfile.ZipFile(file) as archive:
            about, packed = json.loads(zip_member(archive, _DATA, _MOST)), zip_member(archive, _WEIGHTS, _MOST)
        if not packed.startswith(_ZIP):  # torch's older forms, whose plain reader was not safe before 2.6
            raise WeightsError(f"{path}: its {_WEIGHTS} is no zip file of plain tensors, as torch writes since 1.6")
        with zipfile.ZipFile(io.BytesIO(packed)) as inner:
            if sum(member.file_size for member in inner.infolist()) > _MOST:
                raise WeightsError(f"{path}: its {_WEIGHTS} would fill more than {_MOST >> 20} MB")
        state = torch.load(io.BytesIO(packed), map_location="cpu", weights_only=True)
        arrays = {str(name): tensor.detach().numpy() for name, tensor in state.items()}
    except WeightsError:
        raise
    except WarehouseError as error:
        raise WeightsError(f"{path}: {error}") from None
    except _DAMAGE as error:
        raise WeightsError(f"{path} is no model of stable-baselines3: {shown(error)}") from None
    except Exception as error:  # torch's reader has errors of pickle's kind for whatever is no plain tensor
        raise WeightsError(f"{path}: its {_WEIGHTS} holds more than plain tensors: {shown(error)}") from None
    if not isinstance(about, dict):
        raise WeightsError(f"{path} is no model of stable-baselines3: its {_DATA} is no object")
    return _policy(str(path), arrays, about)


def _policy(path: str, state: Mapping[str, NDArray[Any]], about: Mapping[str, Any]) -> tuple[PolicyRecord, Tensors]:
    """Return our record and tensors of the library's state; about: its attributes as far as they are plain."""
    tensors = _renamed(path, state)
    depth = {part: sum(name.startswith(f"{part}.") for name in tensors) // 2 for part in ("actor", "critic")}
    rows = {part: [tensors[f"{part}.{k}.weight"].shape[0] for k in range(n)] for part, n in depth.items()}
    q_net = "q_net.q_net.0.weight" in state
    network = Network(
        int(tensors["actor.0.weight"].shape[1]), rows["actor"][-1], "log_std" not in tensors, tuple(rows["actor"][:-1]),
        _activation(path, about, "relu" if q_net else "tanh"), tuple(rows["critic"][:-1]) if depth["critic"] else None,
    )  # fmt: skip
    env = _trained_in(path, about, network)
    algorithm = "dqn" if q_net else "ppo" if "clip_range" in about else "actor-critic"
    return PolicyRecord(f"{algorithm} (stable-baselines3)", network, env, "greedy" if q_net else "sample"), tensors


def _renamed(path: str, state: Mapping[str, NDArray[Any]]) -> Tensors:
    """Return the tensors under our names; WeightsError for one that is of no MlpPolicy of PPO, A2C or DQN."""
    tensors: Tensors = {}
    depth = {"actor": 0, "critic": 0}
    last: list[tuple[str, str, str]] = []
    for name, array in state.items():
        found = _LAYER.fullmatch(name)
        if name == "log_std" and array.ndim == 1:
            tensors[name] = array
        elif found is None and not _UNUSED.match(name):
            raise WeightsError(
                f"{path} has a tensor {shown(name)}; only MlpPolicy of PPO, A2C and DQN, as it is, can be read"
            )
        elif found is not None and found[2] is None:
            last.append(("critic" if name.startswith("value") else "actor", found[3], name))
        elif found is not None:
            part, place = "critic" if "value" in found[1] else "actor", int(found[2]) // 2
            tensors[f"{part}.{place}.{found[3]}"] = array
            depth[part] = max(depth[part], place + 1)
    for part, kind, name in last:
        tensors[f"{part}.{depth[part]}.{kind}"] = state[name]
    layers = [f"{part}.{k}" for part in depth for k in range(depth[part] + any(one[0] == part for one in last))]
    whole = {f"{layer}.{kind}" for layer in layers for kind in ("weight", "bias")}
    plain = all(array.ndim == 2 for name, array in tensors.items() if name.endswith("weight"))
    if "actor.0" not in layers or whole != tensors.keys() - {"log_std"} or not plain:
        raise WeightsError(f"{path} is no whole MlpPolicy of PPO, A2C or DQN")
    return tensors


def _activation(path: str, about: Mapping[str, Any], usual: Activation) -> Activation:
    """Return the activation that the text of policy_kwargs names."""
    given = about.get("policy_kwargs")
    given = given if isinstance(given, dict) else {}
    strange = {"features_extractor_class", "use_sde", "squash_output"} & {k for k, value in given.items() if value}
    if strange or about.get("use_sde") is True:
        raise WeightsError(f"{path} was made with {', '.join(strange) or 'use_sde'}, which cannot be read")
    text = str(given.get("activation_fn") or "")
    if not text:
        return usual
    name = text.strip("<>'").rpartition(".")[2]
    ours = _TORCHS.get(name, name.lower())
    if ours not in get_args(Activation):
        raise WeightsError(f"{path} has the activation {shown(name)}; known: {', '.join(get_args(Activation))}")
    return ours  # type: ignore[return-value]


def _trained_in(path: str, about: Mapping[str, Any], network: Network) -> EnvConfig:
    """Return the environment's config: as noted, or the default one with a sensor of the observation's size."""
    if isinstance(about.get(NOTED), str):
        raise WeightsError(f"{path} cannot be read: {about[NOTED]}")
    if NOTED in about:
        try:
            return EnvConfig.from_dict(about[NOTED])
        except WarehouseError as error:
            raise WeightsError(f"{path}: {error}") from None
    kinds: tuple[ActionType, ...] = ("discrete",) if network.discrete else ("continuous", "raw")
    if len(kinds) > 1:
        raise WeightsError(f"{path} does not tell what its real-valued actions mean; {_HOW}")
    choices = [
        EnvConfig(sensor=SensorSpec(predictions=told), traffic=TrafficSpec(shield=shield))
        for told in (False, True)
        for shield in (False, True)
    ]
    sizes = {observation_layout(config).size: config for config in choices}
    if network.observation_size not in sizes:
        raise WeightsError(
            f"{path} takes observations of {network.observation_size} values, the default environment gives "
            f"{', '.join(map(str, sorted(sizes)))}: {_HOW}"
        )
    return sizes[network.observation_size]
