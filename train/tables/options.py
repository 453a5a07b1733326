"""The options that all commands of `warehouse tables` share, and how they run jobs and write their page."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from train.evaluation.jobs import Job, Runner, go_on
from train.evaluation.rollout import MOST
from train.evaluation.workers import WorkerOptions
from train.reporting.report import Table
from train.reporting.rows import Row, RowFile
from warehouse_env.files import check_writable, write_text

PAGE = "README.md"
GOES_ON = "the same command goes on from there"


@dataclass(frozen=True)
class TableOptions(WorkerOptions):
    """Options of every table; a subclass says what is run."""

    name: ClassVar[str] = ""  # of the folder in OUT
    usual_processes: ClassVar[int] = os.cpu_count() or 1

    seed: int = 0
    """Seed of the runs; named maps are fixed."""
    fresh: bool = False
    """Run everything again, instead of keeping the rows that the file holds already."""
    json: Path | None = None
    """File for the rows, as JSON lines (rows.jsonl in the table's folder if left out)."""
    out: Path = Path("results/tables")
    """Folder for the rows and the page; each command but `papers` has its own folder in it."""
    ranges: ClassVar = {"seed": (0, 2**62), "runs": (1, MOST)}

    @property
    def folder(self) -> Path:
        """Where everything goes."""
        return self.out / self.name

    @property
    def rows_path(self) -> Path:
        """Where the rows go."""
        return self.json or self.folder / "rows.jsonl"

    def check_writable(self) -> None:
        """Raise WarehouseError if the page cannot be written; asked before a long run."""
        check_writable(self.folder / PAGE)

    def rows_of(self, jobs: Sequence[Job], ours: Callable[[Row], bool] | None = None) -> list[Row]:
        """Return the rows of jobs, in their order; jobs whose rows the file holds are not done again.

        ours: which rows of the file are removed if no job has them, since other code or other seeds made them.
        """
        with RowFile(self.rows_path, keep=ours is not None or not self.fresh) as file:
            kept = file.old() if ours is None else go_on(file, jobs, ours, self.fresh)
            with Runner(file, kept, self.workers(), goes_on=GOES_ON, mixed=True) as run:
                return run(jobs)

    def write(self, title: str, tables: Sequence[Table], text: str = "") -> None:
        """Write the page: the title, some Markdown, and the tables; say where it is."""
        shown = "\n".join(table.markdown() for table in tables)
        write_text(self.folder / PAGE, f"# {title}\n\n{text}{shown}")
        print(f"wrote the tables to {self.folder / PAGE}, the rows to {self.rows_path}")
