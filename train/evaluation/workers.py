"""The options of commands with many jobs that choose the workers."""

from __future__ import annotations

import importlib.util
import re
from dataclasses import dataclass
from typing import ClassVar

from train.evaluation.cluster import AUTO, LOCAL, Cluster
from train.evaluation.jobs import Here, Workers
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
