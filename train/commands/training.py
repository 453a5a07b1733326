"""`warehouse train reinforce`, `ppo` and `threaded_ppo`, and `warehouse curves`."""

from __future__ import annotations

import dataclasses
import importlib
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field, make_dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, get_type_hints

import tyro

from agents.weights_folder import read_record
from train.kinds import read_fleet
from train.learning.config import PPOConfig, ReinforceConfig, ThreadedPPOConfig, TrainingConfig
from train.learning.progress import ROWS, read_run
from train.learning.recipes import by_recipe
from train.reporting.report import require_charts
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError, counted
from warehouse_env.render.learning_curves import learning_curves


@dataclass(frozen=True)
class _Train:
    """A trainer's command; a subclass adds the trainer's own options as `config`."""

    config: TrainingConfig

    module: ClassVar[str]  # with a function `train`, imported when it is called, for it needs torch

    recipe: str = "shipped"
    """Defaults of the other options: of the weights shipped under this name; bare: without shield, live routes and
    shared rewards, as in the papers; others are in docs/how_to/train.md. `--recipe NAME --help` shows them."""

    fleet: Path | None = None
    """Train with other kinds of robots: a JSON file, as [{"share": 0.25, "robot": {"length": 1.4}}]; "share": 1 changes
    all robots."""

    @classmethod
    def defaults_for(cls, arguments: Sequence[str]) -> Self:
        """Return the options of the recipe that a command line names."""
        named = make_dataclass("named", [("recipe", str, cls.recipe)])
        words = [word for word in arguments if word not in ("-h", "--help")]
        recipe: Any = tyro.cli(named, args=words, return_unknown_args=True, add_help=False)[0].recipe
        return cls(config=by_recipe(get_type_hints(cls)["config"], recipe), recipe=recipe)

    def run(self) -> None:
        """Train; the last line says what was written where, also after Ctrl-C."""
        if self.fleet is not None:  # the configuration keeps the content of the file
            config = dataclasses.replace(self.config, fleet=read_fleet(self.fleet))
            dataclasses.replace(self, fleet=None, config=config).run()
            return
        try:
            importlib.import_module(self.module).train(self.config)
        except KeyboardInterrupt:
            if (self.config.directory / ROWS).exists():  # else nothing was begun
                print(_end(self.config.directory))
            raise
        print(_end(self.config.directory))


@dataclass(frozen=True)
class TrainReinforce(_Train):
    """Train our policy gradient: REINFORCE over the next action command, with a learned value as baseline."""

    module = "train.reinforce"
    config: Annotated[ReinforceConfig, tyro.conf.arg(name="")] = field(default_factory=ReinforceConfig)


@dataclass(frozen=True)
class TrainPPO(_Train):
    """Train proximal policy optimisation, by stable-baselines3."""

    module = "train.ppo"
    config: Annotated[PPOConfig, tyro.conf.arg(name="")] = field(default_factory=PPOConfig)


@dataclass(frozen=True)
class TrainThreadedPPO(_Train):
    """Train our own proximal policy optimisation, in threads."""

    module = "train.threaded_ppo"
    config: Annotated[ThreadedPPOConfig, tyro.conf.arg(name="")] = field(default_factory=ThreadedPPOConfig)


def _end(directory: Path) -> str:
    """Return the closing line: figures of the training, and what lies where."""
    training = read_record(directory).training
    command = read_record(directory).algorithm
    again = shlex.join(["warehouse", "train", command, "--resume", str(directory)])
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
