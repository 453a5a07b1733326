"""`warehouse train RECIPE`."""

import dataclasses
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Self

import tyro

from agents.weights_folder import read_record
from train.kinds import read_fleet
from train.learning.config import TrainingConfig
from train.learning.progress import ROWS
from train.learning.recipes import by_recipe


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

        config = self.config
        if self.fleet is not None:  # the configuration keeps the content of the file
            config = dataclasses.replace(config, fleet=read_fleet(self.fleet))
        try:
            train(config)
        except KeyboardInterrupt:
            if (config.directory / ROWS).exists():  # else nothing was begun
                print(_end(config))
            raise
        print(_end(config))


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
