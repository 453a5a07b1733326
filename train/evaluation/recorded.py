"""Episodes kept to be looked at again: one of an experiment as a file, and what its policy liked at every moment."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents import LearnedPolicy, make_policy
from agents.policy import Preferring
from train.books import simulator_of
from train.central import CENTRAL
from train.evaluation.disturbances import DISTURBANCES
from train.evaluation.rollout import Experiment, play_out
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.render.replay import Shares
from warehouse_env.simulation.record.recording import Episode, Recorder


def record(experiment: Experiment, moved: Callable[[], object] = lambda: None) -> Episode:
    """Play the first episode of an experiment, to the bit as `run` does, and return it; moved: called after each step.

    Raises ConfigError for what an episode cannot tell: robots that break down, central planners that set routes.
    """
    if experiment.policy in CENTRAL:
        raise ConfigError(f"{experiment.policy} sets the robots' routes as they drive, and no episode can be recorded")
    name = experiment.disturbance
    if name is not None and DISTURBANCES[name].breakdown is not None:
        raise ConfigError(f"under the disturbance {name!r} robots break down, and no episode can be recorded")
    recorder = Recorder(simulator_of(experiment.config, 1), (experiment.seeds[0],), experiment.policy)
    one = dataclasses.replace(experiment, episodes=experiment.episodes[:1])

    def step(actions: NDArray[Any]) -> None:
        recorder.step(actions)
        moved()

    play_out(one, recorder.simulator, step=step)
    return recorder.episode


def shares_of(policy: str, config: EnvConfig) -> Shares | None:
    """Return how much a policy likes each action, for `replay_of`; None if it has no preferences, or has no name.

    Of a learned policy these are the chances; of a rule its order, 1 for the action liked best and 0 for the one liked
    least. Raises ConfigError or WeightsError for a policy that cannot be made.
    """
    if not policy or policy in CENTRAL or config.action_type != "discrete":
        return None
    made = make_policy(policy, config)
    if not isinstance(made, Preferring):
        return None

    def shares(observation: NDArray[np.float32]) -> NDArray[np.float64]:
        liked = made.preferences(observation).astype(np.float64)
        liked -= liked.max(axis=-1, keepdims=True)
        if isinstance(made, LearnedPolicy):
            likely = np.exp(liked)
            return np.asarray(likely / likely.sum(axis=-1, keepdims=True))
        return np.asarray(1 - liked / liked.min(axis=-1, keepdims=True).clip(max=-1e-9))

    return shares
