"""`warehouse record`: one episode into a file, to be replayed to the bit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from train.commands.drive import Drive
from train.evaluation.recorded import record
from train.evaluation.rollout import Experiment, identity, make_experiment
from train.reporting.report import make_progress
from train.reporting.rows import RowFile, check_writable
from warehouse_env.config import EnvConfig, TaskMode
from warehouse_env.simulation.record.recording import Episode


@dataclass(frozen=True)
class Record(Drive):
    """Drive a policy through one episode and keep it as a file, for `warehouse replay`."""

    policy: str = "ppo"
    """Policy to drive: a name, or the folder of a trained one."""
    layout: str = "paper46"
    """Layout to drive on."""
    map: Path | None = None
    """MovingAI .map file to drive on, instead."""
    robots: int = 16
    """Number of robots."""
    seconds: float = 120.0
    """Simulated time of the episode [s]."""
    tasks: TaskMode = "lifelong"
    """lifelong: a new goal after every arrival; one_shot: one goal each, then parked."""
    json: Path | None = None
    """Write a row about the episode to this file as JSON lines."""
    out: Path = Path("results/episode.npz")
    """File for the episode."""

    def run(self) -> None:
        """Drive and write; say what happened, and how to look at it."""
        floor = {"layout": self.layout} if self.map is None else {"map_file": str(self.map)}
        base = EnvConfig(num_agents=self.robots, planner=self.planner, tasks=self.tasks, **floor)  # type: ignore[arg-type]
        experiment = make_experiment(self.policy, base, 1, self.seconds, self.seed, self.chosen())
        check_writable(self.out)
        file = RowFile(self.json)
        with make_progress() as progress:
            bar = progress.add_task(experiment.title, total=experiment.config.max_steps)
            episode = record(experiment, lambda: progress.advance(bar))
        episode.save(self.out)
        file.add([row_of(experiment, episode) | {"out": self.out}])
        page = self.out.with_suffix(".html")
        print(f"wrote the episode to {self.out}; to see it: warehouse replay {self.out} --html {page}")


def row_of(experiment: Experiment, episode: Episode) -> dict[str, object]:
    """Return what was recorded, as a row."""
    return identity(experiment) | {"seed": experiment.seed, "steps": len(episode.actions)}
