"""`warehouse evaluate`: policies over held-out episodes -> rows, a table with intervals, pictures."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.progress import Progress, TaskID

from train.config import HELD_OUT_SEED
from train.report import evaluation_table, make_progress
from train.rollout import Experiment, Routes, Trace, Watcher, identity, make_experiment, run
from train.rows import Row, RowFile, read_rows, write_text
from warehouse_env.config import EnvConfig, TaskMode
from warehouse_env.errors import ConfigError, unknown_name
from warehouse_env.maps.layouts import LAYOUTS
from warehouse_env.maps.movingai import read_map
from warehouse_env.planning import make_planner
from warehouse_env.simulation.simulator import Simulator


@dataclass(frozen=True)
class Evaluate:
    """Drive policies through held-out episodes on layouts or maps; print means with 95% intervals."""

    policy: tuple[str, ...] = ("follow", "brake", "reinforce", "ppo")
    """Policies to compare: names, or folders of trained ones."""
    layout: tuple[str, ...] = ()
    """Layouts to drive on (paper46 if neither layout nor map is given)."""
    map: tuple[Path, ...] = ()
    """MovingAI .map files to drive on."""
    robots: tuple[int, ...] = (16,)
    """Numbers of robots."""
    episodes: int = 5
    """Episodes of each policy, floor and number of robots."""
    seconds: float = 600.0
    """Simulated time of an episode [s]."""
    tasks: TaskMode = "lifelong"
    """lifelong: a new goal after every arrival; one_shot: one goal each, then parked."""
    planner: str = EnvConfig.planner
    """Planner of the routes."""
    seed: int = HELD_OUT_SEED
    """Seed of the first episode, the next ones count on; no training uses seeds from the default on."""
    json: Path | None = None
    """File for the rows, one an episode, as JSON lines (OUT/rows.jsonl if left out)."""
    out: Path = Path("results/evaluate")
    """Folder for the rows, the table and the pictures."""
    resume: bool = False
    """Keep the rows that the file holds already, and play only the episodes that it lacks."""
    pictures: bool = True
    """Draw the trajectories of one episode of each policy, and the bar chart of collisions."""

    def run(self) -> None:
        """Play all experiments, print the table, write rows and pictures."""
        experiments = self.experiments()
        path = self.json or self.out / "rows.jsonl"
        old = read_rows(path) if self.resume and path.exists() else []
        rows, traces = play(experiments, RowFile(path, keep=self.resume), old, trace=self.pictures)
        table = evaluation_table(rows)
        table.print()
        write_text(self.out / "table.md", table.markdown())
        if self.pictures:
            from train.pictures import evaluation_pictures

            evaluation_pictures(rows, traces, self.out)
        print(f"wrote the rows to {path}, the table{' and the pictures' if self.pictures else ''} to {self.out}")

    def experiments(self) -> list[Experiment]:
        """Return the product of floors, robot counts and policies; everything that can be checked now is."""
        for name, values in (("policy", self.policy), ("robots", self.robots)):
            if not values:
                raise ConfigError(f"--{name} needs at least one value")
        make_planner(self.planner)
        floors: list[dict[str, Any]] = [{"layout": name} for name in self.layout]
        for name in self.layout:
            if name not in LAYOUTS:
                raise unknown_name("layout", name, LAYOUTS)
        for path in self.map:
            read_map(path)
            floors.append({"map_file": str(path)})
        experiments = []
        for floor in floors or [{}]:
            for robots in dict.fromkeys(self.robots):
                base = EnvConfig(num_agents=robots, planner=self.planner, tasks=self.tasks, **floor)
                experiments += [
                    make_experiment(policy, base, self.episodes, self.seconds, self.seed)
                    for policy in dict.fromkeys(self.policy)
                ]
        return experiments


def play(
    experiments: Sequence[Experiment], file: RowFile, old: Sequence[Row] = (), trace: bool = False
) -> tuple[list[Row], list[Trace]]:
    """Run experiments under a progress bar, writing the rows of each as soon as it ends.

    Episodes whose rows are among `old` are not played again. Returns all rows, and with `trace` for every experiment
    played the trace of its first episode. On Ctrl-C the KeyboardInterrupt says which rows are kept.
    """
    rows: list[Row] = []
    traces: list[Trace] = []
    routes, begun = Routes(), 0
    try:
        with make_progress() as progress:
            bar = progress.add_task("", total=sum(e.config.max_steps for e in experiments))
            for experiment in experiments:
                progress.update(bar, description=experiment.title, completed=begun)
                done, missing = _split(experiment, old)
                rows += done
                if missing is not None:
                    watch: list[Watcher] = [_Advance(progress, bar, begun)]
                    if trace:
                        traces.append(Trace(experiment))
                        watch.append(traces[-1])
                    new = run(missing, watch, routes)
                    file.add(new)
                    rows += new
                begun += experiment.config.max_steps
            progress.update(bar, completed=begun)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(file.kept()) from None
    return rows, traces


class _Advance:
    """A watcher that moves the progress bar, seldom enough to cost nothing."""

    def __init__(self, progress: Progress, bar: TaskID, begun: int) -> None:
        self._progress, self._bar, self._begun = progress, bar, begun

    def __call__(self, simulator: Simulator, steps: int) -> None:
        if steps % 50 == 0:
            self._progress.update(self._bar, completed=self._begun + steps)


def _split(experiment: Experiment, old: Iterable[Row]) -> tuple[list[Row], Experiment | None]:
    """Return the rows of an experiment that exist already, and the experiment of its missing episodes, if any."""
    same = identity(experiment).items()
    found = {row["episode"]: row for row in old if all(row.get(name) == value for name, value in same)}
    done = [found[k] for k in experiment.episodes if k in found and found[k]["seed"] == experiment.seed + k]
    missing = tuple(k for k in experiment.episodes if all(row["episode"] != k for row in done))
    return done, dataclasses.replace(experiment, episodes=missing) if missing else None
