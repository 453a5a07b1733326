"""The trainers at their defaults, in turns: agent-steps/s of the whole loop, and where the time goes."""

from __future__ import annotations

import importlib
import statistics
import time
from collections.abc import Iterator
from typing import Any, NamedTuple

from train.learning import config as configs
from train.learning.timing import PARTS
from train.learning.training_run import Trainer
from train.reporting.rows import Row

TRAINERS = {  # name -> module, trainer, config
    "reinforce": ("train.reinforce", "Reinforce", configs.ReinforceConfig),
    "threaded_ppo": ("train.threaded_ppo", "ThreadedPpo", configs.ThreadedPPOConfig),
    "ppo": ("train.ppo", "Ppo", configs.PPOConfig),  # by stable-baselines3: what the others are held against
}
_TURNS = 5
_WARM = 2.0  # turns' worth of updates before the clock starts: kernels are loaded, worlds have filled up


class _Measured(NamedTuple):
    trainer: Trainer
    config: Any
    rates: list[float]  # agent-steps/s, one a turn
    split: dict[str, float]  # [s]


def training(seconds: float, seed: int) -> Iterator[Row]:
    """Yield a row for each trainer, measured for `seconds` each in turns with the others."""
    measured = {}
    for name, (module, trainer, config) in TRAINERS.items():
        chosen = config(seed=seed)
        made = getattr(importlib.import_module(module), trainer)(chosen)
        _drive(made, _WARM * seconds / _TURNS, 0)
        measured[name] = _Measured(made, chosen, [], dict.fromkeys(PARTS, 0.0))
    numbers = dict.fromkeys(measured, 1000)
    for _ in range(_TURNS):
        for name, one in measured.items():
            before = dict(one.trainer.split.seconds)
            begun = time.perf_counter()
            updates = _drive(one.trainer, seconds / _TURNS, numbers[name])
            one.rates.append(updates * one.trainer.rows * one.trainer.rollout / (time.perf_counter() - begun))
            numbers[name] += updates
            for part in PARTS:
                one.split[part] += one.trainer.split.seconds[part] - before[part]
    yield from (_row(name, one) for name, one in measured.items())


def _drive(trainer: Trainer, seconds: float, number: int) -> int:
    """Make updates for so long, one at least; return how many."""
    begun, updates = time.perf_counter(), 0
    while updates == 0 or time.perf_counter() - begun < seconds:
        trainer.update(number + updates, 0.0)
        updates += 1
    return updates


def _row(name: str, one: _Measured) -> Row:
    config, spent = one.config, sum(one.split.values())
    return {
        "what": f"train_{name}", "trainer": name, "envs": sum(count for _, count in config.worlds(config.rows)),
        "agents": "/".join(map(str, config.robots)), "threads": config.threads, "hidden": list(config.hidden),
        "agent_steps_per_s": statistics.median(one.rates), "low": min(one.rates), "high": max(one.rates),
        "shares": {part.removesuffix("_s"): seconds / spent for part, seconds in one.split.items()},
    }  # fmt: skip
