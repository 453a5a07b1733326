"""Jobs, and the runner that writes the rows of each job to a file as soon as the job ends.

Jobs whose rows are in the file are skipped. Rows are the same whether this process does the jobs, several processes
(processes.py) or the nodes of a cluster (cluster.py).
"""

import contextlib
import hashlib
import json
import random
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import ClassVar, NamedTuple, Protocol, Self

import warehouse_env
from train.reporting.report import make_progress
from train.reporting.rows import Row, RowFile
from warehouse_env.errors import LostError

_EACH = 4  # parts of jobs for each worker, so that none idles for long at the end

Tick = Callable[[float], None]
"""Called by a job with the part of its size that is done."""

Progress = Callable[[float, str], None]
"""Called with the total size that is done, and a text for the progress bar."""


@cache
def code_of(*folders: str) -> str:
    """Return a digest of our sources in some folders, so that changed code is noticed."""
    home = Path(warehouse_env.__file__).parent.parent
    sources = sorted(path for folder in folders for path in (home / folder).rglob("*.py"))
    return hashlib.blake2b(b"".join(path.read_bytes() for path in sources), digest_size=8).hexdigest()


class Result(NamedTuple):
    """The rows of a job, and more rows, for another file."""

    rows: list[Row]
    notes: Sequence[Row] = ()


class Job:
    """A piece of work that can be pickled."""

    titled: ClassVar[str]  # with the job's fields in braces
    times: ClassVar[tuple[str, ...]] = ()  # fields of its rows that are times, which are left empty on a cluster

    @property
    def identity(self) -> Row:
        """The fields that its rows share. Equal identities mean equal rows, except for times."""
        return {}

    @property
    def title(self) -> str:
        """What the progress bar says."""
        return self.titled.format(**vars(self))

    @property
    def size(self) -> float:
        """The size of the job on the progress bar."""
        return 1.0

    @property
    def files(self) -> tuple[str, ...]:
        """Names, as typed, of the files and folders that it reads; other names are ignored."""
        return ()

    def left(self, rows: Sequence[Row]) -> tuple[Sequence[Row], Self | None]:
        """Return the rows of its identity that are valid, and the job that is left to be done; None if nothing is."""
        return [], self

    def parts(self, most: float) -> Sequence[Self]:
        """Return jobs that together give the same rows, if possible none larger than `most`."""
        return [self]

    def run(self, tick: Tick) -> Result:
        """Do the job."""
        raise NotImplementedError


Numbered = tuple[int, Job]
"""A job, and its number among those requested."""


class Workers(Protocol):
    """What does the jobs."""

    @property
    def width(self) -> int:
        """Number of jobs done at a time."""

    def each(self, jobs: Sequence[Numbered], moved: Progress) -> Iterator[tuple[int, Result]]:
        """Yield number and result of each job as it ends; after all, LostError names those that could not be done."""

    def close(self) -> None:
        """Stop all jobs at once."""


class Here:
    """This process."""

    width = 1

    def each(self, jobs: Sequence[Numbered], moved: Progress) -> Iterator[tuple[int, Result]]:
        """Do the jobs in turn (see `Workers.each`); a job's own errors are raised unchanged."""
        done = 0.0
        for number, job in jobs:
            moved(done, job.title)
            yield number, job.run(lambda part, done=done, job=job: moved(done + part, job.title))  # type: ignore[misc]
            done += job.size
            moved(done, job.title)

    def close(self) -> None:
        """Nothing is under way."""


def rows_of_jobs(jobs: Sequence[Job], rows: Sequence[Row]) -> list[list[Row]]:
    """Return for each job the rows with its identity."""
    if not rows:
        return [[] for _ in jobs]
    indices: dict[tuple[str, ...], dict[str, list[Row]]] = {}  # by the names of an identity, then its values
    found = []
    for job in jobs:
        identity = job.identity
        names = tuple(identity)
        if names not in indices:
            indices[names] = {}
            for row in rows:
                indices[names].setdefault(_key(row, names), []).append(row)
        found.append(indices[names].get(_key(identity, names), []))
    return found


def lost_jobs(lost: Sequence[Job], jobs: int, tries: int) -> LostError:
    """Return the error that names the jobs, of so many, whose workers were lost each time."""
    named = "; ".join(job.title for job in lost)
    return LostError(f"{len(lost)} of {jobs} jobs lost their worker {tries} times: {named}")


def _key(row: Row, names: Sequence[str]) -> str:
    return json.dumps([row.get(name) for name in names], sort_keys=True)


class Runner:
    """A context that does the jobs whose rows are missing and writes their rows; it stops its workers at the end.

    A job's own errors are raised unchanged. On Ctrl-C the KeyboardInterrupt says which rows are kept. If a worker is
    killed, say for its memory, its job is repeated. If that fails too, LostError names it after all other jobs.
    """

    def __init__(
        self, file: RowFile, old: Sequence[Row] = (), workers: Workers | None = None, *, goes_on: str = "",
        mixed: bool = False, progress: Progress | None = None, notes: RowFile | None = None,
    ) -> None:  # fmt: skip
        """Take a file for the rows, and the rows that it holds already.

        workers: this process by default. goes_on: how to resume a stopped command. mixed: shuffle the jobs, always the
        same way, so that the progress bar can estimate the time. progress: a bar on stderr by default. notes: gets
        those of a part before its rows are written.
        """
        self._file, self._known, self._workers = file, list(old), workers or Here()
        self._goes_on, self._mixed, self._progress, self._notes = goes_on, mixed, progress, notes

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._workers.close()

    def __call__(self, jobs: Sequence[Job]) -> list[Row]:
        """Return the rows of all jobs, in their order."""
        rows: dict[int, list[Row]] = {}
        missing: list[Numbered] = []
        for number, (job, known) in enumerate(zip(jobs, rows_of_jobs(jobs, self._known), strict=True)):
            stand, left = job.left(known)
            rows[number] = list(stand)
            if left is not None:
                missing.append((number, left))
        most = sum(job.size for _, job in missing) / (_EACH * self._workers.width) if missing else 0.0
        parts = [(number, part) for number, job in missing for part in job.parts(most)]
        numbered = list(enumerate(part for _, part in parts))
        if self._mixed:
            random.Random(0).shuffle(numbered)
        done: dict[int, list[Row]] = {}  # by number of the part
        try:
            with _shown(sum(job.size for _, job in parts), self._progress) as moved:
                for part, result in self._workers.each(numbered, moved):
                    if self._notes is not None:
                        self._notes.add(result.notes)
                    self._file.add(result.rows)
                    self._known += result.rows
                    done[part] = result.rows
        except KeyboardInterrupt as stop:
            raise type(stop)(*self._left_behind()) from None
        except LostError as error:
            raise LostError("; ".join([str(error), *self._left_behind()])) from None
        for part in sorted(done):
            rows[parts[part][0]] += done[part]
        return [row for number in sorted(rows) for row in rows[number]]

    def _left_behind(self) -> list[str]:
        return [self._file.kept(), *([self._goes_on] if self._goes_on and self._file.count else [])]


@contextlib.contextmanager
def _shown(size: float, progress: Progress | None) -> Iterator[Progress]:
    if progress is not None:
        yield progress
        return
    with make_progress() as bars:
        bar = bars.add_task("", total=size)
        yield lambda done, title: bars.update(bar, completed=done, description=title)
