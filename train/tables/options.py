"""What every command of `warehouse tables` can be told, and how it writes its page."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from train.evaluation.episodes import Episodes
from train.evaluation.jobs import Job, Runner, go_on
from train.evaluation.rollout import MOST, Experiment
from train.evaluation.workers import WorkerOptions
from train.reporting.report import Table
from train.reporting.rows import Row, RowFile
from warehouse_env.files import check_writable, write_text

PAGE = "README.md"
GOES_ON = "the same command goes on from there"


@dataclass(frozen=True)
class StudyOptions(WorkerOptions):
    """What is the same for all; a subclass says what is run."""

    name: ClassVar[str] = ""  # of the folder in OUT
    usual_processes: ClassVar[int] = os.cpu_count() or 1

    seed: int = 0
    """Seed of the runs; named maps are fixed."""
    fresh: bool = False
    """Run everything again, instead of keeping the rows that the file holds already."""
    json: Path | None = None
    """File for the rows, as JSON lines (rows.jsonl in the study's folder if left out)."""
    out: Path = Path("results/tables")
    """Folder for the rows, the tables and the pictures; each study but the papers' has its own in it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._between(0, 2**62, "seed")
        self._between(1, MOST, *(name for name in ("runs", "pairs", "trainings") if hasattr(self, name)))

    @property
    def folder(self) -> Path:
        """Where everything goes."""
        return self.out / self.name

    @property
    def rows_path(self) -> Path:
        """Where the rows go."""
        return self.json or self.folder / "rows.jsonl"

    def check_writable(self) -> None:
        """Raise WarehouseError if the page cannot be written: asked before a long run, not found out after it."""
        check_writable(self.folder / PAGE)

    def drive(self, experiments: Sequence[Experiment]) -> list[Row]:
        """Return the rows of experiments, in their order; those that the file holds are not driven again."""
        with RowFile(self.rows_path, keep=not self.fresh) as file:
            return self._do(file, file.old(), [Episodes(one) for one in experiments])

    def rows_of(self, jobs: Sequence[Job], ours: Callable[[Row], bool]) -> list[Row]:
        """Return the rows of jobs, in their order; those that the file holds are not done again.

        ours: which rows of the file go where no job has them, for they were made by other code or from other seeds.
        """
        with RowFile(self.rows_path, keep=True) as file:
            return self._do(file, go_on(file, jobs, ours, self.fresh), jobs, mixed=True)

    def _do(self, file: RowFile, kept: Sequence[Row], jobs: Sequence[Job], mixed: bool = False) -> list[Row]:
        with Runner(file, kept, self.workers(), goes_on=GOES_ON, mixed=mixed) as run:
            return run(jobs)

    def written(self, begin: float) -> str:
        """Say what was written in the time since `begin`, as time.perf_counter counts."""
        seconds = time.perf_counter() - begin
        return f"wrote the tables to {self.folder} in {seconds:.0f} s, the rows to {self.rows_path}; begin with {PAGE}"

    def write(self, title: str, tables: Sequence[Table], shown: str = "") -> None:
        """Print the tables and write the page: the title, what is `shown`, in Markdown, and the tables."""
        for table in tables:
            table.print()
        text = "\n".join(table.markdown() for table in tables)
        write_text(self.folder / PAGE, f"# {title}\n\n{shown}{text}")
