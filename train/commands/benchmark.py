"""`warehouse benchmark`: drive policies through the fixed set of episodes, and show them beside the shipped ones."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from train.evaluation.episodes import play
from train.evaluation.fixed_set import SHIPPED, VERSION, benchmark_tables, experiments
from train.evaluation.workers import GOES_ON, RowOptions
from train.own import OwnSensors
from train.reporting.rows import Row, read_rows
from warehouse_env.files import check_writable, write_text


@dataclass(frozen=True)
class Benchmark(RowOptions, OwnSensors):
    """Drive policies through a fixed set of floors, fleets and seeds, and show them beside the shipped policies.

    It is a preset of `evaluate` that is the same for everybody. Without --policy it shows the shipped policies alone.
    Example: warehouse benchmark --policy runs/mine
    """

    policy: tuple[str, ...] = ()
    """Policies to drive: names of `warehouse policies`, folders of trained ones, or your own, FILE.py:CLASS or
    MODULE:CLASS."""
    out: Path = Path("results/benchmark")
    """Folder for the rows and the table."""

    usual_processes: ClassVar[int] = min(os.cpu_count() or 1, 8)

    def run(self) -> None:
        """Drive what is asked for, then print the tables."""
        driven = self._drive() if self.policy else []
        shipped = [row for row in read_rows(SHIPPED) if row["policy"] not in self.policy]
        tables = benchmark_tables([*shipped, *driven])
        for table in tables:
            table.print()
        if driven:
            title = f"# Benchmark, version {VERSION} of the set\n\n"
            write_text(self.out / "table.md", title + "\n".join(table.markdown() for table in tables))
            print(f"wrote the table and the rows to {self.out}")

    def _drive(self) -> list[Row]:
        # errors come before anything drives
        listed = [one for policy in dict.fromkeys(self.policy) for one in experiments(policy)]
        check_writable(self.out / "table.md")
        tracks = [track for track, experiment in listed for _ in experiment.episodes]
        with self.file_of(self.out / "rows.jsonl") as file:
            rows = play([one for _, one in listed], file, file.old(), self.workers(), goes_on=GOES_ON)
        return [{**row, "track": track} for track, row in zip(tracks, rows, strict=True)]
