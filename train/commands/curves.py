"""`warehouse curves`: the learning curves of several runs in one picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from train.learning.curves import read_run
from train.reporting.report import require_charts
from train.reporting.rows import RowFile, check_writable
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError
from warehouse_env.render.learning_curves import learning_curves


@dataclass(frozen=True)
class Curves(Checked):
    """Draw goals, collisions and entropy of runs of training over their steps, those of an algorithm in one colour."""

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of runs, as `warehouse train` makes them."""
    seed: tuple[int, ...] = ()
    """Seeds of training; runs with others are left out (none if left out)."""
    out: Path = Path("results/curves.png")
    """File for the picture."""
    json: Path | None = None
    """File for what is drawn, a row a point, as JSON lines."""

    def run(self) -> None:
        """Read all runs, then draw them."""
        if not self.runs:
            raise ConfigError("name at least one folder of a run")
        check_writable(self.out)
        file = RowFile(self.json)
        runs = [run for run in map(read_run, dict.fromkeys(self.runs)) if not self.seed or run.seed in self.seed]
        if not runs:
            raise ConfigError(f"no run was trained with --seed {' '.join(map(str, self.seed))}")
        require_charts()
        for run in runs:
            file.add(run.rows())
        learning_curves([run.curve for run in runs], self.out)
        print(f"wrote the curves of {len(runs)} run{'s' * (len(runs) > 1)} to {self.out}")
