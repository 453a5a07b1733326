"""Options of commands that do many jobs: who does them."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, NamedTuple

from train.evaluation.cluster import AUTO, LOCAL, Cluster
from train.evaluation.jobs import Here, Job, Workers, in_parts
from train.evaluation.kernels import compile_missing
from train.evaluation.processes import Processes
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError, shown

_ADDRESS = re.compile(r"[^\s:/]+:\d{1,5}|\[[0-9a-fA-F:]+\]:\d{1,5}")


@dataclass(frozen=True)
class WorkerOptions(Checked):
    """Who does the jobs: processes of this machine, or a cluster."""

    processes: int | None = None
    """Jobs to do at a time, each in a process of its own; the rows stay the same but for the times (evaluate, robust
    and audit: 1, others: the cores, if left out)."""
    ray: str | None = None
    """Let a Ray cluster do the jobs: auto (the one this machine belongs to), HOST:PORT, or local (this machine)."""

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

    def workers(self) -> Workers:
        """Return those who do the jobs; for a Runner, which ends them."""
        if self.ray is not None:
            return Cluster(self.ray, compile_missing)
        processes = self.processes or self.usual_processes
        return Here() if processes == 1 else Processes(processes)


def check_address(ray: str) -> None:
    """Raise ConfigError for what is no address of a cluster, and where Ray is not installed."""
    if ray not in (AUTO, LOCAL) and not _ADDRESS.fullmatch(ray):
        raise ConfigError(f"--ray {shown(ray)} must be {AUTO}, {LOCAL} or HOST:PORT")
    if importlib.util.find_spec("ray") is None:
        raise ConfigError('--ray needs the package ray: pip install "warehouse-env[ray]"')


class Shard(NamedTuple):
    """One of several equal shares of jobs, done apart from the others."""

    number: int  # from 1
    of: int

    @classmethod
    def parse(cls, text: str) -> Shard:
        """Read "3/16"; ConfigError for anything else."""
        found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
        if not found or not 1 <= int(found[1]) <= int(found[2]):
            raise ConfigError(f"--shard {shown(text)} must be I/N with I from 1 to N, as 3/16")
        return cls(int(found[1]), int(found[2]))

    def jobs(self, jobs: Sequence[Job]) -> list[Job]:
        """Return this share: every N-th part, the same whatever is done already."""
        parts = in_parts(list(enumerate(jobs)), self.of)
        return [job for _, job in parts[self.number - 1 :: self.of]]

    def beside(self, path: Path) -> Path:
        """Return the file of this share beside the one for all rows."""
        return path.with_name(f"{path.stem}-{self.number}-of-{self.of}{path.suffix}")

    def then(self, path: Path) -> str:
        """Say what to do when all shares are done."""
        every = path.with_name(f"{path.stem}-*-of-{self.of}{path.suffix}")
        return f"when all {self.of} are there, `cat {every} > {path}`, and"


@dataclass(frozen=True)
class ShardOptions(WorkerOptions):
    """Also which share of the jobs, for arrays of jobs in a queue."""

    shard: str | None = None
    """Do only the I-th of N shares of the jobs, as 3/16, and only write rows, to a file of the share's own."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.shard is not None:
            Shard.parse(self.shard)

    @property
    def share(self) -> Shard | None:
        """The share, None for all."""
        return None if self.shard is None else Shard.parse(self.shard)
