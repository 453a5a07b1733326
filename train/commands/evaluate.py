"""`warehouse evaluate`: policies over held-out episodes -> rows, a table with intervals, pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from train.commands.drive import Drive
from train.evaluation.episodes import play
from train.evaluation.places import NOTES, PAGE
from train.evaluation.rollout import Experiment, Trace, make_experiment
from train.reporting.report import Table, evaluation_table, require_charts
from train.reporting.rows import Row, RowFile, check_writable, read_rows, write_text
from warehouse_env.config import EnvConfig, TaskMode
from warehouse_env.errors import ConfigError
from warehouse_env.maps.layouts import make_layout
from warehouse_env.maps.movingai import read_map
from warehouse_env.planning import make_planner

GOES_ON = "the same command with --resume goes on"


@dataclass(frozen=True)
class Episodes(Drive):
    """Which episodes to drive, and where their rows go: what evaluate and robust share."""

    policy: tuple[str, ...] = ("follow", "brake", "reinforce", "ppo", "threaded_ppo")
    """Policies to compare: names, or folders of trained ones; central_pibt is none, it knows all and plans for all."""
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
    json: Path | None = None
    """File for the rows, one an episode, as JSON lines (OUT/rows.jsonl if left out)."""
    out: Path = Path("results/evaluate")
    """Folder for the rows, the table and the pictures."""
    resume: bool = False
    """Keep the rows that the file holds already, and play only the episodes that it lacks."""
    processes: int = 1
    """Experiments to play at a time, each in a process of its own; the rows stay the same but for ms_per_step."""

    @property
    def rows_path(self) -> Path:
        """Where the rows go."""
        return self.json or self.out / "rows.jsonl"

    def tabulate(
        self,
        experiments: Sequence[Experiment],
        table_of: Callable[[Sequence[Row]], Table],
        traced: bool = False,
        notes: RowFile | None = None,
    ) -> tuple[list[Row], list[Trace]]:
        """Play the experiments, print the table of their rows and write both; return what `play` does."""
        path, table_path = self.rows_path, self.out / "table.md"
        check_writable(table_path)
        old = read_rows(path) if self.resume and path.exists() else []
        file = RowFile(path, keep=self.resume)
        rows, traces = play(experiments, file, old, traced, self.processes, notes, GOES_ON)
        table = table_of(rows)
        table.print()
        write_text(table_path, table.markdown())
        return rows, traces

    def experiments(self, disturbance: str | None = None) -> list[Experiment]:
        """Return the product of floors, robot counts and policies; everything that can be checked now is."""
        if self.processes < 1:
            raise ConfigError(f"--processes {self.processes} must be at least 1")
        for name, values in (("policy", self.policy), ("robots", self.robots)):
            if not values:
                raise ConfigError(f"--{name} needs at least one value")
        make_planner(self.planner)
        floors: list[dict[str, Any]] = [{"layout": name} for name in self.layout]
        for name in self.layout:
            make_layout(name)  # a wrong name is said before anything drives
        for path in self.map:
            read_map(path)
            floors.append({"map_file": str(path)})
        experiments = []
        for floor in floors or [{}]:
            for robots in dict.fromkeys(self.robots):
                base = EnvConfig(num_agents=robots, planner=self.planner, tasks=self.tasks, **floor)
                experiments += [
                    make_experiment(policy, base, self.episodes, self.seconds, self.seed, self.chosen(), disturbance)
                    for policy in dict.fromkeys(self.policy)
                ]
        return experiments


@dataclass(frozen=True)
class Evaluate(Episodes):
    """Drive policies through held-out episodes on layouts or maps; print means with 95% intervals."""

    pictures: bool = True
    """Draw the trajectories of one episode of each policy, and the bar chart of collisions."""
    report: Path | None = None
    """Folder for a page to read and share: what the figures show in words, charts, heat maps, the worst as replays."""

    def run(self) -> None:
        """Play all experiments, print the table, write rows, pictures and the report."""
        experiments, notes = self.experiments(), None
        if self.pictures or self.report is not None:
            require_charts()
        if self.report is not None:
            check_writable(self.report / PAGE)
            notes = RowFile(self.report / NOTES, keep=self.resume)
        rows, traces = self.tabulate(experiments, evaluation_table, self.pictures, notes)
        if self.pictures:
            from train.evaluation.pictures import evaluation_pictures

            evaluation_pictures(rows, traces, self.out)
        drawn = " and the pictures" if self.pictures else ""
        page = ""
        if self.report is not None:
            from train.evaluation.report_page import write_report

            noted = read_rows(self.report / NOTES) if (self.report / NOTES).exists() else []
            page = f", the report to {write_report(rows, noted, experiments, self.report, self.rows_path)}"
        print(f"wrote the rows to {self.rows_path}, the table{drawn} to {self.out}{page}")
