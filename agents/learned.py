"""Policies from a folder of weights. The forward pass is our own: as fast as torch for a few robots, and lighter."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from agents.forward import forward
from agents.policy import Action, Observation, draw_discrete
from agents.weights_folder import PolicyRecord, read_record, read_tensors
from warehouse_env.config import EnvConfig
from warehouse_env.errors import WeightsError
from warehouse_env.observation import observation_layout
from warehouse_env.traffic_spec import driven_with

_ALWAYS_NEEDED = ("action_type", "time_step", "action_repeat", "sensor")
_NEEDED_IF_DISCRETE = ("speed_levels", "lateral_offsets")


def needed_fields(record: PolicyRecord) -> tuple[str, ...]:
    """Return the names of the EnvConfig fields that must be as its record says for the policy to make sense."""
    return _ALWAYS_NEEDED + (_NEEDED_IF_DISCRETE if record.env.action_type == "discrete" else ())


def config_for(directory: Path | str, base: EnvConfig) -> EnvConfig:
    """Return `base` with the action, the sensor and the options that the policy in `directory` is made for."""
    record = read_record(directory)
    traffic = driven_with(base.traffic_spec, record.env.traffic_spec)
    return base.replace(traffic=traffic, **{name: getattr(record.env, name) for name in needed_fields(record)})


class LearnedPolicy:
    """The actor of a policy folder: its network, then a draw or the best action."""

    def __init__(self, directory: Path | str, config: EnvConfig) -> None:
        """Load and check the folder; raises WeightsError if it is damaged or does not fit `config`."""
        self.record = read_record(directory)
        tensors = read_tensors(directory, self.record.network)
        self._check_fit(directory, config)
        parts = [f"actor.{k}" for k in range(len(self.record.network.hidden) + 1)]
        self._layers = [(np.ascontiguousarray(tensors[f"{k}.weight"].T), tensors[f"{k}.bias"]) for k in parts]
        self._std = None if self.record.network.discrete else np.exp(tensors["log_std"])

    def _check_fit(self, directory: Path | str, config: EnvConfig) -> None:
        for field in needed_fields(self.record):
            trained, given = getattr(self.record.env, field), getattr(config, field)
            if trained != given:
                fits = "agents.policy_config puts in what it needs"
                raise WeightsError(f"{directory} is made for {field}={trained}, not {given}; {fits}")
        shielded = bool(self.record.env.traffic_spec.shield)
        if shielded and not config.traffic_spec.shield:
            raise WeightsError(f'{directory} was trained under the shield, and needs it: traffic="shield"')
        # slices of field, goal and needs come last, so a policy that was trained without them reads what it knows
        passing = self.record.env.arrival == "pass"
        works = self.record.env.works
        seen = config if works else config.replace(service=None, orders=None, battery=None)
        seen = seen.replace(arrival="pass") if passing else seen
        if passing and not shielded:
            seen = seen.replace(traffic="none")
        size, network = observation_layout(seen).size, self.record.network
        if network.observation_size != size:
            given = f"observations of {network.observation_size} values"
            raise WeightsError(f"{directory} was made for {given}, not {size}")
        discrete = config.action_type == "discrete"
        actions = len(config.speed_levels) * len(config.lateral_offsets) if discrete else 2
        if (network.discrete, network.actions) != (discrete, actions):
            kind = "discrete" if network.discrete else "real-valued"
            raise WeightsError(f"{directory} has {network.actions} {kind} actions; the environment takes {actions}")

    def output(self, observation: Observation) -> NDArray[np.float32]:
        """Return logits, or means of real-valued actions, float32[..., A] from float32[..., D]."""
        network = self.record.network
        return forward(self._layers, observation[..., : network.observation_size], network.activation)

    @property
    def drawn(self) -> bool:
        """Whether actions are drawn, rather than the most probable ones."""
        return self.record.mode == "sample"

    preferences = output  # the logits of discrete actions

    def act(self, observation: Observation, rng: np.random.Generator) -> Action:
        """Choose actions by the mode of config.json: drawn with `rng`, or the most probable (shapes: `Policy.act`)."""
        output = self.output(observation)
        if self._std is None:
            return draw_discrete(output, rng) if self.drawn else np.argmax(output, axis=-1)
        if self.drawn:
            output += self._std * rng.standard_normal(output.shape, dtype=np.float32)
        return np.clip(output, -1.0, 1.0)
