"""A registry of policies, each made for one environment configuration."""

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.learned import LearnedPolicy, config_for
from agents.policy import Actor, Policy, Recurrent
from agents.reciprocal import Reciprocal
from agents.rules import Brake, Follow, Rules
from agents.weights_folder import CONFIG, Mode, Network, PolicyRecord, read_record, read_tensors, save_policy
from warehouse_env import plugins
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, WeightsError, shown
from warehouse_env.files import whereabouts
from warehouse_env.observation import observation_layout
from warehouse_env.old_names import POLICIES as OLD_POLICIES
from warehouse_env.traffic_spec import driven_with

__all__ = [
    "POLICIES", "WEIGHTS_FOLDER", "Actor", "LearnedPolicy", "Network", "Policy", "PolicyEntry", "PolicyRecord",
    "Recurrent", "add_policy", "make_policy", "policy_config", "save_model", "save_policy",
]  # fmt: skip

WEIGHTS_FOLDER = Path(__file__).parent / "weights"


@dataclass(frozen=True)
class PolicyEntry:
    """One line of the registry: either a rule made from the config alone, or a folder of weights.

    needs: fields of EnvConfig that the rule is made for; weights say themselves what they need.
    """

    summary: str
    rule: Callable[[EnvConfig], Policy] | None = None
    weights: Path | None = None
    needs: dict[str, Any] = field(default_factory=dict)


POLICIES: dict[str, PolicyEntry] = {
    "follow": PolicyEntry("follows its route and ignores other robots", rule=Follow),
    "brake": PolicyEntry("follows its route and stops for a robot ahead", rule=Brake),
    "greedy": PolicyEntry("follows its route by right of way alone", rule=Follow, needs={"traffic": "rules"}),
    "orca": PolicyEntry("reciprocal velocity obstacles of discs, by the library pyrvo", rule=Reciprocal),
    "rules": PolicyEntry("paper 001's coordinator: waits by priority, steps aside, backs", rule=Rules),
    **{
        name: PolicyEntry(summary, weights=WEIGHTS_FOLDER / name)
        for name, summary in (
            ("reinforce", "our policy gradient, trained on this environment"),
            ("shielded", "busy trained on in crowds under the shield; right of way where robots stand"),
            ("unshielded", "our PPO with live routes only: no shield, no right of way"),
            ("careful", "unshielded trained on, with up to 64 robots, on floors drawn anew"),
            ("busy", "careful trained on, on a GPU: the fewest contacts of 64 robots"),
            ("patient", "careful trained on with fixed routes, on a GPU, for one-cell aisles"),
            ("ppo", "stable-baselines3 PPO, trained on this environment"),
        )
    },
}


def add_policy(text: str) -> None:
    """Load the user's own policy, "my_policy.py:Mine" or "module:Mine", into POLICIES; ConfigError if it is none.

    It is made from an EnvConfig, as the rules are. An attribute `needs` may hold the fields of EnvConfig that it needs.
    """
    _, parameters = plugins.split(text) or ("", "")
    if parameters:
        raise ConfigError(f"policy {shown(text)}: a policy takes no parameters; leave out {shown(parameters)}")
    made = plugins.add(text, "policy", {**POLICIES}, (_ACT,))
    if made is not None:
        with plugins.running(text):
            needs = dict(getattr(made, "needs", {}))
        POLICIES[text] = PolicyEntry("a policy of one's own", rule=partial(_own, text, made), needs=needs)


_ACT = "act(observation, rng)"


def _own(name: str, made: Callable[[EnvConfig], Any], config: EnvConfig) -> Any:
    """Make an own policy after a trial of another instance on empty observations; ConfigError if that fails."""
    seen = np.zeros((1, config.num_agents, observation_layout(config).size), np.float32)
    with plugins.running(name):
        policy = made(config)
        plugins.check_has(name, "policy", policy, (_ACT, "drawn") if hasattr(policy, "preferences") else (_ACT,))
        recurrent = isinstance(policy, Recurrent)
        given = _recurrent(name, policy, seen) if recurrent else policy.act(seen, np.random.default_rng(0))
    discrete = config.action_type == "discrete"
    wanted = seen.shape[:2] if discrete else (*seen.shape[:2], 2)
    whole = isinstance(given, np.ndarray) and np.issubdtype(given.dtype, np.integer)
    if not isinstance(given, np.ndarray) or given.shape != wanted or (discrete and not whole):
        got = f"{given.dtype}{list(given.shape)}" if isinstance(given, np.ndarray) else shown(given)
        what = "whole numbers" if discrete else "numbers"
        raise ConfigError(f"{name} must act by an array of {what} {list(wanted)} for {list(seen.shape)}, not by {got}")
    with plugins.running(name):
        return made(config)  # a new one, because one with a memory of its own has now seen made-up observations


def _recurrent(name: str, policy: Recurrent, seen: NDArray[np.float32]) -> Any:
    """Return the actions of an own policy with a memory; ConfigError if it does not keep one for each world."""
    begun = policy.memory(1)
    shape, of_two = np.shape(begun), np.shape(policy.memory(2))
    if shape[:1] != (1,) or of_two != (2, *shape[1:]):
        raise ConfigError(f"{name} must keep a memory [worlds, ...]: memory(1) is {shape}, and memory(2) is {of_two}")
    chosen = policy.act(seen, np.random.default_rng(0), begun)
    if not isinstance(chosen, tuple) or len(chosen) != 2 or np.shape(chosen[1]) != shape:
        raise ConfigError(f"{name} must return two arrays from act: the actions, and the next memory {list(shape)}")
    return chosen[0]


def save_model(directory: Path | str, model: Any, config: EnvConfig | None = None, mode: Mode | None = None) -> Path:
    """Write a model of stable-baselines3 as a policy folder (see agents/sb3_model.py, which imports torch)."""
    from agents.sb3_model import save_model

    return save_model(directory, model, config, mode)


def entry_of(name_or_dir: str | Path) -> PolicyEntry:
    """Resolve a name of POLICIES first, then a folder; raises ConfigError or WeightsError."""
    name = OLD_POLICIES.get(str(name_or_dir), str(name_or_dir))
    if name in POLICIES:
        return POLICIES[name]
    try:
        path = whereabouts(name)
    except ValueError:  # half of a character, or the one that ends names
        raise plugins.unknown("policy", name, POLICIES) from None
    if os.path.isdir(path):  # which Path.is_dir raises about where a name is too long
        return PolicyEntry("a policy folder", weights=path)
    if path.suffix.lower() == ".zip":
        raise WeightsError(
            f"{shown(str(path))} is no policy folder; agents.save_model(FOLDER, model) writes a model of "
            "stable-baselines3 as one"
        )
    own = plugins.split(name) or path.suffix == ".py"
    if not own and (len(path.parts) > 1 or isinstance(name_or_dir, Path)):
        raise WeightsError(f"{shown(str(path))} is no folder; a policy folder holds {CONFIG} and its weights")
    raise plugins.unknown("policy", name, POLICIES)


def policy_config(name_or_dir: str | Path, base: EnvConfig) -> EnvConfig:
    """Return `base` with what the policy needs: action type, levels, repeat and sensor, or a rule's `needs`.

    `base.max_steps` is kept: where the decision time may change, set it from seconds afterwards.
    Raises ConfigError for an unknown name and WeightsError for a folder that is none.
    """
    entry = entry_of(name_or_dir)
    if entry.weights is not None:
        return config_for(entry.weights, base)
    config = base.replace(**entry.needs)
    return config.replace(traffic=driven_with(base.traffic_spec, config.traffic_spec))


def weights_of(name_or_dir: str | Path) -> Path:
    """Return the folder of a trained policy; raises ConfigError for a rule or an unknown name."""
    folder = entry_of(name_or_dir).weights
    if folder is None:
        learned = ", ".join(name for name, other in POLICIES.items() if other.weights is not None)
        raise ConfigError(f"{name_or_dir} is a rule without weights; shipped policies with weights are: {learned}")
    return folder


def policy_tensors(name_or_dir: str | Path, config: EnvConfig) -> dict[str, NDArray[np.float32]]:
    """Return the tensors of a trained policy; errors as of `weights_of`, WeightsError if it does not fit `config`."""
    folder = weights_of(name_or_dir)
    LearnedPolicy(folder, config)
    return read_tensors(folder, read_record(folder).network)


def make_policy(name_or_dir: str | Path, config: EnvConfig) -> Policy:
    """Make a policy for environments of `config`, by a name of POLICIES or from a policy folder.

    Raises ConfigError for an unknown name, WeightsError for a damaged folder or one made for another config.
    """
    entry = entry_of(name_or_dir)
    if entry.rule is not None:
        return entry.rule(config)
    assert entry.weights is not None
    return LearnedPolicy(entry.weights, config)
