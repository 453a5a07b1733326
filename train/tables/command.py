"""`warehouse tables papers`: every comparison table of the papers, from fixed seeds."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

from train.evaluation.jobs import Known
from train.reporting.report import require_charts
from train.reporting.rows import Row, whole_rows
from train.tables.blocks import blocks_of, chosen
from train.tables.options import StudyOptions
from train.tables.page import write_pages
from train.tables.study import Study


@dataclass(frozen=True)
class Papers(StudyOptions):
    """Make the tables of the papers: ours beside theirs, a verdict on every claim, and pictures."""

    papers: tuple[str, ...] = ()
    """Papers by number, as 000 (all if neither papers nor tables are named)."""
    tables: tuple[str, ...] = ()
    """Single tables by name, as 000_table_1."""
    runs: int | None = None
    """Runs of each system on each task (each study's own number if left out)."""
    pictures: bool = True
    """Draw paths and convergence."""

    def run(self) -> None:
        """Run what is missing, then write tables, verdicts and pictures."""
        if self.pictures:
            require_charts()
        begin = time.perf_counter()
        studies = chosen(self.papers, self.tables)
        self.check_writable()
        names = {study.name for _, study in studies}
        blocks = [block for module, study in studies for block in blocks_of(module, study, self.runs, self.seed)]
        rows = self.rows_of(blocks, lambda row: row.get("study") in names)
        before = self._made_before(studies)
        write_pages([study for _, study in studies], rows, before, self.folder, pictures=self.pictures)
        print(self.written(begin))

    def _made_before(self, studies: Sequence[tuple[str, Study]]) -> list[tuple[Study, list[Row]]]:
        """Return the other studies whose rows are all in the file, for the index."""
        known, found = Known(whole_rows(self.rows_path)), []
        for module, study in (one for one in chosen((), ()) if one not in studies):
            done = [block.left(known.of(block)) for block in blocks_of(module, study, self.runs, self.seed)]
            if all(left is None for _, left in done):
                found.append((study, [row for rows, _ in done for row in rows]))
        return found
