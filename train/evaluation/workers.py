"""The options of commands with many jobs: the workers, and what becomes of rows that are there already."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from train.evaluation.cluster import Cluster, check_address
from train.evaluation.jobs import Here, Job, Runner, Workers
from train.evaluation.kernels import compile_missing
from train.evaluation.processes import Processes
from train.reporting.rows import Row, RowFile
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError
from warehouse_env.files import check_writable

GOES_ON = "the same command with --resume goes on"


@dataclass(frozen=True)
class RowOptions(Checked):
    """Options of commands with many jobs, whose rows stay in a file, so that a stopped command can continue."""

    processes: int | None = None
    """Number of processes that do jobs side by side; rows do not depend on it, except for times (default: 1 for
    evaluate, robust and audit, else the number of cores)."""
    ray: str | None = None
    """Do the jobs on a Ray cluster: auto (the one that this machine belongs to) or HOST:PORT."""
    resume: bool = False
    """Keep the rows in the file, and do only what is missing."""
    overwrite: bool = False
    """Replace the rows in the file."""
    json: Path | None = None
    """File for the rows, as JSON lines (default: rows.jsonl beside the table or page)."""
    out: Path = Path("results")
    """Folder for the rows, and for what shows them."""

    usual_processes: ClassVar[int] = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        self._between(1, 4096, "processes")
        if self.ray is None:
            return
        if self.processes is not None:
            raise ConfigError(
                f"--processes {self.processes} must be left out with --ray, which uses all cores it finds"
            )
        check_address(self.ray)

    @property
    def folder(self) -> Path:
        """Where everything goes."""
        return self.out

    @property
    def rows_path(self) -> Path:
        """Where the rows go."""
        return self.json or self.folder / "rows.jsonl"

    def workers(self) -> Workers:
        """Return the workers, for a Runner, which stops them."""
        if self.ray is not None:
            return Cluster(self.ray, compile_missing)
        processes = self.processes or self.usual_processes
        return Here() if processes == 1 else Processes(processes)

    def file(self, resumes: bool = True) -> RowFile:
        """Return the file of the rows, a context that refuses to replace any; resumes: whether --resume helps."""
        kept = "--resume keeps them and goes on, " * resumes
        advice = "" if self.overwrite else f"{kept}--overwrite replaces them, another --out leaves them alone"
        return RowFile(self.rows_path, self.resume, advice)

    def rows_of(
        self, jobs: Sequence[Job], page: Path, notes: RowFile | None = None, *, mixed: bool = False,
        resumes: bool = True,
    ) -> list[Row]:  # fmt: skip
        """Do what is missing of jobs; return all rows, in order. WarehouseError if `page` could not be written then.

        notes: the file for `Result.notes`. mixed: see `Runner`. resumes: see `file`.
        """
        check_writable(page)
        with (
            self.file(resumes) as file,
            Runner(file, file.old(), self.workers(), goes_on=GOES_ON, mixed=mixed, notes=notes) as run,
        ):
            return run(jobs)
