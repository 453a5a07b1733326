"""`warehouse train RECIPE` and `warehouse curves`."""

from __future__ import annotations

import dataclasses
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Self

import tyro

from agents.weights_folder import read_record
from train.kinds import read_fleet
from train.learning.config import TrainingConfig
from train.learning.progress import ROWS, read_run
from train.learning.recipes import by_recipe
from train.reporting.report import require_charts
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError, counted
from warehouse_env.render.learning_curves import learning_curves


@dataclass(frozen=True)
class Train:
    """Train a policy by a recipe, which names the trainer and the defaults of its options."""

    config: Annotated[TrainingConfig, tyro.conf.arg(name="")]

    fleet: Path | None = None
    """Train with other kinds of robots: a JSON file, as [{"share": 0.25, "robot": {"length": 1.4}}]; "share": 1 changes
    all robots."""

    @classmethod
    def defaults_for(cls, recipe: str) -> Self:
        """Return the options of a recipe."""
        return cls(by_recipe(recipe))

    def run(self) -> None:
        """Train; the last line says what was written where, also after Ctrl-C."""
        from train.trainers import train  # imports torch

        if self.fleet is not None:  # the configuration keeps the content of the file
            config = dataclasses.replace(self.config, fleet=read_fleet(self.fleet))
            dataclasses.replace(self, fleet=None, config=config).run()
            return
        try:
            train(self.config)
        except KeyboardInterrupt:
            if (self.config.directory / ROWS).exists():  # else nothing was begun
                print(_end(self.config))
            raise
        print(_end(self.config))


def _end(config: TrainingConfig) -> str:
    """Return the closing line: figures of the training, and what lies where."""
    directory = config.directory
    training = read_record(directory).training
    again = shlex.join(["warehouse", "train", str(config.recipe), "--resume", str(directory)])
    rest = "" if training["spent"] >= 1 else f"; go on with `{again}`"
    return (
        f"{training['steps']:,} agent-steps in {training['seconds']:.0f} s; wrote the policy, its card and its log to "
        f"{directory}{rest}"
    )


@dataclass(frozen=True)
class Curves(Checked):
    """Draw goals, collisions and entropy of training runs over their steps, one colour per algorithm."""

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of runs, as `warehouse train` makes them."""
    out: Path = Path("results/curves.png")
    """File for the picture."""

    def run(self) -> None:
        """Read all runs, then draw them."""
        if not self.runs:
            raise ConfigError("name at least one folder of a run")
        require_charts(self.out)
        curves = [read_run(run) for run in dict.fromkeys(self.runs)]
        learning_curves(curves, self.out)
        print(f"wrote the curves of {counted(len(curves), 'run')} to {self.out}")
