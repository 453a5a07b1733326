"""Policies of stable-baselines3 (PPO, A2C and DQN with MlpPolicy) as policy folders."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from stable_baselines3 import DQN, PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.dqn.policies import DQNPolicy
from torch import nn

from agents.networks import tensors_of
from agents.weights_folder import Activation, Mode, Network, PolicyRecord, save_policy
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, WeightsError

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

_TORCHS: dict[str, Activation] = {"LeakyReLU": "leaky_relu"}  # the others have our name in lower case


def save_model(
    directory: Path | str, model: BaseAlgorithm, config: EnvConfig | None = None, mode: Mode | None = None
) -> Path:
    """Write the policy of a model of stable-baselines3 as a policy folder, which every command takes as --policy.

    config: of the environment; that of the model's own if left out. mode: how actions are chosen; by default drawn, of
    DQN the best. Raises WeightsError for a policy other than an MlpPolicy of PPO, A2C or DQN.
    """
    if config is None and model.get_env() is not None:
        config = model.get_env().get_attr("config")[0]  # type: ignore[union-attr]
    scaled = model.get_vec_normalize_env()
    if scaled is not None and scaled.norm_obs:
        raise WeightsError("the model sees normalised observations, which a policy folder does not hold")
    if config is None:
        raise ConfigError("the model has no environment; say as config=EnvConfig(...) in which one it was trained")
    layers = _layers(model)
    tensors = {
        f"{part}.{name}": array
        for part, found in layers.items()
        for name, array in tensors_of(nn.ModuleList(found)).items()
    }
    greedy, real = isinstance(model, DQN), getattr(model.policy, "log_std", None)
    if real is not None:
        tensors["log_std"] = real.detach().cpu().numpy()
    sizes = {part: tuple(layer.out_features for layer in found) for part, found in layers.items()}
    critic = None if greedy else sizes["critic"][:-1]
    *hidden, actions = sizes["actor"]
    inputs = layers["actor"][0].in_features
    network = Network(inputs, actions, real is None, tuple(hidden), _activation(model.policy), critic)
    algorithm = "dqn" if greedy else "ppo" if isinstance(model, PPO) else "actor-critic"
    chosen: Mode = mode or ("greedy" if greedy else "sample")
    return save_policy(directory, PolicyRecord(f"{algorithm} (stable-baselines3)", network, config, chosen), tensors)


def _layers(model: BaseAlgorithm) -> dict[str, list[nn.Linear]]:
    """Return the dense layers of actor and critic; WeightsError for a policy that consists of anything else."""
    policy = model.policy
    flat = getattr(policy, "features_extractor_class", None) is FlattenExtractor
    if flat and isinstance(policy, DQNPolicy):
        return {"actor": _linear(policy.q_net.q_net)}
    if flat and isinstance(policy, ActorCriticPolicy) and not policy.use_sde:
        inner = policy.mlp_extractor
        return {
            "actor": _linear(inner.policy_net, policy.action_net),
            "critic": _linear(inner.value_net, policy.value_net),
        }
    raise WeightsError(f"this {type(model).__name__} cannot be saved: only an MlpPolicy of PPO, A2C or DQN can")


def _linear(*modules: nn.Module) -> list[nn.Linear]:
    return [layer for module in modules for layer in module.modules() if isinstance(layer, nn.Linear)]


def _activation(policy: Any) -> Activation:
    name: str = policy.activation_fn.__name__
    ours = _TORCHS.get(name, name.lower())
    if ours not in get_args(Activation):
        raise WeightsError(f"the model has the activation {name}; known: {', '.join(get_args(Activation))}")
    return ours  # type: ignore[return-value]
