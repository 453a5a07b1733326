"""`warehouse scenes`: symmetric scenes that deadlock robots which only avoid each other -> rows, share resolved."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from train.commands.evaluate import Drive
from train.evaluation.jobs import Runner
from train.evaluation.rollout import MOST, make_experiment
from train.evaluation.scenes import SCENES, SceneJob, scene_table
from train.reporting.rows import RowFile, check_writable, write_text
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, unknown_name
from warehouse_env.planning import make_planner


@dataclass(frozen=True)
class Scenes(Drive):
    """Drive policies through symmetric scenes (head-on, crossing, circle swap); print the share that is resolved."""

    scene: tuple[str, ...] = tuple(SCENES)
    """Scenes to play."""
    policy: tuple[str, ...] = ("ppo",)
    """Policies to compare: names, or folders of trained ones."""
    seeds: int = 1000
    """Seeds of each scene and policy."""
    seconds: float = 120.0
    """Simulated time within which all robots must have arrived [s]."""
    json: Path | None = None
    """File for the rows, one a seed, as JSON lines (OUT/rows.jsonl if left out)."""
    out: Path = Path("results/scenes")
    """Folder for the rows and the table."""

    def run(self) -> None:
        """Play everything, print the table, write rows and table."""
        for name in self.scene:
            if name not in SCENES:
                raise unknown_name("scene", name, SCENES)
        if not 1 <= self.seeds <= MOST:
            raise ConfigError(f"--seeds {self.seeds} must lie between 1 and {MOST:,}")
        make_planner(self.planner)
        base, chosen = EnvConfig(planner=self.planner), self.chosen()
        for policy in self.policy:  # finds what is wrong before the start
            make_experiment(policy, base, self.seeds, self.seconds, self.seed, chosen)
        check_writable(self.out / "table.md")
        file = RowFile(self.json or self.out / "rows.jsonl")
        seeds = range(self.seed, self.seed + self.seeds)
        jobs = [
            SceneJob(name, policy, base, self.seconds, seeds, chosen)
            for name in dict.fromkeys(self.scene)
            for policy in dict.fromkeys(self.policy)
        ]
        with Runner(file) as run:
            rows = run(jobs)
        table = scene_table(rows)
        table.print()
        write_text(self.out / "table.md", table.markdown())
        print(f"wrote the rows to {file.path} and the table to {self.out}")
