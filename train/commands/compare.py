"""`warehouse compare RUN [RUN]`: evaluations side by side, with paired differences -> a table, and rows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from train.reporting.comparison import compare, comparison_table, read_runs
from train.reporting.rows import RowFile
from train.reporting.trainings import note_on_groups, read_groups, regrouped
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError


@dataclass(frozen=True)
class Compare(Checked):
    """Compare runs of `warehouse evaluate` with the first one, over the episodes that both have.

    Each policy is compared with itself in the other run; runs with a single policy each are compared as they are. In a
    single run every policy is compared with the first.
    Example: warehouse compare results/before results/after
    """

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Files of rows that `warehouse evaluate` wrote, or folders with rows.jsonl in them (as a report is)."""
    policy: tuple[str, ...] = ()
    """Compare only these policies and groups (default: all)."""
    group: tuple[str, ...] = ()
    """Compare groups of policies of the runs, named as for `warehouse evaluate`."""
    json: Path | None = None
    """File for the figures, a row for each measure, pair and floor, as JSON lines."""

    def run(self) -> None:
        """Read all runs, print the table, write the rows."""
        groups = read_groups(self.group)
        runs = [one._replace(rows=regrouped(one.rows, groups, self.policy)) for one in read_runs(self.runs)]
        if missing := groups.keys() - {row["policy"] for run in runs for row in run.rows}:
            raise ConfigError(f"--group {min(missing)}: no run has rows of its policies")
        lines = compare(runs, self.policy)
        file = RowFile(self.json)
        comparison_table(lines, note_on_groups([row for run in runs for row in run.rows])).print()
        file.add(line.row() for line in lines)
        episodes = sum(line.difference.samples for line in lines if line.measure == lines[0].measure)
        print(f"compared {episodes} pairs of episodes; {file.written()}")
