"""`warehouse train reinforce`, `ppo` and `threaded_ppo`, and `warehouse curves`."""

from __future__ import annotations

import dataclasses
import importlib
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, make_dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, get_type_hints

import tyro

from agents.weights_folder import read_record
from train.commands.kinds import read_fleet
from train.held_out import held_out
from train.learning.config import PPOConfig, ReinforceConfig, ThreadedPPOConfig, TrainingConfig
from train.learning.curves import read_run
from train.learning.progress import FIGURES, ROWS
from train.learning.recipes import Recipe, ThreadedPPORecipe, by_recipe
from train.reporting.report import Table, make_progress, number, require_charts, tell, with_interval
from train.reporting.rows import RowFile, mean_interval, read_rows
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError
from warehouse_env.render.learning_curves import learning_curves


@dataclass(frozen=True)
class _Train:
    """A trainer's command; a subclass adds the trainer's own options as `config`."""

    config: TrainingConfig

    module: ClassVar[str]  # with a function `train`, imported when it is called, for it needs torch

    recipe: Recipe = "shipped"
    """Defaults of the other options. shipped: those of the shipped weights; bare: without shield, live routes and
    shared rewards, as in the papers. `--recipe NAME --help` shows them."""

    fleet: Path | None = None
    """Train with other kinds of robots: a JSON file, as [{"share": 0.25, "robot": {"length": 1.4}}]; "share": 1 changes
    all robots."""

    json: Path | None = None
    """Also write the rows of the training's progress to this file as JSON lines."""

    seeds: int = 1
    """Train under this many seeds from --seed on, one after the other, each in a folder NAME-SEED, and show a table. A
    stopped training goes on; a finished one is kept."""

    @classmethod
    def defaults_for(cls, arguments: Sequence[str]) -> Self:
        """Return the options of the recipe that a command line names."""
        kinds = get_type_hints(cls)
        named = make_dataclass("named", [("recipe", kinds["recipe"], cls.recipe)])
        words = [word for word in arguments if word not in ("-h", "--help")]
        recipe: Any = tyro.cli(named, args=words, return_unknown_args=True, add_help=False)[0].recipe
        return cls(config=by_recipe(kinds["config"], recipe), recipe=recipe)

    def run(self) -> None:
        """Train; the last line says what was written where, also after Ctrl-C."""
        if not 1 <= self.seeds <= 10_000:
            raise ConfigError(f"--seeds {self.seeds} must lie between 1 and 10,000")
        if self.fleet is not None:  # the configuration keeps the content of the file
            config = dataclasses.replace(self.config, fleet=read_fleet(self.fleet))
            dataclasses.replace(self, fleet=None, config=config).run()
            return
        file = RowFile(self.json)
        train = importlib.import_module(self.module).train
        if self.seeds > 1:
            self._train_seeds(train, file)
        else:
            self._train(train, file)

    def _train(self, train: Callable[[TrainingConfig], object], file: RowFile) -> None:
        directory = self.config.directory
        try:
            train(self.config)
        except KeyboardInterrupt:
            if (directory / ROWS).exists():  # else nothing was begun
                self._close(file)
            raise
        self._close(file)

    def _close(self, file: RowFile) -> None:
        file.add(read_rows(self.config.directory / ROWS))
        print(_end(self.config.directory, self.json))

    def _train_seeds(self, train: Callable[[TrainingConfig], object], file: RowFile) -> None:
        configs = of_seeds(self.config, self.seeds)
        train_missing(train, configs)
        for config in configs:
            about = {"run": config.name, "training_seed": config.seed}
            file.add([{**about, **row} for row in read_rows(config.directory / ROWS)])
        seeds_table(configs).print()
        rows = "" if self.json is None else f", the rows to {self.json}"
        print(f"wrote {self.seeds} policies to {configs[0].directory} and on{rows}")


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
    recipe: ThreadedPPORecipe = "shipped"  # type: ignore[assignment]
    """Defaults of the other options. shipped: those of the shipped weights; bare: without shield, live routes and
    shared rewards, as in the papers; unshielded: those of the policy `unshielded`, with large contact penalties instead
    of the shield. `--recipe NAME --help` shows them."""
    config: Annotated[ThreadedPPOConfig, tyro.conf.arg(name="")] = field(default_factory=ThreadedPPOConfig)


def _end(directory: Path, json: Path | None) -> str:
    """Return the closing line: figures of the training, and what lies where."""
    training = read_record(directory).training
    command = read_record(directory).algorithm
    again = shlex.join(["warehouse", "train", command, "--resume", str(directory)])
    rest = "" if training["spent"] >= 1 else f"; go on with `{again}`"
    rows = "" if json is None else f", the rows to {json}"
    return (
        f"{training['steps']:,} agent-steps in {training['seconds']:.0f} s; wrote the policy, its card and its log to "
        f"{directory}{rows}{rest}"
    )


_GOES_ON = "the same command goes on from the checkpoints"


def of_seeds(config: TrainingConfig, seeds: int) -> list[TrainingConfig]:
    """Return the training under `seeds` seeds from its own on, each in its own folder."""
    if config.resume is not None:
        raise ConfigError(f"--resume must be left out with --seeds {seeds}: {_GOES_ON}")
    return [
        dataclasses.replace(config, seed=config.seed + k, name=f"{config.name}-{config.seed + k}") for k in range(seeds)
    ]


def train_missing(train: Callable[[TrainingConfig], object], configs: Sequence[TrainingConfig]) -> None:
    """Train what is not trained yet, one after the other."""
    from train.learning import checkpoint
    from train.learning.training_run import CHECKPOINT, is_done  # both import torch

    for config in [one for one in configs if not is_done(one)]:
        begun = checkpoint.exists(config.directory / CHECKPOINT)
        tell(f"seed {config.seed}")
        try:
            train(type(config)(resume=config.directory, progress=config.progress) if begun else config)
        except KeyboardInterrupt as stop:
            raise type(stop)(_GOES_ON) from None


def seeds_table(configs: Sequence[TrainingConfig]) -> Table:
    """Drive all policies on the same held-out seeds; return a line for each seed, the best one marked, and the mean."""
    with make_progress() as progress:
        bar = progress.add_task("held-out episodes", total=len(configs))
        driven = []
        for config in configs:
            driven.append(held_out(config))
            progress.advance(bar)
    best = max(range(len(configs)), key=lambda k: driven[k][FIGURES[0]])
    cells = []
    for k, (config, figures) in enumerate(zip(configs, driven, strict=True)):
        training = read_record(config.directory).training
        cells.append((
            f"{config.seed}{' (best)' * (k == best)}", f"{training['steps']:,}", number(training["seconds"] / 60, 2),
            *_shown([figures]), str(config.directory),
        ))  # fmt: skip
    cells.append(("mean", "", "", *_shown(driven), ""))
    header = ("seed", "agent-steps", "minutes", "goals/robot-h", "collisions/km", "stuck %", "folder")
    note = (
        "Each policy on the same three held-out episodes; mean over seeds [95% interval by Student's t]. These "
        "episodes also chose the best one, so drive it on others before you rely on it (warehouse evaluate)."
    )
    return Table("Trainings", header, tuple(cells), note)


def _shown(driven: Sequence[dict[str, float]]) -> list[str]:
    factors = {"stuck": 100.0}
    return [with_interval(mean_interval(one[name] for one in driven), factors.get(name, 1.0)) for name in FIGURES]


@dataclass(frozen=True)
class Curves(Checked):
    """Draw goals, collisions and entropy of training runs over their steps, one colour per algorithm."""

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of runs, as `warehouse train` makes them."""
    seed: tuple[int, ...] = ()
    """Draw only runs with these training seeds (default: all runs)."""
    out: Path = Path("results/curves.png")
    """File for the picture."""
    json: Path | None = None
    """File for the points, one row each, as JSON lines."""

    def run(self) -> None:
        """Read all runs, then draw them."""
        if not self.runs:
            raise ConfigError("name at least one folder of a run")
        require_charts(self.out)
        file = RowFile(self.json)
        runs = [run for run in map(read_run, dict.fromkeys(self.runs)) if not self.seed or run.seed in self.seed]
        if not runs:
            raise ConfigError(f"no run was trained with --seed {' '.join(map(str, self.seed))}")
        for run in runs:
            file.add(run.rows())
        learning_curves([run.curve for run in runs], self.out)
        print(f"wrote the curves of {len(runs)} run{'s' * (len(runs) > 1)} to {self.out}")
