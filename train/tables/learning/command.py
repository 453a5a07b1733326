"""`warehouse tables learning`: train some seeds of each algorithm, drive them and the rule, say what that adds."""

from __future__ import annotations

import importlib
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from train.evaluation.rollout import Experiment, make_experiment
from train.learning import checkpoint
from train.learning.config import PPOConfig, ReinforceConfig, ThreadedPPOConfig, TrainingConfig
from train.learning.curves import read_run
from train.learning.recipes import by_recipe
from train.learning.training_run import CHECKPOINT, is_done
from train.tables.learning.figures import SETTINGS, START, learning_tables
from train.tables.options import StudyOptions
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.maps.layouts import make_layout
from warehouse_env.render.learning_curves import learning_curves

ALGORITHMS: dict[str, tuple[str, type[TrainingConfig]]] = {  # name -> module with `train`, options
    "reinforce": ("train.reinforce", ReinforceConfig),
    "ppo": ("train.ppo", PPOConfig),  # stable-baselines3's
    "threaded_ppo": ("train.threaded_ppo", ThreadedPPOConfig),
}


def configs(folder: Path, seeds: range, steps: int) -> dict[str, list[TrainingConfig]]:
    """Return the trainings by algorithm, and as START the one that ends before it has learned anything: all by the
    recipe `bare`, for what options add is told by driving.

    steps: agent-steps of each training. Each has one thread, for what is learned depends on how many there are: so the
    table is the same whatever the machine's cores.
    """
    made: dict[str, list[TrainingConfig]] = {
        name: [
            by_recipe(config, "bare", name=f"{name}-{seed}", out=folder, seed=seed, steps=steps, threads=1)
            for seed in seeds
        ]
        for name, (_, config) in ALGORITHMS.items()
    }
    start = by_recipe(ReinforceConfig, "bare", name=START, out=folder, steps=1, learning_rate=1e-12, threads=1)
    return {START: [start], **made}


def train_missing(trainings: dict[str, list[TrainingConfig]]) -> Iterator[str]:
    """Train what is not trained yet, and go on where a training was stopped; yield a line before each begins.

    Raises KeyboardInterrupt if a training was stopped before its end.
    """
    for algorithm, group in trainings.items():
        module = importlib.import_module(ALGORITHMS.get(algorithm, ALGORITHMS["reinforce"])[0])
        for config in group:
            if is_done(config):
                continue
            yield f"training {config.name}: {config.steps:,} agent-steps"
            begun = checkpoint.exists(config.directory / CHECKPOINT)
            try:
                module.train(type(config)(resume=config.directory, progress=config.progress) if begun else config)
            except KeyboardInterrupt as stop:
                stop.args = (f"the same command goes on with {config.directory}",)
                raise


FLOORS = ("paper46", "narrow")
ROBOTS = (16, 32)
SECONDS = 600.0
SEED = 10_000_000  # of the first episode, beside --seed: no training and no choice has used seeds from here on
RULE = "greedy"  # no learning: right of way alone, which needs all options


@dataclass(frozen=True)
class Learning(StudyOptions):
    """Train five seeds of each algorithm, drive them and the rules under all options, and say what learning adds."""

    name = "learning"

    trainings: int = 5
    """Seeds of each algorithm."""
    steps: int = 4_000_000
    """Agent-steps of each training."""
    runs: int = 10
    """Episodes of each algorithm's policies together, and of what is not trained."""
    maps: tuple[str, ...] = FLOORS
    """Layouts to drive on."""
    pictures: bool = True
    """Draw the learning curves."""

    def run(self) -> None:
        """Train and drive what is missing, then write the tables and the learning curves."""
        if self.runs < self.trainings or self.trainings < 2:
            what = f"--runs {self.runs} must be at least --trainings {self.trainings}"
            raise ConfigError(f"{what}, and that at least 2")
        for name in self.maps:
            make_layout(name)  # a wrong name is said before anything is trained
        self.check_writable()
        begin = time.perf_counter()
        trainings = configs(self.folder / "runs", range(self.seed, self.seed + self.trainings), self.steps)
        for line in train_missing(trainings):
            print(line, flush=True)
        policies = {RULE: [RULE], **{name: [str(one.directory) for one in group] for name, group in trainings.items()}}
        rows = self.drive(self.experiments(policies))
        shown = ""
        if self.pictures:
            learned = (one for name, group in trainings.items() if name != START for one in group)
            learning_curves([read_run(one.directory).curve for one in learned], self.folder / "curves.png")
            shown = "![learning curves](curves.png)\n\n"
        self.write("What learning adds", learning_tables(rows, policies), shown)
        print(self.written(begin))

    def experiments(self, policies: dict[str, list[str]]) -> list[Experiment]:
        """Return what is driven: every policy on every floor, under every setting, and one robot alone by the rule."""
        made, episodes = [], self.runs
        for floor in self.maps:
            base: dict[str, Any] = {"layout": floor, "planner": "astar_turns"}
            first = SEED + self.seed
            made.append(make_experiment(RULE, EnvConfig(num_agents=1, **base), 4 * episodes, SECONDS, first))
            for robots in ROBOTS:
                env = EnvConfig(num_agents=robots, **base)
                for name, group in policies.items():
                    each = episodes // len(group)
                    settings = [SETTINGS[-1]] if name == RULE else SETTINGS
                    made += [
                        make_experiment(policy, env, each, SECONDS, first + number * each, {"traffic": setting.traffic})
                        for setting in settings
                        for number, policy in enumerate(group)
                    ]
        return made
