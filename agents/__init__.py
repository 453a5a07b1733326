"""What a robot can decide: a registry of policies, each made for one environment configuration."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from agents.learned import LearnedPolicy, config_for
from agents.path_following import Brake, Follow, Greedy
from agents.policy import Policy
from agents.potential_field import PotentialField
from agents.reciprocal import Reciprocal
from agents.rules import Rules
from agents.weights_folder import CONFIG, Network, PolicyRecord, save_policy
from warehouse_env.config import EnvConfig
from warehouse_env.errors import WeightsError, shown, unknown_name

__all__ = [
    "POLICIES", "WEIGHTS_FOLDER", "LearnedPolicy", "Network", "Policy", "PolicyEntry", "PolicyRecord", "make_policy",
    "policy_config", "save_policy",
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


_RIGHT_OF_WAY = {"protective_field": True, "right_of_way": True, "reroute": True}

POLICIES: dict[str, PolicyEntry] = {
    "follow": PolicyEntry("follows its route and nothing else", rule=Follow),
    "brake": PolicyEntry("follows its route, stops for a robot ahead", rule=Brake),
    "greedy": PolicyEntry("follows its route by right of way alone", rule=Greedy, needs=_RIGHT_OF_WAY),
    "apf": PolicyEntry("potential field: drawn along its route, pushed off by lidar and robots", rule=PotentialField),
    "orca": PolicyEntry("reciprocal velocity obstacles of discs, by the library pyrvo", rule=Reciprocal),
    "rules": PolicyEntry("paper 001's coordinator: waits by priority, steps aside, backs", rule=Rules),
    **{
        name: PolicyEntry(summary, weights=WEIGHTS_FOLDER / name)
        for name, summary in (
            ("reinforce", "our policy gradient, trained on this environment"),
            ("threaded_ppo", "our PPO, under the field, with live routes, and right of way where robots stand"),
            ("unshielded", "our PPO with live routes alone: no field, no right of way"),
            ("ppo", "stable-baselines3 PPO, trained on this environment"),
        )
    },
}


def _entry(name_or_dir: str | Path) -> PolicyEntry:
    """Resolve a name of POLICIES first, then a folder; raises ConfigError or WeightsError."""
    name = str(name_or_dir)
    if name in POLICIES:
        return POLICIES[name]
    try:
        path = Path(os.path.expanduser(name))  # which leaves the home of nobody as it is
    except ValueError:  # half of a character, or the one that ends names
        raise unknown_name("policy", name, POLICIES) from None
    if os.path.isdir(path):  # which Path.is_dir raises about where a name is too long
        return PolicyEntry("a policy folder", weights=path)
    if len(path.parts) > 1 or isinstance(name_or_dir, Path):
        raise WeightsError(f"{shown(str(path))} is no folder; a policy folder holds {CONFIG} and its weights")
    raise unknown_name("policy", name, POLICIES)


def policy_config(name_or_dir: str | Path, base: EnvConfig) -> EnvConfig:
    """Return `base` with what the policy needs put in: action type, levels, repeat and sensor, or a rule's `needs`.

    `base.max_steps` is kept: where the decision time may change, set it from seconds afterwards.
    Raises ConfigError for an unknown name and WeightsError for a folder that is none.
    """
    entry = _entry(name_or_dir)
    return base.replace(**entry.needs) if entry.weights is None else config_for(entry.weights, base)


def make_policy(name_or_dir: str | Path, config: EnvConfig) -> Policy:
    """Make a policy for environments of `config`, by a name of POLICIES or from a policy folder.

    Raises ConfigError for an unknown name, WeightsError for a damaged folder or one made for another config.
    """
    entry = _entry(name_or_dir)
    if entry.rule is not None:
        return entry.rule(config)
    assert entry.weights is not None
    return LearnedPolicy(entry.weights, config, name=str(name_or_dir))
