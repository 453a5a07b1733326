"""`warehouse clmapf`: the public benchmark of car-like robots -> solutions, rows, tables; or the check of solutions."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import tyro

from train.clmapf.draw import draw_instance
from train.clmapf.instance import write_instance
from train.clmapf.jobs import CheckJob, SolveJob, instances_in
from train.clmapf.motions import AUTHORS_STEP
from train.clmapf.table import cells_table, impossible_lines, published_table, unsolved_lines
from train.evaluation.jobs import Job, Runner
from train.evaluation.processes import Processes
from train.evaluation.rollout import MOST
from train.reporting.rows import Row, RowFile
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError, MapError
from warehouse_env.files import check_writable, write_text


@dataclass(frozen=True)
class Clmapf(Checked):
    """Plan the routes of all instances of CL-MAPF below a folder, check them exactly, and hold them beside others'.

    Example: warehouse clmapf CL-CBS/benchmark
    """

    folder: tyro.conf.Positional[Path]
    """Folder with instances of the benchmark, *.yaml, at any depth; with --generate the folder to write them to."""
    check: bool = False
    """Plan nothing: check the files under --solutions, ours or others', which have the instances' names; exit code 1
    if one has a fault."""
    solutions: Path | None = None
    """Folder for the solutions, in the format of the benchmark's authors (OUT/solutions if left out)."""
    authors_steps: bool = False
    """With --check, t counts the steps of the authors' solver, each 2.118 long; else it is seconds at unit speed."""
    whole_bodies: bool = False
    """Whole bodies must stay on the floor; the benchmark's own rule, and the default, asks it of rear axles alone."""
    generate: int = 0
    """Draw so many instances a number of robots, like the benchmark's, instead of planning."""
    side: int = 50
    """With --generate, side of the floor."""
    robots: tuple[int, ...] = (5, 10, 15, 20)
    """With --generate, numbers of robots."""
    discs: int = 0
    """With --generate, obstacles on each floor."""
    seed: int = 0
    """Seed of the planner, and of the first instance that is drawn."""
    json: Path | None = None
    """Write the rows, one an instance, to this file as JSON lines (OUT/rows.jsonl if left out)."""
    out: Path = Path("results/clmapf")
    """Folder for the rows, the tables and the solutions."""
    processes: int = field(default_factory=lambda: min(os.cpu_count() or 1, 8))
    """Instances to plan at a time, each in a process of its own."""

    def run(self) -> None:
        """Do what is asked for; print the tables, and what is impossible, unsolved or wrong."""
        if not 0 <= self.generate <= MOST or self.seed < 0 or self.processes < 1:
            raise ConfigError(
                f"--generate {self.generate} must lie in 0..{MOST:,}, --seed {self.seed} be at least 0, and "
                f"--processes {self.processes} at least 1"
            )
        if self.generate:
            self._draw()
            return
        jobs, path = self._jobs(), self.json or self.out / "rows.jsonl"
        check_writable(self.out / "table.md")
        with RowFile(path) as file, Runner(file, workers=Processes(self.processes)) as run:
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
        if not self.check:
            return [SolveJob(self.folder, name, solutions, self.seed, self.whole_bodies) for name in names]
        if not any((solutions / name).is_file() for name in names):
            raise MapError(f"{solutions} holds no solution named as an instance in {self.folder}")
        unit = AUTHORS_STEP if self.authors_steps else 1.0
        return [CheckJob(self.folder, name, solutions, unit, self.whole_bodies) for name in names]

    def _tell(self, rows: Sequence[Row]) -> None:
        tables = cells_table(rows), published_table()
        for table in tables:
            table.print()
        impossible, unsolved = impossible_lines(rows), unsolved_lines(rows)
        for title, lines in (("impossible as stated", impossible), ("not solved", unsolved)):
            print("\n".join([f"{title}: {len(lines) or 'none'}", *(f"  {line}" for line in lines)]))
        told = [*impossible, *unsolved]
        write_text(self.out / "table.md", "\n".join([*(table.markdown() for table in tables), *told]) + "\n")

    def _draw(self) -> None:
        if not 10 <= self.side <= 1000 or not all(1 <= count <= 1000 for count in (*self.robots, self.discs or 1)):
            raise ConfigError("--side must lie in 10..1000, --robots and --discs in 1..1000 (or --discs 0)")
        for count in self.robots:
            for seed in range(self.seed, self.seed + self.generate):
                instance = draw_instance(self.side, count, self.discs, seed)
                write_instance(instance, self.folder / f"{instance.name}.yaml")
        print(f"wrote {self.generate * len(self.robots)} instances to {self.folder}")
