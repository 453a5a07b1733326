"""The options that all commands of `warehouse tables` share, and how they run jobs and write their page."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from train.evaluation.rollout import MOST
from train.evaluation.workers import RowOptions
from train.reporting.report import Table
from warehouse_env.files import write_text

PAGE = "README.md"


@dataclass(frozen=True)
class TableOptions(RowOptions):
    """Options of every table; a subclass says what is run."""

    name: ClassVar[str] = ""  # of the folder in OUT
    usual_processes: ClassVar[int] = os.cpu_count() or 1

    seed: int = 0
    """Seed of the runs; named maps are fixed."""
    out: Path = Path("results/tables")
    """Folder for the rows and the page; each command but `papers` has its own folder in it."""
    ranges: ClassVar = {"seed": (0, 2**62), "runs": (1, MOST)}

    @property
    def folder(self) -> Path:
        """Where everything goes."""
        return self.out / self.name

    @property
    def page(self) -> Path:
        """The page of the tables."""
        return self.folder / PAGE

    def write(self, title: str, tables: Sequence[Table], text: str = "") -> None:
        """Write the page: the title, some Markdown, and the tables; say where it is."""
        shown = "\n".join(table.markdown() for table in tables)
        write_text(self.page, f"# {title}\n\n{text}{shown}")
        print(f"wrote the tables to {self.page}, the rows to {self.rows_path}")
