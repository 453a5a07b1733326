"""Measure the trainers with their recipe `bare`, in turns: agent-steps/s of the whole loop, and shares of its time."""

from __future__ import annotations

import importlib
import statistics
from collections.abc import Iterator
from typing import Any, NamedTuple

from train.learning import config as configs
from train.learning.recipes import by_recipe
from train.learning.timing import PARTS
from train.learning.trainer import Trainer, profile
from train.reporting.rows import Row

TRAINERS = {  # name -> module, trainer, config
    "reinforce": ("train.reinforce", "Reinforce", configs.ReinforceConfig),
    "threaded_ppo": ("train.threaded_ppo", "ThreadedPpo", configs.ThreadedPPOConfig),
    "ppo": ("train.ppo", "Ppo", configs.PPOConfig),  # of stable-baselines3: the others are compared with it
}
_TURNS = 5
_WARM_UP = 3  # updates before the clock starts, which load kernels


class _Measured(NamedTuple):
    trainer: Trainer
    config: Any
    updates: int  # a turn
    turns: list[dict[str, float]]  # see training_run.profile


def training(seconds: float, seed: int) -> Iterator[Row]:
    """Yield a row for each trainer, measured for about `seconds` each in turns with the others."""
    measured = {}
    for name, (module, trainer, config) in TRAINERS.items():
        chosen: configs.TrainingConfig = by_recipe(config, "bare", seed=seed)
        made = getattr(importlib.import_module(module), trainer)(chosen)
        update = profile(made, 1, _WARM_UP)["seconds"]
        measured[name] = _Measured(made, chosen, max(1, round(seconds / _TURNS / update)), [])
    for _ in range(_TURNS):
        for one in measured.values():
            one.turns.append(profile(one.trainer, one.updates, 0))
    yield from (_row(name, one) for name, one in measured.items())


def _row(name: str, one: _Measured) -> Row:
    config, rates = one.config, [turn["steps_per_second"] for turn in one.turns]
    split = {part: sum(turn[part] for turn in one.turns) for part in PARTS}
    return {
        "what": f"train_{name}", "trainer": name, "envs": sum(count for _, count in config.worlds(config.rows)),
        "agents": "/".join(map(str, config.robots)), "threads": config.threads, "hidden": list(config.hidden),
        "agent_steps_per_s": statistics.median(rates), "low": min(rates), "high": max(rates),
        "shares": {part.removesuffix("_s"): seconds / sum(split.values()) for part, seconds in split.items()},
    }  # fmt: skip
