"""`warehouse clmapf`: solve the public benchmark of car-like robots, or check solutions of it."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import tyro

from train.clmapf.jobs import InstanceJob, cells_table, impossible_lines, instances_in, unsolved_lines
from train.clmapf.motions import AUTHORS_STEP
from train.evaluation.jobs import Here, Job, Runner
from train.evaluation.processes import Processes
from train.reporting.rows import Row, RowFile
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError, MapError
from warehouse_env.files import check_writable, write_text


@dataclass(frozen=True)
class Clmapf(Checked):
    """Plan the routes of all instances of CL-MAPF below a folder, check them exactly, and print a table by cell.

    Example: warehouse clmapf CL-CBS/benchmark
    """

    folder: tyro.conf.Positional[Path]
    """Folder with instances of the benchmark, *.yaml, at any depth."""
    check: bool = False
    """Only check the files under --solutions, ours or others', which have the instances' names; exit code 1 for
    faults."""
    solutions: Path | None = None
    """Folder for the solutions, in the format of the benchmark's authors (OUT/solutions)."""
    authors_steps: bool = False
    """With --check, t counts the steps of the authors' solver, each 2.118 long; else it is seconds at unit speed."""
    seed: int = 0
    """Seed of the planner."""
    json: Path | None = None
    """Write the rows, one an instance, to this file as JSON lines (OUT/rows.jsonl)."""
    out: Path = Path("results/clmapf")
    """Folder for the rows, the tables and the solutions."""
    processes: int = field(default_factory=lambda: min(os.cpu_count() or 1, 8))
    """Instances to plan at a time, in processes if there are several."""
    ranges: ClassVar = {"seed": (0, 2**62), "processes": (1, 10_000)}

    def run(self) -> None:
        """Solve or check; print the tables, and what is impossible, unsolved or wrong."""
        jobs, path = self._jobs(), self.json or self.out / "rows.jsonl"
        check_writable(self.out / "table.md")
        workers = Here() if self.processes == 1 else Processes(self.processes)
        with RowFile(path) as file, Runner(file, workers=workers) as run:
            rows = run(jobs)
        self._tell(rows)
        print(f"wrote the rows to {path}, the table to {self.out}")
        if self.check and any(row.get("faults") for row in rows):
            raise SystemExit(1)

    def _jobs(self) -> Sequence[Job]:
        solutions = self.solutions or self.out / "solutions"
        names = instances_in(self.folder)
        if self.authors_steps and not self.check:
            raise ConfigError("--authors-steps says how solutions are checked; give it with --check")
        if self.check and not any((solutions / name).is_file() for name in names):
            raise MapError(f"{solutions} holds no solution named as an instance in {self.folder}")
        unit, seed = AUTHORS_STEP if self.authors_steps else 1.0, None if self.check else self.seed
        return [InstanceJob(self.folder, name, solutions, seed, unit) for name in names]

    def _tell(self, rows: Sequence[Row]) -> None:
        table = cells_table(rows)
        table.print()
        impossible, unsolved = impossible_lines(rows), unsolved_lines(rows)
        for title, lines in (("impossible as stated", impossible), ("not solved", unsolved)):
            print("\n".join([f"{title}: {len(lines) or 'none'}", *(f"  {line}" for line in lines)]))
        told = [*impossible, *unsolved]
        write_text(self.out / "table.md", "\n".join([table.markdown(), *told]) + "\n")
