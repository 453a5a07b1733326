"""`warehouse tables --learning`: train some seeds of each algorithm, drive them and the rule, say what that adds."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from train.evaluation.episodes import play
from train.evaluation.rollout import Experiment, make_experiment
from train.learning.curves import read_run
from train.reporting.rows import RowFile, check_writable, whole_rows, write_text
from train.tables.learning.figures import SETTINGS, learning_tables
from train.tables.learning.trainings import START, configs, train_missing
from warehouse_env.checked import Checked
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.maps.layouts import make_layout
from warehouse_env.render.learning_curves import learning_curves

FLOORS = ("paper46", "narrow")
ROBOTS = (16, 32)
EPISODES = 10  # of each algorithm's policies together, and of what is not trained
SECONDS = 600.0
SEED = 10_000_000  # of the first episode, beside --seed: no training and no choice has used seeds from here on
RULE = "greedy"  # no learning: right of way alone, which needs all options


@dataclass(frozen=True)
class Learning(Checked):
    """Policies before and after training, and the rule without any, under each combination of options."""

    out: Path = Path("results/tables")
    json: Path | None = None  # OUT/learning/rows.jsonl if None
    runs: int | None = None  # episodes; EPISODES if None
    seed: int = 0
    processes: int = 2
    fresh: bool = False  # drive everything again; trainings that are done stay
    pictures: bool = True
    maps: tuple[str, ...] = ()  # names of layouts; FLOORS if empty
    trainings: int = 5  # seeds of each algorithm
    steps: int = 4_000_000  # agent-steps of each training

    def run(self) -> None:
        """Train and drive what is missing, then write the tables and the learning curves."""
        episodes = EPISODES if self.runs is None else self.runs
        if episodes < self.trainings or self.trainings < 2:
            raise ConfigError(f"--runs {episodes} must be at least --trainings {self.trainings}, and that at least 2")
        for name in self.maps:
            make_layout(name)  # a wrong name is said before anything is trained
        folder = self.out / "learning"
        check_writable(folder / "README.md")
        begin = time.perf_counter()
        trainings = configs(folder / "runs", range(self.seed, self.seed + self.trainings), self.steps)
        for line in train_missing(trainings):
            print(line, flush=True)
        policies = {RULE: [RULE], **{name: [str(one.directory) for one in group] for name, group in trainings.items()}}
        path = self.json or folder / "rows.jsonl"
        old = [] if self.fresh else whole_rows(path)
        file = RowFile(path, keep=not self.fresh)
        rows, _ = play(self.experiments(policies, episodes), file, old, processes=self.processes)
        tables = learning_tables(rows, policies)
        for table in tables:
            table.print()
        shown = ""
        if self.pictures:
            learned = (one for name, group in trainings.items() if name != START for one in group)
            learning_curves([read_run(one.directory).curve for one in learned], folder / "curves.png")
            shown = "![learning curves](curves.png)\n\n"
        text = "\n".join(table.markdown() for table in tables)
        write_text(folder / "README.md", f"# What learning adds\n\n{shown}{text}")
        print(f"wrote the tables to {folder / 'README.md'} in {time.perf_counter() - begin:.0f} s; the rows are {path}")

    def experiments(self, policies: dict[str, list[str]], episodes: int) -> list[Experiment]:
        """Return what is driven: every policy on every floor, under every setting, and one robot alone by the rule."""
        made = []
        for floor in self.maps or FLOORS:
            base: dict[str, Any] = {"layout": floor, "planner": "astar_turns"}
            first = SEED + self.seed
            made.append(make_experiment(RULE, EnvConfig(num_agents=1, **base), 4 * episodes, SECONDS, first))
            for robots in ROBOTS:
                env = EnvConfig(num_agents=robots, **base)
                for name, group in policies.items():
                    each = episodes // len(group)
                    settings = [SETTINGS[-1]] if name == RULE else SETTINGS
                    made += [
                        make_experiment(policy, env, each, SECONDS, first + number * each, setting.options)
                        for setting in settings
                        for number, policy in enumerate(group)
                    ]
        return made
