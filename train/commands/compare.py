"""`warehouse compare RUN RUN`: evaluations side by side, with paired differences -> a table, and rows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from train.reporting.comparison import ComparedRun, compare, comparison_table, read_runs
from train.reporting.rows import RowFile
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError


@dataclass(frozen=True)
class Compare(Checked):
    """Compare runs of `warehouse evaluate` with the first one, over the episodes that both have.

    Each policy is compared with itself in the other run; runs with a single policy each are compared as they are.
    Example: warehouse compare results/before results/after
    """

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Files of rows that `warehouse evaluate` wrote, or folders with rows.jsonl in them (as a report is)."""
    policy: tuple[str, ...] = ()
    """Compare only these policies (default: all)."""
    seed: tuple[int, ...] = ()
    """Compare only episodes of these seeds (default: all)."""
    json: Path | None = None
    """File for the figures, a row for each measure, pair and floor, as JSON lines."""

    def run(self) -> None:
        """Read all runs, print the table, write the rows."""
        runs = [self._chosen(run) for run in read_runs(self.runs)]
        lines = compare(runs, self.policy)
        file = RowFile(self.json)
        comparison_table(lines).print()
        file.add(line.row() for line in lines)
        episodes = sum(line.difference.samples for line in lines if line.measure == lines[0].measure)
        print(f"compared {episodes} pairs of episodes; {file.written()}")

    def _chosen(self, run: ComparedRun) -> ComparedRun:
        rows = [row for row in run.rows if not self.seed or row["seed"] in self.seed]
        if not rows:
            raise ConfigError(f"{run.path} has no episode with --seed {' '.join(map(str, self.seed))}")
        return run._replace(rows=rows)
